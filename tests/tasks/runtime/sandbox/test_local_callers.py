"""The process at the other end of a connection, as the kernel says."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from helpers.processes import wait_for

from prefect_robomaker.tasks.runtime.limits.processes import process_state
from prefect_robomaker.tasks.runtime.sandbox.local_callers import (
    Address,
    Callers,
    ConnectionEnd,
    end_of_connection,
    mark_run,
    marked_runs,
)

JOB = "arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-1"
SLEEPS = "import socket, sys, time; s = socket.create_connection(('127.0.0.1', int(sys.argv[1]))); time.sleep(600)"


@contextmanager
def connected(*command: str) -> Iterator[tuple[Address, Address, int]]:
    """Both addresses of a connection that a process makes, and that process."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with subprocess.Popen([*command, sys.executable, "-c", SLEEPS, str(port)]) as process:
            try:
                accepted, _ = server.accept()
                with accepted:
                    yield accepted.getpeername(), accepted.getsockname(), process.pid
            finally:
                process.kill()


def note(home: Path, pid: int, started: int) -> None:
    folder = home / "jobs" / "sim-1" / "run-1"
    folder.mkdir(parents=True)
    (folder / "supervisor.json").write_text(json.dumps({"pid": pid, "started": started, "job": JOB}))


def test_a_process_of_no_run_is_no_job(tmp_path: Path) -> None:
    with connected() as (peer, server, _):
        assert Callers(tmp_path).who(peer, server).job is None
        assert Callers(tmp_path).who(peer, server).why_unknown is None


def test_a_process_below_a_supervisor_is_its_job(tmp_path: Path) -> None:
    mark_run_in = tmp_path / "jobs" / "sim-1" / "run-1"
    mark_run_in.mkdir(parents=True)
    mark_run(mark_run_in, JOB)
    with connected() as (peer, server, _):
        assert Callers(tmp_path).who(peer, server).job == JOB


def test_a_mark_of_a_process_that_has_ended_counts_no_more(tmp_path: Path) -> None:
    """Its number may be that of another process by now."""
    process = process_state(os.getpid())
    assert process is not None
    note(tmp_path, os.getpid(), process.started + 1)
    assert marked_runs(tmp_path) == {}


def test_a_sender_that_has_gone_is_unknown(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        client = socket.create_connection(server.getsockname())
        accepted, _ = server.accept()
        with accepted:
            peer, here = accepted.getpeername(), accepted.getsockname()
            client.close()
            wait_for(lambda: (end := end_of_connection(peer, here)) is None or end.inode == 0, "the end")
            assert Callers(tmp_path).who(peer, here).why_unknown is not None


@pytest.mark.skipif(os.geteuid() != 0, reason="another user needs root")
def test_a_process_in_another_namespace_is_unknown(tmp_path: Path) -> None:
    with connected("unshare", "--pid", "--fork", "--kill-child") as (peer, server, _):
        why = Callers(tmp_path).who(peer, server).why_unknown
        assert why is not None
        assert "namespace" in why


def test_a_connection_that_no_process_is_seen_to_hold_is_unknown(tmp_path: Path) -> None:
    """Such as one that is on its way from a process to another one in a message."""
    callers = Callers(tmp_path, lambda peer, server: ConnectionEnd(os.geteuid(), 1))
    assert callers.who(("127.0.0.1", 1), ("127.0.0.1", 2)).why_unknown is not None


def test_the_list_of_the_kernel_says_the_same_as_its_answer() -> None:
    from prefect_robomaker.tasks.runtime.sandbox.local_callers import _asked, _listed

    for family, host in ((socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")):
        with (
            socket.create_server((host, 0), family=family) as server,
            socket.create_connection(server.getsockname()[:2]) as client,
        ):
            accepted, _ = server.accept()
            with accepted:
                ends = accepted.getpeername()[:2], accepted.getsockname()[:2]
                assert _asked(*ends) == _listed(*ends) == ConnectionEnd(os.geteuid(), os.fstat(client.fileno()).st_ino)
