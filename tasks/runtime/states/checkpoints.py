"""Checkpoints of a run: everything its future depends on, so that a resumed run is bit-identical."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import os
import pickle
import random
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import mujoco
import numpy as np

from ....schemas.runs.plan import RunPlan
from ...files.untrusted_files import write_anew
from ..episode.physics import raw_physics
from ..episode.progress import program_in_words
from ..episode.run_results import Observer
from .checkpoint_files import (
    REASON_FILE,
    CheckpointError,
    begin_checkpoints,
    last_checkpoint,
    number_of,
    payload_of,
    write_checkpoint,
)
from .digest import digest_of_model

_MOST_MODELS = 3
"""Maximum number of models in separate files; environments that change models more often store the model in each
checkpoint.
"""


class KeptPhysics:
    """Serialises MuJoCo's data without the model, which is large and is written to a file once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._common = b""
        self._name = ""
        self._models = 0

    def kept(self, data: mujoco.MjData) -> tuple[str, bytes]:
        """Returns the name of the model's file, and the bytes of the data that the file does not contain.

        A new model is written to a file first; if there are too many, the name is empty, and all bytes are returned.
        """
        whole = data.__getstate__()
        if not (self._common and whole.startswith(self._common)) and self._models < _MOST_MODELS:
            self._keep_model(data.model, whole)
        if not whole.startswith(self._common):
            return "", whole
        return self._name, whole[len(self._common) :]

    def read(self, name: str, rest: bytes) -> mujoco.MjData:
        """Restores and returns the MuJoCo data that `kept` serialised.

        Raises:
            CheckpointError: The file with the model is missing or incomplete.
        """
        common = b""
        if name:
            try:
                common = (self._folder / name).read_bytes()
            except OSError as error:
                raise CheckpointError(f"its model cannot be read: {error}") from error
            if name != _model_file(common):
                raise CheckpointError(f"{self._folder / name} is not whole")
        data = mujoco.MjData.__new__(mujoco.MjData)
        data.__setstate__(common + rest)
        return data

    def _keep_model(self, model: mujoco.MjModel, whole: bytes) -> None:
        self._models += 1
        content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        place = whole.find(content.tobytes())
        self._common = whole[: place + len(content)] if place >= 0 else b""
        self._name = _model_file(self._common) if self._common else ""
        if self._name:
            write_anew(self._folder / self._name, self._common)


def _model_file(content: bytes) -> str:
    # Guards against truncated files, not against attacks; and the first checkpoint should be quick.
    return f"model-{len(content)}-{zlib.crc32(content):08x}.bin"


def copy_physics(kept: mujoco.MjData, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Copies restored MuJoCo data into a newly made environment.

    Raises:
        CheckpointError: The environment made another model.
    """
    if digest_of_model(kept.model) != digest_of_model(model):
        raise CheckpointError("the environment built another model than it had then")
    mujoco.mj_copyData(data, model, kept)


COST_SHARE = 0.01
"""Maximum share of the run's time that goes into checkpoints; if one takes longer, they become rarer."""

_WORTH_KEEPING = 0.1
"""Share of the checkpoint interval; a run that has lasted less wall-clock time is not worth a checkpoint."""


@runtime_checkable
class Resumable(Protocol):
    """Interface of environments and agents whose runs can be resumed from a checkpoint."""

    def state(self) -> Any:
        """Returns everything that has changed since the object was made and matters later; it must be picklable."""
        ...

    def restore(self, state: Any) -> None:
        """Restores the object from `state`, in a new process after `reset`; the physics is restored already."""
        ...


@dataclass(frozen=True)
class RunParts:
    """Parts of a run that a checkpoint saves: environment, agent, observers, recorder."""

    environment: Any
    agent: Any
    watchers: Sequence[Observer]
    recorder: Any


@dataclass(frozen=True)
class LoopState:
    """State of a run's loop between two steps, for a checkpoint."""

    timestep: Any
    steps: int
    time_s: float
    """Simulated time in seconds."""
    wall_time_s: float
    """Wall-clock time of the steps in seconds."""


class Checkpointer:
    """Writes the checkpoints of one run, and resumes from the last one.

    It is used only by the run's process, which holds the folder's lock.
    """

    def __init__(
        self,
        plan: RunPlan,
        rng: np.random.Generator,
    ) -> None:
        """Locks a run's checkpoint folder for this process, and looks for the last checkpoint.

        Args:
            plan: Plan of the run, with a `checkpoint_dir`.
            rng: Random generator of the run.

        Raises:
            CheckpointError: Another process already continues the run.
            OSError: The folder cannot be written.
        """
        assert plan.checkpoint_dir is not None
        self._folder = plan.checkpoint_dir
        self._rng = rng
        self._plan = plan
        self._began = time.perf_counter()
        self._number = 0
        self._used_s = 0.0
        self._every_s = plan.checkpoint_every_s
        self._next_time_s = self._every_s if self._every_s is not None else float("inf")
        # What took less than this is done again as soon as it is read back: half a second for the usual interval.
        self._not_before = self._began + _WORTH_KEEPING * (self._every_s or 0.0)
        self._lock = begin_checkpoints(self._folder, plan)
        self._physics = KeptPhysics(self._folder)
        self._resumed = last_checkpoint(self._folder)

    @property
    def resumes(self) -> bool:
        """Whether there is a checkpoint to resume from."""
        return self._resumed is not None

    def begin(self, parts: RunParts) -> None:
        """Checks that all parts of the run support checkpoints; otherwise none is written, and a file says why."""
        programs = [
            f"{program_in_words(program, self._plan)} is a program of its own, whose state cannot be restored"
            for program in self._plan.programs
        ]
        if reasons := programs or _why_not_resumable(parts):
            self.give_up("; ".join(reasons))

    def give_up(self, reason: str) -> None:
        """Stops writing checkpoints for the rest of the run, and writes the reason to a file."""
        self._next_time_s = float("inf")
        write_anew(self._folder / REASON_FILE, reason.encode())

    def due(self, time_s: float) -> bool:
        """Returns whether it is time for a checkpoint at a simulated time."""
        # Half a microsecond forgives rounding in sums of time steps.
        return time_s >= self._next_time_s - 5e-7 and time.perf_counter() >= self._not_before

    def save(self, parts: RunParts, loop: LoopState) -> None:
        """Writes a checkpoint, and deletes all older ones except the last.

        If an object cannot be pickled, or its `state()` fails, no more checkpoints are made, and the run continues.

        Raises:
            OSError: The folder is full or cannot be written.
        """
        assert self._every_s is not None
        began = time.perf_counter()
        self._next_time_s = loop.time_s + self._every_s
        try:
            payload = self._payload(parts, loop)
        except OSError:
            raise
        except Exception as error:  # of the applications' own code
            self.give_up(f"its state cannot be kept: {type(error).__name__}: {error}")
            return
        self._number += 1
        wall_time_s = self._used_s + time.perf_counter() - self._began
        write_checkpoint(
            self._folder, self._number, payload, sim_time_s=loop.time_s, steps=loop.steps, wall_time_s=wall_time_s
        )
        now = time.perf_counter()
        self._not_before = now + (now - began) * (1 / COST_SHARE - 1)

    def resume(self, parts: RunParts) -> LoopState:
        """Restores all parts of the run from the last checkpoint.

        Args:
            parts: Newly made parts; the environment has been reset.

        Returns:
            State of the simulation loop at the checkpoint.

        Raises:
            CheckpointError: A part of the run cannot be restored.
        """
        assert self._resumed is not None
        path, header = self._resumed
        try:
            kept = pickle.loads(payload_of(path, header))  # noqa: S301 - written by this run
            self._restore(kept, parts)
        except CheckpointError:
            raise
        except Exception as error:  # of applications whose code has changed, for one
            raise CheckpointError(f"{type(error).__name__}: {error}") from error
        self._number = number_of(path)
        self._used_s = header.wall_time_s
        self._next_time_s = header.sim_time_s + (self._every_s or float("inf"))
        return kept["loop"]

    def close(self) -> None:
        """Releases the lock on the checkpoint folder, so that another process may continue the run."""
        os.close(self._lock)

    def _payload(self, parts: RunParts, loop: LoopState) -> bytes:
        _, data = raw_physics(parts.environment.physics)
        return pickle.dumps(
            {
                # All of it, not only what integration starts from: sensors and contacts are of the last step too.
                "data": self._physics.kept(data),
                "rng": self._rng.bit_generator.state,
                "python_random": random.getstate(),
                "numpy_random": np.random.get_state(),  # noqa: NPY002 - applications may use it
                "environment": parts.environment.state(),
                "agent": parts.agent.state(),
                "watchers": [(type(watcher).__name__, watcher.state()) for watcher in parts.watchers],
                "recorder": parts.recorder.state(),
                "loop": loop,
            },
            protocol=5,
        )

    def _restore(self, kept: dict[str, Any], parts: RunParts) -> None:
        environment, watchers = parts.environment, parts.watchers
        model, data = raw_physics(environment.physics)
        copy_physics(self._physics.read(*kept["data"]), model, data)
        environment.restore(kept["environment"])
        parts.agent.restore(kept["agent"])
        names = [type(watcher).__name__ for watcher in watchers]
        if names != [name for name, _ in kept["watchers"]]:
            raise CheckpointError(f"it was watched by {[name for name, _ in kept['watchers']]}, and is by {names}")
        parts.recorder.restore(kept["recorder"])
        for watcher, (_, state) in zip(watchers, kept["watchers"], strict=True):
            watcher.restore(state, environment)
        # Last, since making and restoring may have drawn numbers.
        self._rng.bit_generator.state = kept["rng"]
        random.setstate(kept["python_random"])
        np.random.set_state(kept["numpy_random"])  # noqa: NPY002


def _why_not_resumable(parts: RunParts) -> list[str]:
    """Lists the reasons why a run with these parts cannot be resumed; empty if it can."""
    reasons = [
        f"the {role} ({type(part).__name__}) has no state() and restore()"
        for role, part in (("environment", parts.environment), ("agent", parts.agent))
        if not isinstance(part, Resumable)
    ]
    if not hasattr(getattr(parts.environment, "physics", None), "data"):
        reasons.append("the environment has no physics")
    return reasons
