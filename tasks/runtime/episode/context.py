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
    """An environment's `step` raises it when the action is wrong; the failure is the robot application's."""


class RobotProgramError(ActionError):
    """The robot's program or nodes sent something wrong, or did not answer."""


class ObservationError(ValueError):
    """An agent raises it when the time step is wrong; the failure is the simulation application's."""


@dataclass(frozen=True)
class SimulationContext:
    """Context that a factory gets: the run as requested, and its run environment."""

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
    """Keeps the attributes that are named in `KEPT`: what changes during a run and cannot be worked out again."""

    KEPT: ClassVar[tuple[str, ...]] = ()

    def state(self) -> dict[str, Any]:
        """Returns them."""
        return {name: getattr(self, name) for name in self.KEPT}

    def restore(self, state: dict[str, Any]) -> None:
        """Puts them back."""
        for name in self.KEPT:
            setattr(self, name, state[name])


class ResumableEnvironment(control.Environment):
    """dm_control's environment, if its task has `state()` and `restore(state)`."""

    def state(self) -> dict[str, Any]:
        """Returns the task's state, and how many steps there were."""
        return {"steps": self._step_count, "task": self._task.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Goes on from there."""
        self._step_count, self._reset_next_step = state["steps"], False
        self._task.restore(state["task"])
