"""Log of a run's simulation states for rendering videos: written during the run, readable after a kill."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import itertools
import json
import math
import mmap
import os
import struct
import sys
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import mujoco
import numpy as np
import zstandard
from numpy.typing import NDArray

from ...files.untrusted_files import write_all
from ..episode.physics import raw_physics
from ..episode.run_results import Findings, Observer

ABOUT_FILE = "about.json"
STATES_FILE = "states.log"
TAIL_FILE = "states.tail"
CHUNK_FRAMES = 64

MAGIC = b"RMSL"
CHUNK = struct.Struct("<4s6I")
"""Header of a chunk of the state log.

Magic, number of the model, `nq`, `nmocap`, frames, length of the compressed columns, CRC-32 of all but the magic.
"""
TAIL = struct.Struct("<4s5IQ")
"""Header of the tail file: magic, number of the model, `nq`, `nmocap`, number of valid frames, reserved, number of
frames before these.
"""
TAIL_FRAMES, TAIL_BEFORE = 16, 24

Rows = NDArray[np.float64]
"""Array with a state per row."""


class StateLogError(ValueError):
    """Raised when a state log cannot be read; the message says where and why."""


@dataclass(frozen=True)
class Segment:
    """States of one MuJoCo model in a state log."""

    model_path: Path
    """Path of the compiled model (MJB)."""

    times: Rows
    """Simulated times in seconds since the run began, ascending."""

    qpos: Rows
    """Positions, shape (frames, nq), in MuJoCo's order."""

    mocap: Rows
    """Poses of mocap bodies, shape (frames, 7 nmocap): all positions, then all orientations."""

    def set_state(self, data: mujoco.MjData, index: int) -> None:
        """Copies a logged state into MuJoCo data; derived quantities have to be recomputed."""
        data.time = self.times[index]
        data.qpos[:] = self.qpos[index]
        if self.mocap.shape[1]:
            positions = 3 * len(data.mocap_pos)
            data.mocap_pos.ravel()[:] = self.mocap[index, :positions]
            data.mocap_quat.ravel()[:] = self.mocap[index, positions:]


@dataclass(frozen=True)
class StateLog:
    """Reader of a state log, from which videos are rendered after a run."""

    rate_hz: float
    """Intended number of states per simulated second."""

    camera: str | None
    """Name of the environment's `video_camera`."""

    segments: list[Segment]
    """Segments in order; more than one if the environment changed its model, none if no state was logged."""

    @property
    def frames(self) -> int:
        """Number of simulation states in the log."""
        return sum(len(segment.times) for segment in self.segments)

    @property
    def end_s(self) -> float:
        """Simulated time of the last state in seconds; 0 if there is none."""
        return float(self.segments[-1].times[-1]) if self.segments else 0.0

    @classmethod
    def open(cls, folder: Path) -> "StateLog":
        """Reads a state log, also of a process that was killed.

        States after a damaged chunk are left out.

        Raises:
            StateLogError: The folder has no readable state log.
        """
        try:
            about = json.loads((folder / ABOUT_FILE).read_bytes())
            rate_hz, camera = float(about["rate_hz"]), about["camera"]
            chunks = [*_chunks((folder / STATES_FILE).read_bytes())]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise StateLogError(f"{folder}: not a log of states: {error}") from error
        tail = _tail(folder / TAIL_FILE, sum(len(chunk.rows) for chunk in chunks))
        return cls(rate_hz, camera, [*_segments(folder, chunks if tail is None else [*chunks, tail])])


def model_file(number: int) -> str:
    """Returns the file name of a logged model, numbered from 1."""
    return f"model-{number}.mjb"


@dataclass(frozen=True)
class _Chunk:
    """Consecutive states of one model in a state log, a row each."""

    model: int
    nq: int
    rows: Rows


def _segments(folder: Path, chunks: list[_Chunk]) -> Iterator[Segment]:
    for number in sorted({chunk.model for chunk in chunks}):
        of_model = [chunk for chunk in chunks if chunk.model == number]
        end = 1 + of_model[0].nq
        rows = np.concatenate([chunk.rows for chunk in of_model])
        yield Segment(folder / model_file(number), rows[:, 0], rows[:, 1:end], rows[:, end:])


def columns_of(nq: int, nmocap: int) -> int:
    """Returns the number of values in a logged state."""
    return 1 + nq + 7 * nmocap


def checksum(members: Sequence[int], packed: bytes) -> int:
    """Computes the CRC-32 of a chunk of the state log."""
    return zlib.crc32(packed, zlib.crc32(struct.pack("<5I", *members)))


def _restored(data: bytes, frames: int) -> Rows:
    bits = np.frombuffer(data, np.uint64).reshape(-1, frames)
    return np.ascontiguousarray(np.bitwise_xor.accumulate(bits, axis=1).view(np.float64).T)


def _chunks(data: bytes) -> Iterator[_Chunk]:
    """Yields the complete, undamaged chunks at the beginning of a state log, and stops at the first other one."""
    place = 0
    decompressor = zstandard.ZstdDecompressor()
    while place + CHUNK.size <= len(data):
        magic, *members, expected = CHUNK.unpack_from(data, place)
        model, nq, nmocap, frames, length = members
        packed = data[place + CHUNK.size : place + CHUNK.size + length]
        if magic != MAGIC or len(packed) < length or checksum(members, packed) != expected:
            return
        size = 8 * columns_of(nq, nmocap) * frames
        try:  # the size is looked at before it is unpacked: a damaged chunk may have the right checksum
            if not 0 < frames <= CHUNK_FRAMES or zstandard.frame_content_size(packed) != size:
                return
            columns = decompressor.decompress(packed)
        except zstandard.ZstdError:
            return
        yield _Chunk(model, nq, _restored(columns, frames))
        place += CHUNK.size + length


def _tail(path: Path, noted: int) -> _Chunk | None:
    """Reads the last states of a state log, which had not been written as a chunk yet.

    Returns `None` if there are none, or the file is damaged.

    Args:
        path: File of the last states.
        noted: Number of states in complete chunks.
    """
    try:
        data = path.read_bytes()
        magic, model, nq, nmocap, frames, _, before = TAIL.unpack_from(data)
    except (OSError, struct.error):
        return None
    first = noted - before  # all of them may have become a chunk just before the process was killed
    size = 8 * columns_of(nq, nmocap) * frames
    if magic != MAGIC or not 0 <= first < frames <= CHUNK_FRAMES or len(data) < TAIL.size + size:
        return None
    rows = np.frombuffer(data, np.float64, size // 8, TAIL.size).reshape(frames, -1)
    return _Chunk(model, nq, rows[first:].copy())


_COMPRESSION_LEVEL = 1


class StateLogWriter:
    """Writer of a run's state log; logged states survive a killed process."""

    def __init__(self, folder: Path, rate_hz: float, camera: str | None = None) -> None:
        """Begins a state log in a folder, in which an earlier log is overwritten.

        Args:
            folder: Folder of the log; it is created if missing.
            rate_hz: Intended number of states per simulated second.
            camera: Name of the environment's `video_camera`.

        Raises:
            OSError: The folder cannot be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self.frames = 0
        self._folder = folder
        self._model: mujoco.MjModel | None = None
        self._data: mujoco.MjData | None = None
        self._parts: list[tuple[slice, Rows]] = []
        self._models = 0
        self._in_tail = 0
        self._tail: mmap.mmap | None = None
        self._compressor = zstandard.ZstdCompressor(level=_COMPRESSION_LEVEL)
        (folder / ABOUT_FILE).write_text(json.dumps({"version": 1, "rate_hz": rate_hz, "camera": camera}))
        self._log: BinaryIO = (folder / STATES_FILE).open("wb", buffering=0)

    def note(self, model: mujoco.MjModel, data: mujoco.MjData, time_s: float) -> None:
        """Adds the present state of a simulation to the state log.

        Args:
            model: Compiled model; stored the first time, and when it has changed.
            data: State to log.
            time_s: Simulated time since the run began.

        Raises:
            OSError: The log cannot be written, or the disk is full.
        """
        if model is not self._model or data is not self._data:
            self._begin(model, data)
        row = self._rows[self._in_tail]
        row[0] = time_s
        for columns, values in self._parts:
            row[columns] = values
        self._noted()

    def _noted(self) -> None:
        self._in_tail += 1
        self.frames += 1
        self._counter[0] = self._in_tail  # last, so that only whole rows count
        if self._in_tail == CHUNK_FRAMES:
            self._flush()

    def take_over(self, model: mujoco.MjModel, data: mujoco.MjData, rows: Rows) -> None:
        """Logs states from an earlier log, as rows of time, `qpos`, `mocap_pos` and `mocap_quat`.

        Raises:
            ValueError: The states are of another model.
            OSError: The log cannot be written.
        """
        self._begin(model, data)
        for row in rows:
            self._rows[self._in_tail] = row
            self._noted()

    def close(self) -> None:
        """Writes the last states to the state log, closes it, and deletes the file with its unfinished end."""
        self._flush()
        self._log.close()
        (self._folder / TAIL_FILE).unlink(missing_ok=True)

    def _begin(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if model is not self._model:
            self._begin_model(model)
        self._data = data
        # Views into the state, because making them takes as long as copying from them.
        parts = [data.qpos, data.mocap_pos.ravel(), data.mocap_quat.ravel()]
        ends = np.cumsum([1, *map(len, parts)]).tolist()
        spans = [slice(*pair) for pair in itertools.pairwise(ends)]
        self._parts = [(span, part) for span, part in zip(spans, parts, strict=True) if len(part)]

    def _begin_model(self, model: mujoco.MjModel) -> None:
        self._flush()
        self._model = model
        self._models += 1
        mujoco.mj_saveModel(model, str(self._folder / model_file(self._models)))
        columns = columns_of(model.nq, model.nmocap)
        size = TAIL.size + 8 * columns * CHUNK_FRAMES
        path = self._folder / TAIL_FILE
        path.unlink(missing_ok=True)
        with path.open("w+b") as file:
            # A full disk has to show here: a write into mapped memory would end the process.
            os.posix_fallocate(file.fileno(), 0, size)
            tail = mmap.mmap(file.fileno(), size)
        tail[: TAIL.size] = TAIL.pack(MAGIC, self._models, model.nq, model.nmocap, 0, 0, self.frames)
        self._rows: Rows = np.frombuffer(tail, np.float64, offset=TAIL.size).reshape(CHUNK_FRAMES, columns)
        self._counter = np.frombuffer(tail, np.uint32, 1, offset=TAIL_FRAMES)
        self._base = np.frombuffer(tail, np.uint64, 1, offset=TAIL_BEFORE)

    def _flush(self) -> None:
        model = self._model
        if model is None or not self._in_tail:
            return
        packed = self._compressor.compress(_differences(self._rows[: self._in_tail]))
        members = self._models, model.nq, model.nmocap, self._in_tail, len(packed)
        header = CHUNK.pack(MAGIC, *members, checksum(members, packed))
        write_all(self._log, header + packed)
        # A reader that comes in between sees these states twice, and drops what it has by the number before them.
        self._counter[0] = 0
        self._base[0] = self.frames
        self._in_tail = 0


class StateLogger(Observer):
    """Observer that logs the simulation states at a video's frame rate, to render videos later.

    If the log cannot be written, the run does not fail: the reason is written to the error log, and as
    `state_log_error` to the result.
    """

    def __init__(self, folder: Path, rate_hz: int) -> None:
        """Prepares to log a run's states; nothing is written before the first state.

        Args:
            folder: Folder of the log.
            rate_hz: States per simulated second.
        """
        self._folder, self._rate_hz = folder, rate_hz
        self._writer: StateLogWriter | None = None
        self._error: str | None = None

    def watch(self, environment: Any, time_s: float) -> None:
        """Writes the environment's current simulation state to the state log.

        After an error, which is noted, the run goes on without a state log.
        """
        try:
            if self._writer is None:
                camera = getattr(environment, "video_camera", None)
                self._writer = StateLogWriter(self._folder, self._rate_hz, camera)
            model, data = raw_physics(environment.physics)
            self._writer.note(model, data, time_s)
            self.next_time_s = (math.floor(time_s * self._rate_hz + 1e-5) + 1) / self._rate_hz
        except Exception as error:
            self._give_up(error)

    def close(self, ended_by: str | None) -> Findings:
        """Finishes the state log; returns the reason if it could not be written, and no findings otherwise."""
        del ended_by
        try:
            if self._writer is not None and self._error is None:
                self._writer.close()
        except OSError as error:
            self._give_up(error)
        return Findings({"state_log_error": self._error} if self._error else {})

    def restore(self, state: float, environment: Any) -> None:
        """Continues the state log of a killed process at an earlier time, without the states from then on.

        If the log cannot be continued, it begins anew, and a line on standard error says so.

        Args:
            state: Time in simulated seconds at which the run continues.
            environment: The environment.
        """
        super().restore(state, environment)
        try:
            if not self._folder.exists():
                return
            [segment] = StateLog.open(self._folder).segments
            rows = np.column_stack([segment.times, segment.qpos, segment.mocap])
            self._writer = StateLogWriter(self._folder, self._rate_hz, getattr(environment, "video_camera", None))
            self._writer.take_over(*raw_physics(environment.physics), rows[segment.times < state - 1e-6])
        except (OSError, ValueError) as error:  # it had several models, or another
            sys.stderr.write(f"The video of a failure will begin at {state:.3f} s: {error}\n")
            self._writer = None

    def _give_up(self, error: Exception) -> None:
        self.next_time_s = math.inf
        self._error = f"{type(error).__name__}: {error}"
        sys.stderr.write(f"No more states are noted for a video: {self._error}.\n")


def _differences(rows: Rows) -> bytes:
    """Returns the bytes of states by columns, as differences between successive frames, which compress better."""
    bits = rows.T.copy().view(np.uint64)
    bits[:, 1:] ^= bits[:, :-1].copy()
    return bits.tobytes()
