"""The map of what a robot of some height meets: legs of a table, and not what it drives under.

Bundles have a coarser one, in which furniture is as large as its outline.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterator
from math import pi
from pathlib import Path
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ....schemas.worlds.world import Point, World
from ..geometry.occupancy import ROBOT_HIGH_M, ROBOT_LOW_M, OccupancyGrid, occupancy_grid, write_map

MAP_FILES = ("map.pgm", "map.yaml")
HEIGHTS_M = 0.05, 2.0
"""Heights of robots: from a little above what stays flat on the floor to below the lintels of doors."""

_TOUCHING_M = 1e-4
"""Height by which a part only touches what the robot passes, in metres: many beds begin at exactly 10 cm."""
_ROUND = 24
"""Corners of a circle."""

Points = NDArray[np.float64]


class Scene(Protocol):
    """A world with its compiled MuJoCo model."""

    @property
    def world(self) -> World:
        """Content of `world.json`."""
        ...

    @property
    def model(self) -> mujoco.MjModel:
        """Compiled model of `world.xml`."""
        ...


def write_robot_map(scene: Scene, folder: Path, height_m: float = ROBOT_HIGH_M) -> None:
    """Writes a Nav2 map (`map.pgm`, `map.yaml`) of a world for a robot of a height in metres.

    Args:
        scene: the world.
        folder: where to.
        height_m: of the robot.

    Raises:
        ValueError: no robot is so high.
    """
    said = f"what a robot {height_m:g} m high meets, from {ROBOT_LOW_M:g} m above the floor; all stands as at first"
    write_map(robot_map(scene, height_m), folder, said)


def robot_map(scene: Scene, height_m: float = ROBOT_HIGH_M) -> OccupancyGrid:
    """Computes the occupancy grid of a world: the solid parts that a robot of a height meets.

    Args:
        scene: the world.
        height_m: of the robot.

    Raises:
        ValueError: no robot is so high.
    """
    if not HEIGHTS_M[0] <= height_m <= HEIGHTS_M[1]:
        raise ValueError(f"a robot {height_m:g} m high: {HEIGHTS_M[0]:g} to {HEIGHTS_M[1]:g} m would be right")
    slices = _slices(scene.model, ROBOT_LOW_M + _TOUCHING_M, height_m - _TOUCHING_M)
    return occupancy_grid(scene.world.floorplan, (), slices, height_m)


def _slices(model: mujoco.MjModel, low_m: float, high_m: float) -> Iterator[list[Point]]:
    """Outlines, counter-clockwise, of all solid parts between two heights."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    solid = (model.geom_contype | model.geom_conaffinity != 0) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    for geom in np.flatnonzero(solid):
        corners = data.geom_xpos[geom] + _corners(model, int(geom)) @ data.geom_xmat[geom].reshape(3, 3).T
        inside = _between(corners, low_m, high_m)
        if len(inside) < 3:
            continue
        try:
            yield [(float(x), float(y)) for x, y in inside[ConvexHull(inside).vertices]]
        except QhullError:
            continue  # it has no width


def _corners(model: mujoco.MjModel, geom: int) -> Points:
    """Corners of a convex part, or of what stands for its roundness, in its own frame."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        return np.asarray(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], np.float64)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        x, y = _circle()
        return np.array([(size[0] * u, size[0] * v, z) for z in (-size[1], size[1]) for u, v in zip(x, y, strict=True)])
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID, mujoco.mjtGeom.mjGEOM_CAPSULE):
        half = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size[0])
        up = size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
        x, y = _circle()
        ball = [
            (u * np.cos(tilt), v * np.cos(tilt), np.sin(tilt))
            for tilt in np.linspace(-pi / 2, pi / 2, _ROUND // 2 + 1)
            for u, v in zip(x, y, strict=True)
        ]
        return np.concatenate([np.array(ball) * half + (0.0, 0.0, shift) for shift in {-up, up}])
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    return signs * size


def _circle() -> tuple[Points, Points]:
    angles = np.arange(_ROUND) * (2 * pi / _ROUND)
    return np.cos(angles), np.sin(angles)


def _between(corners: Points, low_m: float, high_m: float) -> Points:
    """Possible corners of a convex body between two heights, seen from above."""
    heights = corners[:, 2]
    found = [corners[(heights >= low_m) & (heights <= high_m), :2]]
    for level in (low_m, high_m):
        # Lines between corners below and above the level; those inside the body do no harm.
        below, above = corners[heights < level], corners[heights > level]
        if len(below) and len(above):
            share = (level - below[:, None, 2]) / (above[None, :, 2] - below[:, None, 2])
            cut = below[:, None, :2] + share[..., None] * (above[None, :, :2] - below[:, None, :2])
            found.append(cut.reshape(-1, 2))
    return np.concatenate(found)
