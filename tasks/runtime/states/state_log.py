"""The compact log of a run's states, from which its video can be rendered afterwards.

A log is a folder. `states.log` has all but the last few states, `states.tail` the last ones, `model-1.mjb` the
compiled model (`model-2.mjb` the next, where an environment changes it).

`states.log` is a sequence of chunks: a header (`CHUNK`), then the compressed columns. A column is one number of the
state over the frames of the chunk, as 64-bit differences (exclusive or) to the frame before, so that all that rests
costs next to nothing. Columns are time, `qpos`, `mocap_pos`, `mocap_quat`.

`states.tail` is a page of memory that is also a file: a state is safe as soon as it is noted, however the process
ends, without a call of the operating system.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import json
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import zstandard
from numpy.typing import NDArray

ABOUT_FILE = "about.json"
STATES_FILE = "states.log"
TAIL_FILE = "states.tail"
CHUNK_FRAMES = 64

MAGIC = b"RMSL"
CHUNK = struct.Struct("<4s6I")
"""Magic, number of the model, `nq`, `nmocap`, frames, length of the compressed columns, CRC-32 of all but
the magic."""
TAIL = struct.Struct("<4s5IQ")
"""Magic, number of the model, `nq`, `nmocap`, frames that are valid, nothing, frames before these."""
TAIL_FRAMES, TAIL_BEFORE = 16, 24

Rows = NDArray[np.float64]
"""A state per row."""


class StateLogError(ValueError):
    """A log that cannot be read; says where and why."""


@dataclass(frozen=True)
class Segment:
    """States of one model."""

    model_path: Path
    """The compiled model, as MJB."""

    times: Rows
    """Simulated seconds since the run began, ascending."""

    qpos: Rows
    """Frames x nq, as MuJoCo orders it."""

    mocap: Rows
    """Frames x 7 nmocap: all positions, then all orientations."""

    def set_state(self, data: mujoco.MjData, index: int) -> None:
        """Puts a state into `data`; what follows from it is to be worked out by the caller."""
        data.time = self.times[index]
        data.qpos[:] = self.qpos[index]
        if self.mocap.shape[1]:
            positions = 3 * len(data.mocap_pos)
            data.mocap_pos.ravel()[:] = self.mocap[index, :positions]
            data.mocap_quat.ravel()[:] = self.mocap[index, positions:]


@dataclass(frozen=True)
class StateLog:
    """A log that was read."""

    rate_hz: float
    """States per simulated second that were meant to be noted."""

    camera: str | None
    """The environment's `video_camera`."""

    segments: list[Segment]
    """Segments in order; more than one where an environment changed its model. Empty when nothing was noted."""

    @property
    def frames(self) -> int:
        """States in all."""
        return sum(len(segment.times) for segment in self.segments)

    @property
    def end_s(self) -> float:
        """Simulated time of the last state; 0 when there is none."""
        return float(self.segments[-1].times[-1]) if self.segments else 0.0

    @classmethod
    def open(cls, folder: Path) -> "StateLog":
        """Reads a whole log, also of a process that was killed.

        What follows a damaged chunk is left out.

        Raises:
            StateLogError: There is no log.
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
    """Returns the name of the file of a model, the first being 1."""
    return f"model-{number}.mjb"


@dataclass(frozen=True)
class _Chunk:
    """Consecutive states of one model."""

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
    """Returns how many numbers a noted state has."""
    return 1 + nq + 7 * nmocap


def checksum(members: Sequence[int], packed: bytes) -> int:
    """Returns the CRC-32 of a chunk's numbers and columns."""
    return zlib.crc32(packed, zlib.crc32(struct.pack("<5I", *members)))


def _restored(data: bytes, frames: int) -> Rows:
    bits = np.frombuffer(data, np.uint64).reshape(-1, frames)
    return np.ascontiguousarray(np.bitwise_xor.accumulate(bits, axis=1).view(np.float64).T)


def _chunks(data: bytes) -> Iterator[_Chunk]:
    """The whole chunks at the beginning of a log."""
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
    """The states that had not yet become a chunk."""
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
