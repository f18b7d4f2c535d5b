"""Context object that the factories of environments and agents get, and base classes for checkpoints."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from dm_control.rl import control

from ....schemas.runs.plan import RunPlan
from ....schemas.worlds.world import World
from ..recording.recording import Recorder


class ActionError(ValueError):
    """Raised by an environment's `step` when an action is invalid; the robot application is blamed."""


class RobotProgramError(ActionError):
    """Raised when the robot program or ROS nodes sent an invalid message, or did not answer."""


class ObservationError(ValueError):
    """Raised by an agent when a time step is invalid; the simulation application is blamed."""


@dataclass(frozen=True)
class SimulationContext:
    """Data that the factories of environments and agents receive: world, seed, variables and folders of the run."""

    plan: RunPlan
    """The run as requested: ids, seed, folders, limits."""

    rng: np.random.Generator
    """Random generator of the run, seeded by the plan; use this one and no global generator."""

    world: World | None
    """Description of the world bundle; None if the job names no world."""

    world_dir: Path | None
    """Folder of the world bundle (`world.xml`, `map.yaml`, …), read-only."""

    data_dir: Path | None
    """Folder of the job's data sources, with one subfolder each; read-only."""

    output_dir: Path
    """Folder whose files are stored with the job's outputs."""

    environment: Mapping[str, str]
    """Environment variables of the launch configurations."""

    recorder: Recorder
    """Recorder of ROS 2 messages."""


class KeepsAttributes:
    """Base class that saves and restores the attributes named in `KEPT`, for checkpoints."""

    KEPT: ClassVar[tuple[str, ...]] = ()

    def state(self) -> dict[str, Any]:
        """Returns the attributes named in `KEPT`, for a checkpoint."""
        return {name: getattr(self, name) for name in self.KEPT}

    def restore(self, state: dict[str, Any]) -> None:
        """Restores the attributes named in `KEPT` from a checkpoint."""
        for name in self.KEPT:
            setattr(self, name, state[name])


class ResumableEnvironment(control.Environment):
    """dm_control environment that can be checkpointed, if its task has `state()` and `restore(state)`."""

    def state(self) -> dict[str, Any]:
        """Returns the task's state and the number of steps, for a checkpoint."""
        return {"steps": self._step_count, "task": self._task.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Restores the task's state and the number of steps from a checkpoint."""
        self._step_count, self._reset_next_step = state["steps"], False
        self._task.restore(state["task"])
