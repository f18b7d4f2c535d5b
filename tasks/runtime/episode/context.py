"""What the factories of a simulation run are given.

A simulation application is a function `make_environment(context) -> dm_env.Environment`; a robot
application is a function `make_agent(context, environment) -> Callable[[dm_env.TimeStep], action]`.
Both run in the job's own process and may use anything in the context.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ....schemas.runs.plan import RunPlan
from ....schemas.worlds.world import World
from ..recording.recorder import Recorder


class ActionError(ValueError):
    """What an environment's `step` raises when the action itself is wrong: the robot application is to blame."""


class ObservationError(ValueError):
    """What an agent raises when the time step itself is wrong: the simulation application is to blame."""


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
