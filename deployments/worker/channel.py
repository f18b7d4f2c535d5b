"""Message pipe between endpoint and job worker: JSON messages, each received whole."""

import json
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

WAKE: Mapping[str, Any] = {"do": "wake"}
"""Message that tells the job worker that the catalog has a new job."""

STOP: Mapping[str, Any] = {"do": "stop"}
"""Message that tells the job worker to release its unfinished jobs and end."""

_MAX_BYTES = 64 * 1024


class Channel:
    """One end of a message pipe between a server and its job worker process."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end

    @classmethod
    def pair(cls) -> tuple["Channel", "Channel"]:
        """Creates a new message pipe, and returns both ends."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        return cls(ours), cls(theirs)

    @classmethod
    def inherited(cls, descriptor: int) -> "Channel":
        """Opens the end of the pipe that the parent process has passed on."""
        end = socket.socket(fileno=descriptor)
        end.set_inheritable(False)
        return cls(end)

    def fileno(self) -> int:
        """Returns the file descriptor of this end of the pipe."""
        return self._end.fileno()

    def send(self, message: Mapping[str, Any]) -> None:
        """Sends a message without waiting; it is dropped if the other side does not read."""
        # A side that does not read has died, or has unread messages that tell it enough.
        with suppress(OSError):
            self._end.send(json.dumps(message, default=str).encode()[:_MAX_BYTES], socket.MSG_DONTWAIT)

    def receive(self) -> dict[str, Any] | None:
        """Waits for a message; returns `None` when the other side has died."""
        try:
            data = self._end.recv(_MAX_BYTES)
        except OSError:
            return None
        return json.loads(data) if data else None

    def close(self) -> None:
        """Closes this end of the pipe."""
        self._end.close()
