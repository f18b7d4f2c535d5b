"""Log of a robot program's actions: the file `actions.bin`, written during a run and read to repeat the run."""

import hashlib
import json
import struct
import sys
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Literal, NamedTuple

import numpy as np
import zstandard
from pydantic import Field, ValidationError

from ....schemas.runs.provenance import ActionsSummary
from ....schemas.wire.base import Model
from ...files.untrusted_files import open_left, write_all
from .agent_client import ACTION_HEADER
from .agent_layout import Layout

ACTIONS_FILE = "actions.bin"
CHUNK_ACTIONS = 1024
"""Maximum number of actions in one compressed chunk of the log."""
CHUNK_BYTES = 64 * 1024
"""Size in bytes at which buffered actions are compressed into a chunk; it bounds the memory that the writer needs."""

MAGIC = b"robomaker actions 1\n"
PLAIN, PACKED = b"RMAP", b"RMAZ"
"""Kinds of chunks in the log: one uncompressed action, or several compressed ones."""
_CHUNK = struct.Struct("<4sIIQI")
"""Header of a chunk: kind, number of actions, content size in bytes, number of the first action, and a CRC-32 of all
other fields and the content.
"""
_MOST_HEADER_BYTES = 16 * 1024 * 1024
_MOST_ACTION_BYTES = 2**30
_MOST_OVERHEAD_BYTES = 1024


class ActionLogError(ValueError):
    """Raised when a file is no log of robot actions, or its header cannot be read; a damaged end is no error."""


_Bound = bool | int | float | None


class ActionArray(Model):
    """Description of one array of a robot's action in an action log: name, type and shape."""

    path: list[str | int] = Field(description="Keys that lead to it; empty when it is all there is.")
    dtype: str = Field(description="Type of its items, `float64`; little-endian.")
    shape: list[int] = Field(description="Length of each dimension.")
    offset: int = Field(ge=0, description="Position of its first byte, in bytes from the action's first.")
    minimum: _Bound | list[_Bound] = Field(default=None, description="Lower bound of all items, or of each.")
    maximum: _Bound | list[_Bound] = Field(default=None, description="Upper bound of all items, or of each.")
    description: str | None = Field(default=None, description="The name that the environment gives it.")

    def __str__(self) -> str:
        """Describes the array in short: `grip: bool[]`, or `float64[2]` if it is the whole action."""
        where = "/".join(map(str, self.path))
        return (f"{where}: " if where else "") + f"{self.dtype}{self.shape}"


class ActionLogHeader(Model):
    """Header of an action log: mode, size of an action in bytes, and its arrays."""

    mode: Literal["lockstep", "free"] = Field(description="Whether the simulation waited for each of them.")
    size: int = Field(ge=0, le=_MOST_ACTION_BYTES, description="Bytes of one action.")
    arrays: list[ActionArray] = Field(description="The arrays of one action.")

    def __str__(self) -> str:
        """Describes the arrays of an action in short: `grip: bool[], wheels: float32[4]`."""
        return ", ".join(map(str, self.arrays)) or "nothing"


def header_of(mode: Literal["lockstep", "free"], layout: Layout) -> ActionLogHeader:
    """Returns the header of an action log for actions of a given message layout."""
    arrays = layout.describe()["arrays"]
    return ActionLogHeader(
        mode=mode,
        size=layout.size - ACTION_HEADER.size,
        arrays=[ActionArray(**{**array, "offset": array["offset"] - ACTION_HEADER.size}) for array in arrays],
    )


def chunk_of(kind: bytes, count: int, first: int, content: bytes) -> bytes:
    """Returns a chunk (header and content) of an action log as bytes.

    Args:
        kind: Form of the content, plain or packed.
        count: Number of its actions.
        first: Number of its first action.
        content: The actions.
    """
    return _CHUNK.pack(kind, count, len(content), first, _checksum(count, first, content)) + content


class ActionLog:
    """Reader of the actions that a robot program sent during a run, one chunk at a time; a damaged end is left out."""

    def __init__(self, path: Path) -> None:
        """Opens an action log for reading; the log of a process that was killed can be read, too.

        Args:
            path: Path of the action log.

        Raises:
            ActionLogError: The file is not an action log, or cannot be read.
        """
        self._path = path
        try:
            with open_left(path) as file:
                if file.read(len(MAGIC)) != MAGIC:
                    raise ActionLogError(f"{path} is no log of actions")
                self.header = ActionLogHeader.model_validate_json(file.readline(_MOST_HEADER_BYTES))
                self._begin = file.tell()
        except OSError as error:
            raise ActionLogError(f"{path} cannot be read: {error}") from error
        except ValidationError as error:
            problem = error.errors()[0]
            where = ".".join(map(str, problem["loc"])) or "its header"
            raise ActionLogError(f"{path} is no log of actions: {where}: {problem['msg']}") from error

    def __iter__(self) -> Iterator[bytes]:
        """Yields the actions in order, each as bytes, up to the last whole chunk; a damaged end is left out."""
        with open_left(self._path) as file:
            file.seek(self._begin)
            number = 0
            while (chunk := _read_chunk(file, self.header.size, number)) is not None:
                yield from chunk
                number += len(chunk)

    def summary(self) -> ActionsSummary:
        """Counts the recorded actions and hashes the log file.

        Raises:
            OSError: The log cannot be read.
        """
        with open_left(self._path) as file:
            sha256, size_bytes = hashlib.file_digest(file, "sha256").hexdigest(), file.tell()
        actions = sum(1 for _ in self)
        return ActionsSummary(mode=self.header.mode, actions=actions, size_bytes=size_bytes, sha256=sha256)


class _Head(NamedTuple):
    kind: bytes
    actions: int
    length: int
    first: int
    checksum: int


def _checksum(count: int, first: int, content: bytes) -> int:
    return zlib.crc32(content, zlib.crc32(struct.pack("<IQ", count, first)))


def _read_chunk(file: BinaryIO, size: int, number: int) -> list[bytes] | None:
    """Reads the actions of the next chunk of an action log, which has to begin with action `number`.

    Returns `None` if no complete, undamaged chunk with that number follows.

    Args:
        file: The log, open at the beginning of a chunk.
        size: Length of an action in bytes.
        number: Number of the first action of the chunk.
    """
    packed = file.read(_CHUNK.size)
    if len(packed) < _CHUNK.size:
        return None
    head = _Head(*_CHUNK.unpack(packed))
    # Lengths are looked at before anything is read or unpacked: outputs may come from untrusted sources.
    if head.first != number or not _is_plausible(head, size):
        return None
    content = file.read(head.length)
    if len(content) < head.length or _checksum(head.actions, head.first, content) != head.checksum:
        return None
    return [content] if head.kind == PLAIN else _restored(content, head.actions, size)


def _is_plausible(head: _Head, size: int) -> bool:
    if head.kind == PLAIN:
        return (head.actions, head.length) == (1, size)
    is_short = head.length <= CHUNK_BYTES + _MOST_OVERHEAD_BYTES
    return head.kind == PACKED and is_short and head.actions <= CHUNK_ACTIONS and head.actions * size <= CHUNK_BYTES


def _restored(content: bytes, count: int, size: int) -> list[bytes] | None:
    """Decompresses the actions of a chunk of an action log; returns `None` if the chunk is damaged.

    Args:
        content: The compressed chunk.
        count: Number of its actions.
        size: Length of an action in bytes.
    """
    try:
        if zstandard.frame_content_size(content) != count * size:
            return None
        columns = np.frombuffer(zstandard.ZstdDecompressor().decompress(content), np.uint8).reshape(size, count)
    except zstandard.ZstdError:
        return None
    rows = np.ascontiguousarray(np.bitwise_xor.accumulate(columns, axis=1).T)
    return [row.tobytes() for row in rows]


_COMPRESSION_LEVEL = 3


class ActionLogWriter:
    """Writer of the actions that a robot program sends during a run, to be used by one thread.

    Actions survive a killed process, up to the last one that was added.
    """

    def __init__(self, path: Path, header: ActionLogHeader) -> None:
        """Creates the file of an action log, and writes its header.

        Args:
            path: Path of the log; an existing file is replaced.
            header: Mode of the robot, and arrays of its actions.

        Raises:
            OSError: The log cannot be written.
        """
        self._most = min(CHUNK_ACTIONS, max(1, CHUNK_BYTES // max(1, header.size)))
        self._compressor = zstandard.ZstdCompressor(level=_COMPRESSION_LEVEL)
        self._kept: list[bytes] = []
        """Actions that are in the file, but not yet compressed."""
        self._first = 0
        """Number of the first action in `_kept`."""
        self._settled = hashlib.sha256()
        """Hash of the part of the file that does not change any more."""
        self._header = header
        path.unlink(missing_ok=True)  # it may be a link that an application has left
        self._file: BinaryIO = path.open("xb", buffering=0)
        line = json.dumps(header.model_dump(exclude_none=True), separators=(",", ":"), allow_nan=False)
        beginning = MAGIC + line.encode() + b"\n"
        self._settled.update(beginning)
        self._end = self._chunk_begin = self._write(0, beginning)

    def add(self, action: bytes) -> None:
        """Appends the action of the next step.

        Raises:
            OSError: The log cannot be written.
        """
        number = self._first + len(self._kept)
        self._end = self._write(self._end, chunk_of(PLAIN, 1, number, action))
        self._kept.append(action)
        if len(self._kept) >= self._most:
            self._pack()

    def close(self) -> ActionsSummary:
        """Completes the log file, and returns a summary of its content.

        Raises:
            OSError: The log cannot be written.
        """
        try:
            self._pack()
        finally:
            self._file.close()
        return ActionsSummary(
            mode=self._header.mode, actions=self._first, size_bytes=self._end, sha256=self._settled.hexdigest()
        )

    def abandon(self) -> None:
        """Closes the log file without completing it, so that it looks like the log of a crashed process."""
        self._file.close()

    def _pack(self) -> None:
        """Replaces the uncompressed actions at the end of the log by one compressed chunk; a single action stays."""
        count = len(self._kept)
        if count == 1:
            self._settled.update(chunk_of(PLAIN, 1, self._first, self._kept[0]))
        elif count > 1:
            packed = self._compressor.compress(_differences(self._kept, self._header.size))
            chunk = chunk_of(PACKED, count, self._first, packed)
            self._settled.update(chunk)
            self._end = self._write(self._chunk_begin, chunk)
            self._file.truncate(self._end)
        self._chunk_begin = self._end
        self._first += count
        self._kept.clear()

    def _write(self, place: int, data: bytes) -> int:
        """Writes bytes at an offset of the file; returns the offset after them."""
        self._file.seek(place)
        write_all(self._file, data)
        return place + len(data)


class ActionRecorder:
    """Recorder of a robot's actions during a run; if the log cannot be written, the run goes on without it.

    A log that cannot be written completely is deleted, since a part could be taken for the whole log. The reason is
    written to the error log.
    """

    def __init__(self, path: Path, header: ActionLogHeader) -> None:
        """Creates the action log file of a run; see `ActionLogWriter`.

        If the file cannot be created, the run goes on without an action log, and `error` says why.
        """
        self._path = path
        self._writer: ActionLogWriter | None = None
        self.error: str | None = None
        """Reason why the run has no action log; None: it has one."""
        self.summary: ActionsSummary | None = None
        """Summary of the action log; absent until it is complete."""
        try:
            self._writer = ActionLogWriter(path, header)
        except OSError as error:
            self._give_up(error)

    def keep(self, action: bytes) -> None:
        """Records the robot's action in the next simulation step; after a failed write the run has no action log."""
        if self._writer is not None:
            try:
                self._writer.add(action)
            except OSError as error:
                self._writer.abandon()
                self._give_up(error)

    def close(self) -> None:
        """Completes the action log and sets its summary; it can then be replayed."""
        if self._writer is not None:
            try:
                self.summary = self._writer.close()
            except OSError as error:
                self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self._writer = None
        self.error = f"{type(error).__name__}: {error}"
        with suppress(OSError):
            self._path.unlink()
        with suppress(Exception):  # the application may have closed or replaced the stream
            sys.stderr.write(f"The robot's actions are not kept, so that the run cannot be repeated: {self.error}\n")


def _differences(actions: list[bytes], size: int) -> bytes:
    """Returns the bytes of actions by columns, as differences between successive actions, which compress better."""
    columns = np.frombuffer(b"".join(actions), np.uint8).reshape(len(actions), size).T.copy()
    columns[:, 1:] ^= columns[:, :-1].copy()
    return columns.tobytes()
