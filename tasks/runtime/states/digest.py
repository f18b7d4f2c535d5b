"""Hash chain over a run's simulation states, by which two runs can be compared bit by bit.

Once a simulated second, the state that integration starts from (`mjSTATE_INTEGRATION`) is hashed together with the hash
before (a link): equal last links mean equal runs. `digest.bin` has the beginning of every link, and times, positions
and velocities at the same rate, so that the first difference can be found and its joint be named.
Of an environment without physics that gives bytes as its `state()`, those after each step are hashed, and none is kept.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import hashlib
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import zstandard
from numpy.typing import NDArray

from ....schemas.runs.provenance import JointPlace, StateDigestSummary

DIGEST_FILE = "digest.bin"
LOOK_EVERY_S = 1.0
"""Simulated seconds between two links of the hash chain: with 25 steps of a furnished flat in 50 ms, a link takes under
1 % of the time.
"""
STATE_EVERY_S = 1.0
"""Simulated seconds between two stored states."""

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_MAGIC = b"robomaker digest 1\n"
_BLOCK = struct.Struct("<IIII")
_BLOCK_STATES = 30
_BLOCK_LINKS = 3000
"""Number of links in a block of a run without physics (48 kB); with physics, stored states end blocks."""
_LINK_BYTES = 8
_CHAIN_BYTES = 32
_COMPRESSION_LEVEL = 3
_NOT_COUNTED = frozenset({"paths", "npaths", "nbuffer", "signature"})
"""Members of MuJoCo's model that are not hashed, as they tell where files were read from or how the model was compiled;
nor are the `…_pathadr`.
"""

_KEPT = ("_state_due_s", "_written_bytes", "_looks", "_last_s", "model_sha256", "joints", "positions")
"""Names of the attributes that checkpoints save."""


class StateDigest:
    """Builds the hash chain over a run's simulation states, and stores some states in `digest.bin`."""

    def __init__(self, path: Path | None, of_model: Callable[[mujoco.MjModel], str] | None = None) -> None:
        """Starts a hash chain; the file is created with the first state.

        Args:
            path: Path of the file; an existing one is replaced. None: only the hash is computed.
            of_model: Function that returns the hash of a model; absent: `digest_of_model`.
        """
        self._path = path
        self._of_model = of_model or digest_of_model
        self._model: mujoco.MjModel | None = None
        self._is_given = False
        self._buffer = np.zeros(_CHAIN_BYTES // 8)
        self._bytes = self._buffer.data.cast("B")
        self._values = self._buffer[:0]
        self._kept = 0
        self._links = bytearray()
        self._times: list[float] = []
        self._states: list[bytes] = []
        self._state_due_s = 0.0
        self._written_bytes = 0
        self._looks = 0
        self._last_s = 0.0
        self.model_sha256: str | None = None
        """Hash of the first model."""
        self.joints: list[JointPlace] = []
        """Joints of the first model."""
        self.positions = 0
        """Number of positions in the first model."""

    def look(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Adds the current state to the hash chain.

        Raises:
            OSError: The file cannot be written.
        """
        if model is not self._model:
            self._begin(model)
        mujoco.mj_getState(model, data, self._values, _STATE)
        link = hashlib.sha256(self._bytes).digest()
        self._bytes[:_CHAIN_BYTES] = link
        self._links += link[:_LINK_BYTES]
        time_s = self._last_s = data.time
        self._times.append(time_s)
        # Half a microsecond forgives rounding in sums of time steps.
        if self._path is not None and time_s >= self._state_due_s - 5e-7:
            self._keep_state(time_s)

    def look_at(self, state: bytes, time_s: float) -> None:
        """Adds a state that an environment without physics gives to the hash chain.

        Args:
            state: The state; all of it counts.
            time_s: Its simulated time.

        Raises:
            OSError: The file cannot be written.
        """
        if not self._is_given:
            self._is_given, self._kept = True, 1
            if self._path is not None:
                self._path.write_bytes(_MAGIC)
                self._written_bytes = len(_MAGIC)
        link = hashlib.sha256(bytes(self._bytes[:_CHAIN_BYTES]) + state).digest()
        self._bytes[:_CHAIN_BYTES] = link
        self._links += link[:_LINK_BYTES]
        self._last_s = time_s
        self._times.append(time_s)
        if len(self._times) >= _BLOCK_LINKS:
            self._write_block()

    def finish(self, data: mujoco.MjData | None = None) -> StateDigestSummary | None:
        """Adds the last state, completes the file, and returns the final digest.

        Args:
            data: Final state of the last model; None if the last call of `look` was at the end.

        Returns:
            The digest; None when there never was a state.
        """
        if self._model is None and not self._is_given:
            return None
        if self._model is not None:
            if data is not None and data.time != self._last_s:
                self.look(self._model, data)
            if self._path is not None:
                self._keep_state(self._last_s)
        self._write_block()
        value = self._bytes[:_CHAIN_BYTES].hex()
        return StateDigestSummary(looks=self._looks, until_s=self._last_s, value=value)

    def state(self) -> dict[str, Any]:
        """Writes pending hashes to the file, and returns the hash chain's state for a checkpoint."""
        self._write_block()
        return {"chain": bytes(self._bytes[:_CHAIN_BYTES]), **{name: getattr(self, name) for name in _KEPT}}

    def restore(self, state: dict[str, Any], model: mujoco.MjModel | None) -> None:
        """Continues the hash chain from a checkpoint; later content of the file is cut off.

        Args:
            state: Result of `state`.
            model: The run's model; None when there is no physics.

        Raises:
            OSError: The file is shorter than it was then, or cannot be written.
        """
        assert self._path is not None
        if self._path.stat().st_size < state["_written_bytes"]:
            raise OSError(f"{self._path} is shorter than it was at the checkpoint")
        os.truncate(self._path, state["_written_bytes"])
        self._links, self._times, self._states = bytearray(), [], []
        for name in _KEPT:
            setattr(self, name, state[name])
        if model is not None:
            self._attach(model)
        self._bytes[:_CHAIN_BYTES] = state["chain"]

    def _begin(self, model: mujoco.MjModel) -> None:
        """Starts the hash chain with a model, or continues it with another one that the environment has made.

        Writes the beginning of the digest's file, or the states of the model before.
        """
        model_sha256 = self._of_model(model)
        if self._model is None:
            self.model_sha256 = model_sha256
            if self._path is not None:
                self.joints, self.positions = joints_of(model), int(model.nq)
                self._path.write_bytes(_MAGIC)
                self._written_bytes = len(_MAGIC)
        else:
            self._write_block()
        before = bytes(self._bytes[:_CHAIN_BYTES])
        self._attach(model)
        self._bytes[:_CHAIN_BYTES] = hashlib.sha256(before + bytes.fromhex(model_sha256)).digest()

    def _attach(self, model: mujoco.MjModel) -> None:
        self._model = model
        # The link before and the state lie in one piece, so that one call hashes both.
        self._buffer = np.zeros(_CHAIN_BYTES // 8 + mujoco.mj_stateSize(model, _STATE))
        self._values = self._buffer[_CHAIN_BYTES // 8 :]
        self._bytes = self._buffer.data.cast("B")
        self._kept = 1 + model.nq + model.nv

    def _keep_state(self, time_s: float) -> None:
        """Stores time, positions and velocities, the first numbers of the state; writes full blocks to the file."""
        self._states.append(self._values[: self._kept].tobytes())
        self._state_due_s = time_s + STATE_EVERY_S
        if len(self._states) >= _BLOCK_STATES:
            self._write_block()

    def _write_block(self) -> None:
        if not self._times and not self._states:
            return
        if self._path is None:
            self._looks += len(self._times)
            self._links.clear()
            self._times.clear()
            return
        times = np.array(self._times).tobytes()
        # By number rather than by state: what does not move compresses to nothing.
        states = np.frombuffer(b"".join(self._states)).reshape(-1, self._kept).T.tobytes()
        payload = zstandard.ZstdCompressor(_COMPRESSION_LEVEL).compress(times + bytes(self._links) + states)
        block = _BLOCK.pack(len(payload), len(self._times), len(self._states), self._kept) + payload
        with self._path.open("ab") as file:
            file.write(block)
        self._written_bytes += len(block)
        self._looks += len(self._times)
        self._links.clear()
        self._times.clear()
        self._states.clear()


@dataclass(frozen=True)
class StateTimeline:
    """Content of `digest.bin`: links of the hash chain, and some states of a run with their times in seconds."""

    times_s: NDArray[np.float64]
    """Simulated times of the links, in seconds."""

    links: list[bytes]
    """First bytes of each link's hash."""

    states: list[NDArray[np.float64]]
    """Stored states: time, positions, velocities."""


def read_timeline(path: Path) -> StateTimeline:
    """Reads `digest.bin`, the hash chain of a run's states, up to the last complete block.

    Raises:
        FileNotFoundError: The file does not exist.
        ValueError: The file is not a `digest.bin`.
    """
    content = path.read_bytes()
    if not content.startswith(_MAGIC):
        raise ValueError(f"{path} is no digest of a run")
    times: list[NDArray[np.float64]] = [np.zeros(0)]
    links: list[bytes] = []
    states: list[NDArray[np.float64]] = []
    place = len(_MAGIC)
    while place + _BLOCK.size <= len(content):
        size, looks, kept, width = _BLOCK.unpack_from(content, place)
        place += _BLOCK.size
        if place + size > len(content):
            break  # the run was killed while it wrote this
        packed = content[place : place + size]
        try:  # before anything is unpacked: outputs may come from untrusted sources
            if zstandard.frame_content_size(packed) != looks * (8 + _LINK_BYTES) + 8 * kept * width:
                raise ValueError(f"{path} is damaged at byte {place}")
            payload = zstandard.ZstdDecompressor().decompress(packed)
        except zstandard.ZstdError as error:
            raise ValueError(f"{path} is damaged at byte {place}: {error}") from error
        place += size
        end = looks * (8 + _LINK_BYTES)
        times.append(np.frombuffer(payload, np.float64, looks))
        links += [payload[at : at + _LINK_BYTES] for at in range(looks * 8, end, _LINK_BYTES)]
        states += list(np.frombuffer(payload, np.float64, kept * width, end).reshape(width, kept).T)
    return StateTimeline(np.concatenate(times), links, states)


class ModelDigests:
    """Computes the hash of a MuJoCo model repeatedly, fast if nothing has changed."""

    def __init__(self) -> None:
        self._seen = b""
        self._digest = ""

    def of(self, model: mujoco.MjModel) -> str:
        """Returns the hash of a model as `digest_of_model` does, but a hundred times faster if it has not changed."""
        saved = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, saved)
        seen = hashlib.sha256(saved.data).digest()
        if seen != self._seen:
            self._seen, self._digest = seen, digest_of_model(model)
        return self._digest


def digest_of_model(model: mujoco.MjModel) -> str:
    """Computes the SHA-256 of a compiled MuJoCo model, independent of the paths of its files.

    The same world in another folder has the same hash.
    """
    digest = hashlib.sha256()
    _take_in(digest, model)
    return digest.hexdigest()


def _take_in(digest: "hashlib._Hash", structure: Any) -> None:
    """Adds the members of a MuJoCo structure, with their names, to a hash, nested structures included."""
    for name, label in _members(type(structure)):
        value = getattr(structure, name)
        digest.update(label)
        if isinstance(value, np.ndarray):
            digest.update(repr(value.shape).encode())
            digest.update(np.ascontiguousarray(value).reshape(-1).view(np.uint8).data)
        elif isinstance(value, bytes | int | float):
            digest.update(value if isinstance(value, bytes) else repr(value).encode())
        else:
            _take_in(digest, value)


@cache
def _members(kind: type) -> list[tuple[str, bytes]]:
    """Returns the members of a MuJoCo structure to hash, with the bytes that are hashed for their names."""
    names = [name for name in sorted(dir(kind)) if not name.startswith("_") and not name.endswith("_pathadr")]
    return [
        (name, name.encode() + b"=") for name in names if name not in _NOT_COUNTED and not callable(getattr(kind, name))
    ]


def joints_of(model: mujoco.MjModel) -> list[JointPlace]:
    """Lists a model's joints with the indices of their numbers in the state."""
    return [
        JointPlace(
            name=model.joint(joint).name or model.body(int(model.jnt_bodyid[joint])).name or f"joint_{joint}",
            qpos=int(model.jnt_qposadr[joint]),
            qvel=int(model.jnt_dofadr[joint]),
        )
        for joint in range(model.njnt)
    ]
