"""Doors as solids in the world, and as hinged bodies in the MJCF."""

from collections.abc import Callable, Iterator
from math import cos, sin

from ....schemas.worlds.world import Door, Floorplan
from ..furniture.solids import Solid
from .leaves import lintel_over
from .parts import FORMS, HANDLE_KG, MASS_KG, door_parts, frame_solids

_FRICTION_NM = 0.4
"""Keeps the leaf where it is; a robot of 3 kg that pushes with 7 N moves it from 6 cm off the hinges on."""
_DAMPING_NMS = 0.8

WriteGeom = Callable[[Solid, str], str]
"""From a solid and its physics to a line of MJCF."""


def door_solids(door: Door, *, closed_frame: bool = False) -> Iterator[Solid]:
    """A door's parts in the world, as it is at first.

    Args:
        door: the door.
        closed_frame: in the leaf's own frame instead.
    """
    yaw = 0.0 if closed_frame else door.yaw_at(door.open_angle_rad)
    (x0, y0), c, s = ((0.0, 0.0) if closed_frame else door.hinge), cos(yaw), sin(yaw)
    for part in door_parts(door):
        x, y, z = part.center
        center = (x0 + c * x - s * y, y0 + s * x + c * y, z)
        yield Solid(f"{door.id}.{part.name}", part.shape, center, part.size, part.axis, yaw, part.color, part.solid)


def cut_door_solids(plan: Floorplan, top_m: float) -> Iterator[Solid]:
    """All doors as they are at first, and their frames, as far as they are below a height."""
    doors = [passage.door for passage in plan.passages if passage.door]
    for solid in (*doorframe_solids(plan), *(solid for door in doors for solid in door_solids(door))):
        low = solid.center[2] - solid.size[2] / 2
        height = min(solid.size[2], top_m - low)
        if height > 0:
            center = (solid.center[0], solid.center[1], low + height / 2)
            yield solid._replace(center=center, size=(solid.size[0], solid.size[1], height))


def doorframe_solids(plan: Floorplan) -> Iterator[Solid]:
    """The frames of all doors."""
    for number, passage in enumerate(plan.passages):
        if passage.door:
            yield from frame_solids(number, passage, lintel_over(plan, passage))


def door_lines(plan: Floorplan, write: WriteGeom, *, solid_only: bool = False) -> Iterator[str]:
    """The MJCF of all doors: bodies on hinges, and their frames.

    The joint's position is how far the leaf is open: 0 is closed.

    Args:
        plan: the plan.
        write: writes a geom.
        solid_only: whether what is for the eye only is left out.
    """
    for solid in doorframe_solids(plan):
        if solid.solid or not solid_only:
            yield write(solid, "")
    for passage in plan.passages:
        if passage.door:
            yield from _body(passage.door, write, solid_only)


def _body(door: Door, write: WriteGeom, solid_only: bool) -> Iterator[str]:
    angle = round(door.open_angle_rad, 4)
    x, y = door.hinge
    yield f'    <body name="{door.id}" pos="{x:g} {y:g} 0" euler="0 0 {door.yaw_at(angle):.6g}">'
    yield (
        f'      <joint name="{door.id}" type="hinge" axis="0 0 {door.swing}" range="0 {door.max_angle_rad:g}" '
        f'ref="{angle:g}" damping="{_DAMPING_NMS:g}" frictionloss="{_FRICTION_NM:g}"/>'
    )
    form = door.style.partition(" ")[0]
    leaf_kg = MASS_KG.get(form, MASS_KG[FORMS[0]])
    for solid in door_solids(door, closed_frame=True):
        mass = leaf_kg if solid.name.endswith(".leaf") else HANDLE_KG
        if solid.solid or not solid_only:
            yield "  " + write(solid, f'mass="{mass:g}"')
    yield "    </body>"
