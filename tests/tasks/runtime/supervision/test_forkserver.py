"""What the warm process does where there is no room for more processes; `test_launcher` has all else."""

import errno
import os
import socket
import threading
import time
from collections.abc import Iterator

import pytest

from prefect_robomaker.tasks.runtime.supervision import forkserver


@pytest.fixture
def control(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """The launcher's end of a warm process that cannot fork."""

    def refuse() -> int:
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(forkserver.os, "fork", refuse)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    server = threading.Thread(target=forkserver._Supervisors(theirs, lambda _: None, fork_ahead_after_s=0.01).serve)
    server.start()
    with ours, theirs:
        yield ours
        ours.shutdown(socket.SHUT_RDWR)
        server.join(200)
        assert not server.is_alive()


def test_a_run_that_cannot_be_forked_is_told_so_and_others_are_not_concerned(control: socket.socket) -> None:
    time.sleep(0.1)  # it has tried to fork ahead
    for _ in range(2):
        launcher, channel = socket.socketpair()
        with launcher:
            with channel:
                socket.send_fds(control, [b"r"], [channel.fileno()])
            launcher.settimeout(60)
            assert launcher.recv(1) == b""
