"""Compares the model of a world with its description, piece by piece: floors, walls, doors, furniture.

A model must have all that is described, at its place and in its size, and no other colliding geoms.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterable, Iterator, Sequence
from math import cos, hypot, prod, sin
from typing import NamedTuple

import mujoco
import numpy as np

from ....schemas.worlds.world import (
    Door,
    Fault,
    Furniture,
    GazeboSource,
    Guarantee,
    Point,
    Room,
    Wall,
    World,
    bounds,
    contains,
)
from ..doors.door_parts import door_resistance, door_solids
from ..furniture.placed_parts import Solid, solids_of
from ..geometry.occupancy import wall_corners
from ..seeds import GENERATOR_VERSION
from .scan import Scan, names_of

_SAME_M = 1e-3
"""Largest difference of positions and sizes, in metres.

It is five times MJCF's rounding to a tenth of a millimetre, which moves both faces of a box.
"""
_OUTLINE_M = 0.03
"""Largest distance by which a piece's parts may extend beyond its described size, in metres, such as door handles."""
_SAME_RAD = 1e-3
_SAME_VOLUME = 5e-3
"""Largest rounding difference of a wall's volume or a floor's area that consists of parts, as a share."""
_SAME_RESISTANCE = 0.01
"""Largest rounding difference of a door's resistance, as a share."""
_MOST_TIMES = 5.0
"""Largest ratio between the resistance of earlier generators' doors and that of current ones."""
_LEAST_FELT = 0.5
"""Door resistance (in N m and the like) that a robot overcomes in any case."""

_SHAPES = {
    "box": {int(mujoco.mjtGeom.mjGEOM_BOX)},
    "cylinder": {int(mujoco.mjtGeom.mjGEOM_CYLINDER)},
    "ellipsoid": {int(mujoco.mjtGeom.mjGEOM_ELLIPSOID), int(mujoco.mjtGeom.mjGEOM_SPHERE)},
}

Corner = tuple[float, float, float]


class Extent(NamedTuple):
    """Axis-aligned bounding box in metres, as plain numbers: arrays of three take ten times as long."""

    low: Corner
    high: Corner

    @property
    def middle(self) -> Corner:
        """Returns the centre of the box."""
        (x0, y0, z0), (x1, y1, z1) = self
        return (x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2

    @property
    def volume_m3(self) -> float:
        """Returns the volume of the box, in cubic metres."""
        return prod(high - low for low, high in zip(self.low, self.high, strict=True))

    def away_m(self, other: "Extent") -> float:
        """Returns the largest distance between a face of the box and the same face of another."""
        pairs = (*zip(self.low, other.low, strict=True), *zip(self.high, other.high, strict=True))
        return max(abs(one - other) for one, other in pairs)


def part_faults(world: World, scan: Scan) -> list[Fault]:
    """Lists the differences between a world's description and its model.

    Args:
        world: The world.
        scan: Scanned model of the world.
    """
    return list(_Comparison(world, scan).faults())


class _Comparison:
    def __init__(self, world: World, scan: Scan) -> None:
        self._world, self._scan = world, scan
        solid: dict[str, list[int]] = {}
        for geom in np.flatnonzero(scan.solid).tolist():
            solid.setdefault(scan.pieces[geom], []).append(geom)
        self._solid = solid
        self._types: list[int] = scan.model.geom_type.tolist()
        self._low: list[Corner] = [(x, y, z) for x, y, z in scan.low.tolist()]
        self._high: list[Corner] = [(x, y, z) for x, y, z in scan.high.tolist()]
        self._bodies = {name: number for number, name in enumerate(_body_names(scan.model))}
        self._is_imported = isinstance(world.source, GazeboSource)
        self._is_ours = world.generator_version == GENERATOR_VERSION and not self._is_imported

    def faults(self) -> Iterator[Fault]:
        plan = self._world.floorplan
        doors = [passage.door for passage in plan.passages if passage.door]
        if not self._is_imported:  # floors and walls of an imported world are read off its map
            for number, room in enumerate(plan.rooms):
                yield from self._floor(f"floor_{number}", room)
            for number, wall in enumerate(plan.walls):
                yield from self._wall(f"wall_{number}", wall)
        for item in self._world.furniture:
            yield from self._furniture(item)
        for door in doors:
            yield from self._door(door)
        if not self._is_imported:
            known = {"ground", *(f"floor_{number}" for number in range(len(plan.rooms)))}
            known |= {f"wall_{number}" for number in range(len(plan.walls))}
            known |= {each.id for each in (*self._world.furniture, *doors)}
            yield from self._unknown(known)

    def _unknown(self, known: set[str]) -> Iterator[Fault]:
        for piece, geoms in self._solid.items():
            if piece not in known:
                names = ", ".join(map(self._scan.called, geoms[:3]))
                yield self._fault("parts", geoms, f"world.xml has {names}, which world.json does not")
        jointed = {int(body) for body in self._scan.model.jnt_bodyid}
        for name, body in self._bodies.items():
            if body in jointed and name not in known:
                yield self._fault("parts", (), f"world.xml has a body {name!r} that moves, which world.json does not")
        if count := self._scan.model.neq + self._scan.model.nu + self._scan.model.ntendon:
            yield self._fault(
                "parts", (), f"world.xml has {count} constraints, motors and tendons, and no world has any"
            )

    def _floor(self, name: str, room: Room) -> Iterator[Fault]:
        geoms = self._solid.get(name, [])
        if not geoms:
            said = f"the floor of {room.name}, {name}, is missing or does not collide"
            yield Fault.placed("parts", said, room.goal, room.name)
            return
        x0, y0, x1, y1 = bounds(room.polygon)
        found = self._extent(geoms)
        off_m = found.away_m(Extent((x0, y0, found.low[2]), (x1, y1, 0.0)))
        thick_m = found.high[2] - found.low[2]
        if off_m > _SAME_M or not self._fills(geoms, _area_m2(room.polygon) * thick_m):
            yield self._fault(
                "parts", geoms, f"the floor of {room.name}, {name}, is not as world.json has it{_by(off_m)}"
            )

    def _wall(self, name: str, wall: Wall) -> Iterator[Fault]:
        x0, y0, x1, y1 = bounds(wall_corners(wall))
        wanted = Extent((x0, y0, wall.bottom_m), (x1, y1, self._world.floorplan.top_of(wall)))
        geoms = self._solid.get(name, [])
        if not geoms:
            yield self._placed("parts", wanted.middle, f"the wall {name} is missing or does not collide")
            return
        off_m = self._extent(geoms).away_m(wanted)
        if off_m > _SAME_M or not self._fills(geoms, wanted.volume_m3):
            yield self._fault("parts", geoms, f"the wall {name} is not as world.json has it{_by(off_m)}")

    def _fills(self, geoms: Sequence[int], volume_m3: float) -> bool:
        """Whether boxes side by side fill the volume that one box should have."""
        return abs(sum(self._extent([geom]).volume_m3 for geom in geoms) / volume_m3 - 1) < _SAME_VOLUME

    def _furniture(self, item: Furniture) -> Iterator[Fault]:
        body = self._bodies.get(item.id, 0)
        geoms = self._solid.get(item.id, [])
        place = (item.x, item.y, item.base_m)
        if not geoms:
            yield self._placed("parts", place, f"{item.id} is missing or does not collide")
            return
        if bool(body) != item.movable or (item.movable and int(self._scan.model.body_dofnum[body]) != 6):
            yield self._fault("parts", geoms, f"{item.id} {'does not move' if item.movable else 'moves'} in world.xml")
        if self._is_ours:
            yield from self._solids(item.id, solids_of(item))
            return
        wanted = _box_of(item)
        away_m = self._extent(geoms).away_m(wanted)
        if not self._is_imported:  # what collides is less than the outline, or what is drawn more: the ear of a mug
            drawn = self._extent(self._scan.parts_of[item.id])
            # Generators before 3 drew what stands on a piece as its parts.
            drawn = drawn._replace(high=(*drawn.high[:2], min(drawn.high[2], wanted.high[2])))
            away_m = min(away_m, drawn.away_m(wanted))
        if away_m > (_SAME_M if self._is_imported else _OUTLINE_M):
            yield self._fault("parts", geoms, f"{item.id} is not as world.json has it{_by(away_m)}")

    def _solids(self, piece: str, solids: Iterable[Solid], guarantee: Guarantee = "parts") -> Iterator[Fault]:
        """Yields differences between the colliding parts of a piece and those expected from its description."""
        wanted = {solid.name: solid for solid in solids if solid.solid}
        found = {self._scan.names[geom]: geom for geom in self._solid.get(piece, [])}
        for name in sorted(found.keys() - wanted.keys()):
            said = f"{piece} has a part {name or 'without a name'} that world.json does not stand for"
            yield self._fault(guarantee, [found[name]], said)
        for name, solid in wanted.items():
            extent = _extent_of(solid)
            if name not in found:
                yield self._placed(guarantee, extent.middle, f"{name} is missing or does not collide")
                continue
            geom = found[name]
            away_m = self._extent([geom]).away_m(extent)
            if away_m > _SAME_M or self._types[geom] not in _SHAPES[solid.shape]:
                yield self._fault(guarantee, [geom], f"{name} is not as world.json has it{_by(away_m)}")

    def _door(self, door: Door) -> Iterator[Fault]:
        model = self._scan.model
        hinge = (*door.hinge, 0.0)
        body = self._bodies.get(door.id)
        joints = [] if body is None else np.flatnonzero(model.jnt_bodyid == body).tolist()
        if body is None or len(joints) != 1 or model.jnt_type[joints[0]] != int(mujoco.mjtJoint.mjJNT_HINGE):
            yield self._placed("doors", hinge, f"{door.id} has no hinge in world.xml")
            return
        (joint,) = joints
        turned = _turned_wrong(self._scan, joint, door) or _resisting(model, joint, door, exactly=self._is_ours)
        if turned:
            yield self._placed("doors", hinge, f"{door.id} {turned}")
        if self._is_ours:
            yield from self._solids(door.id, door_solids(door), "doors")
        elif not self._solid.get(door.id):
            yield self._placed("doors", hinge, f"{door.id} does not collide")

    def _extent(self, geoms: Sequence[int]) -> Extent:
        if len(geoms) == 1:
            return Extent(self._low[geoms[0]], self._high[geoms[0]])
        low, high = (zip(*(corners[geom] for geom in geoms), strict=True) for corners in (self._low, self._high))
        (x0, y0, z0), (x1, y1, z1) = map(min, low), map(max, high)
        return Extent((x0, y0, z0), (x1, y1, z1))

    def _fault(self, guarantee: Guarantee, geoms: Sequence[int], said: str) -> Fault:
        if not geoms:
            return Fault.placed(guarantee, said)
        return self._placed(guarantee, self._extent(geoms).middle, said)

    def _placed(self, guarantee: Guarantee, place: Corner, said: str) -> Fault:
        return Fault.placed(guarantee, said, (place[0], place[1]), room_at(self._world, place))


def room_at(world: World, place: Sequence[float]) -> str | None:
    """Returns the name of the room that a place is in; `None` outside of all.

    Args:
        world: The world.
        place: X and y, in metres.
    """
    return next((room.name for room in world.floorplan.rooms if contains(room.polygon, place[0], place[1])), None)


def _turned_wrong(scan: Scan, joint: int, door: Door) -> str:
    """Describes how a door's hinge differs from `world.json`, in place, axis, range or opening; empty: it does not."""
    model, data = scan.model, scan.data
    anchor, axis = data.xanchor[joint], data.xaxis[joint]
    open_rad = float(model.qpos0[model.jnt_qposadr[joint]])
    low, high = (float(value) for value in model.jnt_range[joint])
    if abs(axis[2] - door.swing) > _SAME_RAD:
        return "turns about another axis than world.json has"
    if hypot(anchor[0] - door.hinge[0], anchor[1] - door.hinge[1]) > _SAME_M:
        return f"hangs at ({anchor[0]:.2f}, {anchor[1]:.2f}) m, not where world.json has its hinge"
    if abs(low) > _SAME_RAD or abs(high - door.max_angle_rad) > _SAME_RAD or not model.jnt_limited[joint]:
        return f"opens from {low:.2f} to {high:.2f} rad, not from 0 to {door.max_angle_rad:.2f}"
    if abs(open_rad - door.open_angle_rad) > _SAME_RAD:
        return f"is {open_rad:.2f} rad open, not {door.open_angle_rad:.2f}"
    return ""


def _resisting(model: mujoco.MjModel, joint: int, door: Door, *, exactly: bool) -> str:
    """Describes how much harder a door is to turn than described, as earlier generators' doors may be.

    The text is empty if it is not.
    """
    dof = int(model.jnt_dofadr[joint])
    found = {
        "damping": model.dof_damping[dof],
        "frictionloss": model.dof_frictionloss[dof],
        "armature": model.dof_armature[dof],
        "stiffness": model.jnt_stiffness[joint],
        "mass": model.body_mass[model.jnt_bodyid[joint]],
        "inertia": model.dof_M0[dof],
    }
    for name, right in door_resistance(door).items():
        value, most = float(found[name]), max(_MOST_TIMES * right, _LEAST_FELT)
        if exactly and abs(value - right) > _SAME_RESISTANCE * max(right, 1.0):
            return f"turns otherwise than world.json has: its {name} is {value:.4g}, not {right:.4g}"
        if not exactly and value > most:
            return f"is hard to turn: its {name} is {value:.4g}, more than {most:.4g}"
    return ""


def _extent_of(solid: Solid) -> Extent:
    return _turned(solid.center, solid.size, solid.yaw)


def _box_of(item: Furniture) -> Extent:
    middle = (item.x, item.y, item.base_m + item.height_m / 2)
    return _turned(middle, (item.depth_m, item.width_m, item.height_m), item.yaw)


def _turned(middle: Corner, size: Corner, yaw: float) -> Extent:
    """Returns the bounding box of a box that is rotated about z."""
    (x, y, z), (along, across, up) = middle, (extent / 2 for extent in size)
    if yaw:
        c, s = abs(cos(yaw)), abs(sin(yaw))
        along, across = c * along + s * across, s * along + c * across
    return Extent((x - along, y - across, z - up), (x + along, y + across, z + up))


def _area_m2(polygon: Sequence[Point]) -> float:
    edges = zip(polygon, (*polygon[1:], polygon[0]), strict=True)
    return abs(sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in edges)) / 2


def _body_names(model: mujoco.MjModel) -> list[str]:
    return names_of(model, model.name_bodyadr)


def _by(away_m: float) -> str:
    return f": a face is {1e3 * away_m:.0f} mm off" if away_m >= _SAME_M else ""
