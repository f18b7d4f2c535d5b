"""What the factories of a simulation run are given.

A simulation application is a function `make_environment(context) -> dm_env.Environment`; a robot
application is a function `make_agent(context, environment) -> Callable[[dm_env.TimeStep], action]`.
Both run in the job's own process and may use anything in the context.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...schemas.simulation_run import RunPlan
from ...schemas.world import World
from .columns import Series
from .messages import TransformStamped


class ActionError(ValueError):
    """What an environment's `step` raises when the action itself is wrong: the robot application is to blame."""


class ObservationError(ValueError):
    """What an agent raises when the time step itself is wrong: the simulation application is to blame."""


class Recorder(Protocol):
    """Takes ROS 2 messages; does nothing when recording is off."""

    enabled: bool
    """Whether anything is written; producers skip making messages when it is not."""

    def write(self, topic: str, message: Any, time_s: float) -> None:
        """Records a message of `prefect_robomaker.tasks.runtime.messages` at a simulated time."""
        ...

    def add_static_transforms(self, transforms: Sequence[TransformStamped], time_s: float) -> None:
        """Records where frames are that do not move, on `/tf_static`, with all that were recorded before."""
        ...

    def add_series(self, series: Series) -> None:
        """Records what a series of messages gathers, from now on."""
        ...

    def remove_series(self, series: Series) -> None:
        """Writes what a series has gathered and forgets it."""
        ...

    def flush_when_due(self, full: bool = False) -> None:
        """Writes what has gathered if it is time, or if a series is full."""
        ...


@dataclass(frozen=True)
class SimulationContext:
    """One run's surroundings."""

    plan: RunPlan
    """The run as ordered: ids, seed, folders, limits."""

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
    """Where ROS 2 messages go."""
