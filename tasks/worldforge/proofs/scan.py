"""Solid parts of a compiled world at a robot's height: outlines, floors, pieces, and simulated lidar rays."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....schemas.worlds.world import Point
from ..geometry.occupancy import ROBOT_HIGH_M, ROBOT_LOW_M, OccupancyGrid, fill
from ..geometry.slices import extents, solid_outlines

GRACE_M = 1e-3
"""Depth up to which a part only touches a map cell, in metres.

MJCF's numbers are rounded to a tenth of a millimetre.
"""

_TOUCHING_M = 1e-4
"""Height up to which a part only touches the robot's space, in metres: many beds begin at exactly 10 cm."""

_FLOOR_BAND_M = (-0.05, -0.001)
"""Range of heights in which a floor's top is searched, in metres.

The top is at 0, walls begin there, and the plane below is deeper.
"""

_HALF_CELL = 0.5 + 1e-3
"""Share of a map cell that a floor must cover to contain the cell's centre."""

Points = NDArray[np.float64]
Outlines = list[tuple[int, list[Point]]]


@dataclass(frozen=True)
class Scan:
    """Compiled world in its initial state, and with the doors fully open."""

    model: mujoco.MjModel
    doors: Collection[str]
    """Names of the bodies that are doors, which a robot pushes open."""

    data: mujoco.MjData = field(init=False)
    names: list[str] = field(init=False)
    """Name of each geom of the world's model."""
    pieces: list[str] = field(init=False)
    """Name of the piece that each geom is part of: a body, a piece of furniture, a wall, a room's floor."""
    solid: NDArray[np.bool_] = field(init=False)
    """Whether each geom collides with a robot whose geoms have MuJoCo's default contact bits."""
    low: Points = field(init=False)
    high: Points = field(init=False)
    """Upper corner of the box around each geom."""

    def __post_init__(self) -> None:
        """Computes the poses and outlines of all geoms."""
        model, data = self.model, mujoco.MjData(self.model)
        mujoco.mj_kinematics(model, data)
        names = names_of(model, model.name_geomadr)
        bodies = names_of(model, model.name_bodyadr)
        low, high = extents(model, data)
        found = {
            "data": data,
            "names": names,
            "pieces": [
                bodies[body] if body else _piece(name)
                for name, body in zip(names, model.geom_bodyid.tolist(), strict=True)
            ],
            "solid": ((model.geom_contype | model.geom_conaffinity) & 1).astype(np.bool_),
            "low": low,
            "high": high,
        }
        for name, value in found.items():
            object.__setattr__(self, name, value)

    def called(self, geom: int) -> str:
        """Returns a geom's name for messages: its own, else that of the furnishing that it is a part of.

        Args:
            geom: Id of the geom.
        """
        return self.names[geom] or self.pieces[geom] or "a part without a name"

    @cached_property
    def slices(self) -> Outlines:
        """Outlines of the solid parts at the height of a robot, in the initial state."""
        return self._outlines(self.data, self.solid)

    @cached_property
    def leaves(self) -> Outlines:
        """Outlines of the door leaves, in the initial state."""
        return [(geom, outline) for geom, outline in self.slices if self.pieces[geom] in self.doors]

    @cached_property
    def standing(self) -> Outlines:
        """Outlines of all geoms except the leaves of doors."""
        return [(geom, outline) for geom, outline in self.slices if self.pieces[geom] not in self.doors]

    @cached_property
    def open_leaves(self) -> Outlines:
        """Outlines of the door leaves when fully open; the same object if they are so initially."""
        model, data = self.model, mujoco.MjData(self.model)
        for joint in self._door_joints():
            data.qpos[model.jnt_qposadr[joint]] = model.jnt_range[joint, 1]
        if np.array_equal(data.qpos, self.data.qpos):
            return self.leaves
        mujoco.mj_kinematics(model, data)
        return self._outlines(data, self.solid & np.array([piece in self.doors for piece in self.pieces]))

    def _outlines(self, data: mujoco.MjData, among: NDArray[np.bool_]) -> Outlines:
        return list(solid_outlines(self.model, data, ROBOT_LOW_M + _TOUCHING_M, ROBOT_HIGH_M - _TOUCHING_M, among))

    def floor(self, grid: OccupancyGrid) -> NDArray[np.bool_]:
        """Returns a mask of the cells whose middle is on a floor.

        Args:
            grid: Occupancy grid with the cells' positions.
        """
        cells = np.zeros_like(grid.known)
        for _, outline in self.floors:
            fill(grid, cells, outline, _HALF_CELL * grid.resolution_m)
        return cells

    @cached_property
    def floors(self) -> Outlines:
        """Outlines of the floor geoms that a robot drives on."""
        level = self.solid & (np.abs(self.high[:, 2]) < GRACE_M)
        return list(solid_outlines(self.model, self.data, *_FLOOR_BAND_M, level))

    @cached_property
    def parts_of(self) -> dict[str, list[int]]:
        """Geoms of each piece, in the model's order."""
        found: dict[str, list[int]] = {}
        for geom, piece in enumerate(self.pieces):
            found.setdefault(piece, []).append(geom)
        return found

    def _door_joints(self) -> list[int]:
        bodies = names_of(self.model, self.model.name_bodyadr)
        hinges = np.flatnonzero(self.model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)).tolist()
        return [joint for joint in hinges if bodies[self.model.jnt_bodyid[joint]] in self.doors]


def names_of(model: mujoco.MjModel, begins: NDArray[np.int32]) -> list[str]:
    """Returns all names of a kind; `model.geom` is twenty times slower.

    Args:
        model: A world.
        begins: Addresses of the names, such as `model.name_geomadr`.
    """
    names = model.names
    return [names[begin : names.index(b"\0", begin)].decode() for begin in begins.tolist()]


def _piece(name: str) -> str:
    """Returns the piece that a geom of the world body is part of, from its name."""
    piece, dot, _ = name.partition(".")
    if dot:
        return piece
    kind, _, rest = name.partition("_")
    number = rest.partition("_")[0]
    return f"{kind}_{number}" if kind in ("wall", "floor") and number.isdecimal() else name


_LIDAR_M = 0.2
"""Height of the simulated lidar rays, in metres: lidars of indoor robots are at 10 to 35 cm."""
_RAYS = 120
_SOLID_GROUPS = np.array([1, 1, 0, 1, 0, 0], np.uint8)
"""Geom groups that stand for solid objects.

Groups 2 and 4 are only drawn, and simulated lidars ignore them.
"""


@dataclass(frozen=True, slots=True)
class LidarScan:
    """Simulated lidar rays around a point, and where they end."""

    ends: Points
    """End point of each lidar ray on the surface that it hits; NaN if it hits nothing."""
    geoms: NDArray[np.int32]
    """Id of the geom that each lidar ray hits; -1: none."""


def lidar_scan(scan: Scan, place: Point) -> LidarScan:
    """Casts rays around a place, as a lidar 0.2 m above the floor would.

    Args:
        scan: The world.
        place: The lidar's.
    """
    angles = np.arange(_RAYS) * (2 * np.pi / _RAYS) + 1e-3  # none runs along a wall
    ways = np.stack([np.cos(angles), np.sin(angles), np.zeros(_RAYS)], axis=1)
    start = np.array([*place, _LIDAR_M])
    geoms, distances = np.zeros(_RAYS, np.int32), np.zeros(_RAYS)
    mujoco.mj_multiRay(
        scan.model, scan.data, start, ways.ravel(), _SOLID_GROUPS, True, -1, geoms, distances, None, _RAYS,
        mujoco.mjMAXVAL,
    )  # fmt: skip
    ends = start[:2] + np.where(distances >= 0, distances, np.nan)[:, None] * ways[:, :2]
    return LidarScan(ends, geoms)
