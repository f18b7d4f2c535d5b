"""Orphans: the death of the parent is noticed while a run goes on, and not after its end; the process ends whatever."""

import os
import signal
import subprocess
import sys
import textwrap
from contextlib import suppress

import pytest

PARENT = """
import os, sys, time
child = os.fork()
if child:
    print(child, flush=True)
    sys.stdin.read()
    os._exit(0)
"""
"""Starts a process, and dies when its standard input is closed."""


def run(child: str) -> str:
    """Runs a program whose parent dies after its first line; returns what it printed until it ended."""
    program = textwrap.dedent(PARENT) + textwrap.dedent(child)
    environ = {**os.environ, "PREFECT_API_URL": "http://127.0.0.1:1/api"}
    with subprocess.Popen(
        [sys.executable, "-c", program], env=environ, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdin is not None
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        try:
            first = parent.stdout.readline()
            parent.stdin.close()
            parent.wait(60)
            return first + parent.stdout.read()  # until the child, too, has closed it
        finally:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


@pytest.mark.parametrize(("ended", "told"), [(False, "watching\norphaned\n"), (True, "watching\n")])
def test_the_death_of_the_parent_counts_until_the_run_ends(ended: bool, told: str) -> None:
    child = f"""
    from prefect_robomaker.tasks.execution.orphans import watching_parent
    def orphaned():
        print("orphaned", flush=True)
        os._exit(1)
    with watching_parent(orphaned):
        parent = os.getppid()
        if not {ended}:
            print("watching", flush=True)
            time.sleep(60)
    print("watching", flush=True)
    while os.getppid() == parent:
        time.sleep(0.1)
    time.sleep(3)
    """
    assert run(child) == told


def test_an_orphan_ends_also_when_its_leases_cannot_be_given_back() -> None:
    child = """
    import threading, uuid
    from prefect_robomaker.tasks.execution.orphans import HELD, end_orphan
    class Broken:
        def release(self, arn, owner):
            raise LookupError(arn)
    with HELD.owner_of("arn"):
        print("watching", flush=True)
        threading.Thread(target=end_orphan, args=(Broken(), uuid.uuid4()), daemon=True).start()
        time.sleep(60)
        print("it lives", flush=True)
    """
    assert run(child) == "watching\n"
