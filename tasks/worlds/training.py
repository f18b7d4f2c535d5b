"""Gymnasium environments for training policies in worlds of the catalog or in folders."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..service.service import Service
from ..simulations.inputs.bundles import world_bundle

if TYPE_CHECKING:
    from ..runtime.policies.gymnasium_env import RobotEnv


def robot_env(
    world: str | Path,
    robot: str | Path = "scout",
    *,
    time_limit_s: float | None = None,
    variables: Mapping[str, str] | None = None,
) -> "RobotEnv":
    """Makes the Gymnasium environment of a robot in a world, identical to a simulation job's, for training.

    Args:
        world: ARN of a world, or the folder of its bundle.
        robot: `scout`, `walker`, `menagerie:<model>`, or the path of a `robot.yaml`.
        time_limit_s: Simulated time in seconds that ends an episode; None: a limit that fits the world.
        variables: Environment variables of launch configurations.

    Raises:
        ConfigurationError: Gymnasium is not installed, or the folder is no world's.
        ResourceNotFoundException: The catalog has no such world.
        LaunchError: The robot does not exist.
    """
    from ..runtime.policies.gymnasium_env import RobotEnv  # only this needs gymnasium

    if str(world).startswith("arn:"):
        service = Service.current()
        world = world_bundle(service.catalog.get(str(world), kind="world"), service)
    return RobotEnv(world, robot, time_limit_s=time_limit_s, variables=variables)
