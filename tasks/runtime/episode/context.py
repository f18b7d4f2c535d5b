"""Context of a simulation run, as the factories of applications get it.

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
    """An environment's `step` raises it when the action is wrong; the failure is the robot application's."""


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
