"""Writing the actions of a robot program (see `action_log`)."""

import hashlib
import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import numpy as np
import zstandard

from ....schemas.runs.provenance import ActionsSummary
from .action_log import CHUNK_ACTIONS, CHUNK_BYTES, MAGIC, PACKED, PLAIN, ActionLogHeader, chunk_of

_COMPRESSION_LEVEL = 3


class ActionLogWriter:
    """Writes the actions of one run; one thread may use it."""

    def __init__(self, path: Path, header: ActionLogHeader) -> None:
        """Begins a log.

        Args:
            path: The file; one that exists is replaced.
            header: What the actions are.

        Raises:
            OSError: It cannot be written.
        """
        self._most = min(CHUNK_ACTIONS, max(1, CHUNK_BYTES // max(1, header.size)))
        self._compressor = zstandard.ZstdCompressor(level=_COMPRESSION_LEVEL)
        self._kept: list[bytes] = []
        """Actions that are in the file, but not yet compressed."""
        self._first = 0
        """Number of the first of them."""
        self._settled = hashlib.sha256()
        """Digest of the part of the file that does not change any more."""
        self._header = header
        path.unlink(missing_ok=True)  # it may be a link that an application has left
        self._file: BinaryIO = path.open("xb", buffering=0)
        line = json.dumps(header.model_dump(exclude_none=True), separators=(",", ":"), allow_nan=False)
        beginning = MAGIC + line.encode() + b"\n"
        self._settled.update(beginning)
        self._end = self._chunk_begin = self._write(0, beginning)

    def add(self, action: bytes) -> None:
        """Adds the action of the next step.

        Raises:
            OSError: It cannot be written.
        """
        number = self._first + len(self._kept)
        self._end = self._write(self._end, chunk_of(PLAIN, 1, number, action))
        self._kept.append(action)
        if len(self._kept) >= self._most:
            self._pack()

    def close(self) -> ActionsSummary:
        """Completes the file; returns a summary of its content.

        Raises:
            OSError: It cannot be written.
        """
        try:
            self._pack()
        finally:
            self._file.close()
        return ActionsSummary(
            mode=self._header.mode, actions=self._first, size_bytes=self._end, sha256=self._settled.hexdigest()
        )

    def abandon(self) -> None:
        """Closes the file without completing it, as the death of the process would."""
        self._file.close()

    def _pack(self) -> None:
        """Replaces the actions at the end of the file by one compressed chunk; one alone stays as it is."""
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
        """Writes all of it, of which an almost full disk may take a part at a time; returns where it ends."""
        view = memoryview(data)
        while view:
            count = os.pwrite(self._file.fileno(), view, place)
            view, place = view[count:], place + count
        return place


class ActionRecorder:
    """Records the actions of a run; errors do not fail the run.

    A log that cannot be written fails no run: it is removed, since part of one would be taken for the whole, and the
    reason goes to the error log.
    """

    def __init__(self, path: Path, header: ActionLogHeader) -> None:
        """Begins a log; see `ActionLogWriter`."""
        self._path = path
        self._writer: ActionLogWriter | None = None
        self.error: str | None = None
        """Why there is no log; None: there is one."""
        self.summary: ActionsSummary | None = None
        """Summary of the log; absent until it is complete."""
        try:
            self._writer = ActionLogWriter(path, header)
        except OSError as error:
            self._give_up(error)

    def keep(self, action: bytes) -> None:
        """Keeps the action of the next step."""
        if self._writer is not None:
            try:
                self._writer.add(action)
            except OSError as error:
                self._writer.abandon()
                self._give_up(error)

    def close(self) -> None:
        """Completes the log."""
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
    """Columns of the actions' bytes, each byte as what changed of it since the action before."""
    columns = np.frombuffer(b"".join(actions), np.uint8).reshape(len(actions), size).T.copy()
    columns[:, 1:] ^= columns[:, :-1].copy()
    return columns.tobytes()
