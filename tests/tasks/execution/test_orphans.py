"""Orphans: the death of the parent is noticed while a run goes on, and not after its end; the process ends whatever."""

import os
import signal
import subprocess
import sys
from contextlib import suppress

import pytest

from prefect_robomaker.schemas.job_owners import NeededEnvironment
from prefect_robomaker.tasks.catalog import FirstLease, Resource
from prefect_robomaker.tasks.execution.orphans import words_of_end
from prefect_robomaker.tasks.service.service import Service

PROGRAM = """
import os, sys, threading, time, uuid
from prefect_robomaker.tasks.execution import orphans

orphans._LOOK_S = 0.05
parent = os.getpid()

def orphaned():
    print("orphaned", flush=True)
    os._exit(1)

def in_a_run():
    with orphans.watching_parent(orphaned):
        print("watching", flush=True)
        time.sleep(60)

def after_its_run():
    with orphans.watching_parent(orphaned):
        pass
    print("watching", flush=True)
    while os.getppid() == parent:
        time.sleep(0.1)
    time.sleep(1)

def with_a_broken_catalog():
    class Broken:
        def release(self, arn, owner):
            raise LookupError(arn)
    with orphans.HELD.owner_of("arn"):
        print("watching", flush=True)
        threading.Thread(target=orphans.end_orphan, args=(Broken(), uuid.uuid4()), daemon=True).start()
        time.sleep(60)
        print("it lives", flush=True)

for case, output in zip((in_a_run, after_its_run, with_a_broken_catalog), sys.argv[1:]):
    if child := os.fork():
        os.close(int(output))
        print(child, flush=True)
    else:
        os.dup2(int(output), 1)
        os.close(int(output))
        case()
        os._exit(0)
sys.stdin.read()
os._exit(0)
"""
"""Starts processes that write to files of their own, and dies when its standard input is closed."""


@pytest.mark.deep
def test_the_death_of_the_parent_counts_until_the_run_ends_and_ends_the_process_whatever() -> None:
    """The last one's leases cannot be given back."""
    environ = {**os.environ, "PREFECT_API_URL": "http://127.0.0.1:1/api"}
    pipes = [os.pipe() for _ in range(3)]
    ends = [write for _, write in pipes]
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *map(str, ends)],
        env=environ,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        pass_fds=ends,
    ) as parent:
        for end in ends:
            os.close(end)
        assert parent.stdin is not None
        assert parent.stdout is not None
        children = [int(parent.stdout.readline()) for _ in pipes]
        outputs = [os.fdopen(read) for read, _ in pipes]
        try:
            first = [output.readline() for output in outputs]
            parent.stdin.close()
            parent.wait(200)
            told = [said + output.read() for said, output in zip(first, outputs, strict=True)]  # until all have ended
        finally:
            for output in outputs:
                output.close()
            for child in children:
                with suppress(ProcessLookupError):
                    os.kill(child, signal.SIGKILL)

    assert told == ["watching\norphaned\n", "watching\n", "watching\n"]


ENDING = """
import threading
from prefect_robomaker.tasks.execution import orphans

begun, tried = threading.Event(), threading.Event()

def end():
    with orphans._ended(3):
        begun.set()
        tried.wait()

orphans.wait_if_ending()
threading.Thread(target=end).start()
begun.wait()
print("ending", flush=True)
tried.set()
orphans.wait_if_ending()
print("it went on", flush=True)
"""


def test_nothing_goes_on_in_a_process_that_ends_itself() -> None:
    done = subprocess.run([sys.executable, "-c", ENDING], capture_output=True, text=True, check=False, timeout=200)
    assert (done.returncode, done.stdout) == (3, "ending\n"), done.stderr


def test_what_goes_on_with_the_jobs_of_an_orphan_has_what_they_need(service: Service) -> None:
    needed = NeededEnvironment(
        machine="lab", python="/venv", python_path=("/robot",), variables={"ROBOMAKER_NICE": "3"}, packages={}
    )
    lease = FirstLease("lab:1:a:a run of a Prefect worker", 30, needed.model_dump(mode="json"))
    arns = [service.arn("simulation-job", name) for name in ("sim-a", "sim-b")]
    for arn, held in zip(arns, (lease, None), strict=True):
        job = Resource.new(arn=arn, kind="simulation-job", id=arn.rpartition("/")[2], status="Pending")
        service.catalog.create(job, token=None, lease=held)

    ended = "its Prefect worker has died, so that it ended itself"
    assert words_of_end(service.catalog, ()) == ended
    mine = f"`PYTHONPATH=/robot ROBOMAKER_NICE=3 /venv/bin/robomaker perform {arns[0]}` goes on with what it ran"
    assert words_of_end(service.catalog, arns[:1]) == f"{ended}; {mine}"
    assert words_of_end(service.catalog, arns) == f"{ended}; `robomaker perform {arns[1]}` goes on with what it ran"
