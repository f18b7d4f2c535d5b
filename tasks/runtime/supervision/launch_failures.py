"""Lines by which `roslaunch` and `ros2 launch` say that they did not launch what they were asked to.

Neither ends with an exit code that says so: `roslaunch` goes on without a node that it cannot launch, and ends with 0
after a required node died. What nodes print begins with other words; `ros2 launch` puts their names before it.
"""

import os
import re
from collections.abc import Callable, Iterator
from contextlib import suppress

_CHUNK_BYTES = 256 * 1024
"""Read of a log at a time; who writes more between two looks has other troubles."""
_COLOURS = re.compile(rb"\x1b\[[0-9;]*m")
_STAMP = rb"^(?:\d+\.\d+ )?"
_CANNOT = re.compile(rb"^ERROR: (cannot launch node of type .*)")
_REQUIRED_1 = re.compile(rb"^=*(REQUIRED process \[[^\]]*\] has died!)")
_EXCEPTION = re.compile(
    _STAMP
    + rb"\[ERROR\] \[launch\]: (Caught (?:exception|multiple exceptions) (?:in launch|when trying to load file).*)"
)
_NOT_EXECUTED = re.compile(_STAMP + rb"\[ERROR\] \[([^\]]+)\]: exception occurred while executing process:")
_DIED_2 = re.compile(_STAMP + rb"\[ERROR\] \[([^\]]+)\]: (process has died .*)")
_REQUIRED_2 = re.compile(_STAMP + rb"\[INFO\] \[launch\]: process\[([^\]]+)\] was required: shutting down")
_TRACEBACK = (b" ", b"\t", b"Traceback ")


class LaunchWatch:
    """Reads a log as it grows, from where it ends now.

    Args:
        descriptor: The log.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._offset = self._size()
        self._part = b""
        self._died: dict[bytes, bytes] = {}
        """Nodes of ROS 2 that died, and the words that say so."""
        self._awaited: Callable[[bytes], bytes | None] | None = None
        """The reader of the line after one that does not say all."""

    def look(self) -> str | None:
        """Returns the first new line that says that something could not be launched, or that a required node died."""
        found = (self._failure_in(line) for line in self._new_lines())
        said = next((each for each in found if each is not None), None)
        return None if said is None else said.decode(errors="replace").strip()

    def _failure_in(self, line: bytes) -> bytes | None:
        if self._awaited is not None:
            return self._awaited(line)
        if (found := _CANNOT.match(line) or _EXCEPTION.match(line)) is not None:
            return found[1]
        if (found := _REQUIRED_1.match(line)) is not None:
            self._awaited = lambda next_line, said=found[1]: self._after_required(said, next_line)
        elif (found := _NOT_EXECUTED.match(line)) is not None:
            self._awaited = lambda next_line, node=found[1]: self._after_traceback(node, next_line)
        elif (found := _DIED_2.match(line)) is not None:
            self._died[found[1]] = found[2]
        elif (found := _REQUIRED_2.match(line)) is not None and found[1] in self._died:
            return b"required node %s: %s" % (found[1], self._died[found[1]])
        return None

    def _after_required(self, said: bytes, line: bytes) -> bytes | None:
        """A required node may also end well: `process has finished cleanly`."""
        self._awaited = None
        return b"%s %s" % (said, line) if line.startswith(b"process has died") else None

    def _after_traceback(self, node: bytes, line: bytes) -> bytes | None:
        if not line.strip() or line.startswith(_TRACEBACK):
            return None
        self._awaited = None
        return b"%s cannot be executed: %s" % (node, line)

    def _new_lines(self) -> Iterator[bytes]:
        """Whole lines that were written since the last call, without colours."""
        size = self._size()
        if size == self._offset:
            return
        start = max(min(self._offset, size), size - _CHUNK_BYTES)
        if start != self._offset:
            self._part = b""
        self._offset = size
        with suppress(OSError):
            *lines, self._part = (self._part + os.pread(self._descriptor, size - start, start)).split(b"\n")
            yield from (_COLOURS.sub(b"", line) for line in lines)

    def _size(self) -> int:
        return os.fstat(self._descriptor).st_size
