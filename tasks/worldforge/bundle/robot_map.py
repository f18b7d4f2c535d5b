"""Occupancy map for a robot of a given height: it shows table legs, and leaves out parts that the robot drives under.

Bundles have a coarser map, in which furniture is as large as its outline.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import mujoco

from ....schemas.worlds.world import GazeboSource, Point, World
from ..geometry.occupancy import ROBOT_HIGH_M, ROBOT_LOW_M, OccupancyGrid, occupancy_grid, write_map
from ..geometry.slices import solid_outlines
from .survey import survey

MAP_FILES = ("map.pgm", "map.yaml")
HEIGHTS_M = 0.05, 2.0
"""Least and greatest height of a robot that a map can be made for, in metres.

They reach from just above flat things on the floor to below the lintels of doors.
"""

_TOUCHING_M = 1e-4
"""Height up to which a part only touches the robot's space, in metres: many beds begin at exactly 10 cm."""


class Scene(Protocol):
    """A world with its compiled MuJoCo model."""

    @property
    def world(self) -> World:
        """World record: the content of `world.json`."""
        ...

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo model compiled from `world.xml`."""
        ...


def write_robot_map(scene: Scene, folder: Path, height_m: float = ROBOT_HIGH_M) -> None:
    """Writes a Nav2 map (`map.pgm`, `map.yaml`) of a world for a robot of a height in metres.

    Args:
        scene: The world.
        folder: Target folder.
        height_m: Height of the robot, in metres.

    Raises:
        ValueError: No robot is so high.
    """
    said = f"what a robot {height_m:g} m high meets, from {ROBOT_LOW_M:g} m above the floor; all stands as at first"
    write_map(robot_map(scene, height_m), folder, said)


def robot_map(scene: Scene, height_m: float = ROBOT_HIGH_M) -> OccupancyGrid:
    """Computes the occupancy grid of a world: the solid parts that a robot of a height meets.

    Args:
        scene: The world.
        height_m: Height of the robot, in metres.

    Raises:
        ValueError: No robot is so high.
    """
    if not HEIGHTS_M[0] <= height_m <= HEIGHTS_M[1]:
        raise ValueError(f"a robot {height_m:g} m high: {HEIGHTS_M[0]:g} to {HEIGHTS_M[1]:g} m would be right")
    if isinstance(scene.world.source, GazeboSource):
        return survey(scene.model, height_m)
    slices = _slices(scene.model, ROBOT_LOW_M + _TOUCHING_M, height_m - _TOUCHING_M)
    return occupancy_grid(scene.world.floorplan, (), slices, height_m)


def _slices(model: mujoco.MjModel, low_m: float, high_m: float) -> Iterator[list[Point]]:
    """Yields the outlines, counter-clockwise, of all solid parts of a model between two heights."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    yield from (outline for _, outline in solid_outlines(model, data, low_m, high_m))
