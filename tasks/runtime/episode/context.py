"""The context that factories of environments and agents get, and help for those that can be resumed."""

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
    """Raised by an environment's `step` when an action is wrong; the robot application is blamed."""


class RobotProgramError(ActionError):
    """Raised when the robot program or ROS nodes sent an invalid message, or did not answer."""


class ObservationError(ValueError):
    """Raised by an agent when the time step is wrong; the simulation application is blamed."""


@dataclass(frozen=True)
class SimulationContext:
    """Data that the factories of environments and agents receive: world, seed, variables and folders of the run."""

    plan: RunPlan
    """The run as requested: ids, seed, folders, limits."""

    rng: np.random.Generator
    """The run's random generator, made from the plan's seed; use this and nothing global."""

    world: World | None
    """The world bundle's description, when the job names a world."""

    world_dir: Path | None
    """The world bundle: `world.xml`, `map.yaml`, …; read-only."""

    data_dir: Path | None
    """The job's data sources, one folder each; read-only."""

    output_dir: Path
    """Files written here are stored with the job's outputs."""

    environment: Mapping[str, str]
    """The environment variables of the launch configurations."""

    recorder: Recorder
    """Recorder of ROS 2 messages."""


class KeepsAttributes:
    """Base class that saves and restores the attributes named in `KEPT`, for checkpoints."""

    KEPT: ClassVar[tuple[str, ...]] = ()

    def state(self) -> dict[str, Any]:
        """Returns the attributes named in `KEPT`, for a checkpoint."""
        return {name: getattr(self, name) for name in self.KEPT}

    def restore(self, state: dict[str, Any]) -> None:
        """Restores the attributes from a checkpoint."""
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
