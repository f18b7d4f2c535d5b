"""Parts of doors as MJCF: leaves with panels, glass or boards and their poses, handles, and frames.

A leaf's parts are in its own frame: its x axis starts at the hinge and points to the free edge, z starts at the floor.
"""

from collections.abc import Callable, Iterator
from math import cos, sin

from ....schemas.worlds.world import Door, Floorplan, Passage, Point, Wall, bounds
from ..furniture.placed_parts import Solid
from ..geometry.boxes import Box
from ..geometry.parts import CHROME, WHITE, Color, Part, Span, box, rgb

FORMS = ("flush", "panelled", "glazed", "boarded")
MASS_KG = {"flush": 16.0, "panelled": 20.0, "glazed": 24.0, "boarded": 22.0}
"""Mass of a door's leaf without its handles, by the leaf's form, in kilograms."""
HANDLE_KG = 0.2

_FINISHES: dict[str, tuple[Color, Color]] = {
    "white": (WHITE, rgb("faf9f6")),
    "oak": (rgb("c89f6d"), rgb("d6ae7c")),
    "walnut": (rgb("7a5436"), rgb("87603f")),
    "grey": (rgb("8d9196"), rgb("999da2")),
    "sage": (rgb("8ea58c"), rgb("9ab097")),
}
FINISHES = tuple(_FINISHES)
_PANE = rgb("cfe0e8")

_RELIEF_M = 0.006
_HANDLE_HEIGHT_M = 1.05
_HANDLE_INSET_M = 0.07
_LEVER_M = 0.12
_LEVER_OFF_M = 0.055

_CASING_M = 0.06
_CASING_THICK_M = 0.012


def door_parts(door: Door) -> list[Part]:
    """Makes the parts of a door: leaf, panels and handles.

    They are in the door's own frame, in metres: x runs from the hinge along the leaf, z upwards from the floor.
    """
    form, _, finish = door.style.partition(" ")
    main, accent = _FINISHES.get(finish, _FINISHES["white"])
    low, high = door.bottom_m, door.bottom_m + door.leaf_height_m
    leaf = box("leaf", (0.0, door.leaf_width_m), _across(door, 0.0, door.thickness_m), (low, high), main, solid=True)
    parts = [leaf]
    for face in ("front", "back"):
        relief = _off(door, face, 0.0, _RELIEF_M)
        parts += [
            box(f"{name}-{face}", x, relief, z, color)
            for name, x, z, color in _relief(form, door.leaf_width_m, (low, high), accent)
        ]
        parts += _handle(door, face)
    return parts


def _relief(form: str, width: float, height: Span, accent: Color) -> Iterator[tuple[str, Span, Span, Color]]:
    """Yields the raised parts of a door leaf's face: name, extent along the leaf, extent upwards, colour.

    Other forms than `panelled`, `glazed` and `boarded` are flat: they have none.
    """
    low, high = height
    if form == "panelled":
        edge = (0.12, width - 0.12)
        yield "panel-low", edge, (low + 0.2, low + 0.9), accent
        yield "panel-high", edge, (low + 1.12, high - 0.12), accent
    elif form == "glazed":
        yield "panel-low", (0.12, width - 0.12), (low + 0.2, low + 0.75), accent
        yield "pane", (0.12, width - 0.12), (low + 0.95, high - 0.12), _PANE
    elif form == "boarded":
        board = width / 5
        for number in range(5):
            yield (
                f"board-{number + 1}",
                (number * board + 0.005, (number + 1) * board - 0.005),
                (low + 0.01, high - 0.01),
                accent,
            )


def _handle(door: Door, face: str) -> list[Part]:
    """Makes a door handle: a lever, which collides, and its plate, which does not."""
    end = door.leaf_width_m - _HANDLE_INSET_M
    up = (_HANDLE_HEIGHT_M - 0.01, _HANDLE_HEIGHT_M + 0.01)
    return [
        box(
            f"plate-{face}",
            (end - 0.02, end + 0.02),
            _off(door, face, 0.0, _RELIEF_M + 0.004),
            (_HANDLE_HEIGHT_M - 0.11, _HANDLE_HEIGHT_M + 0.05),
            CHROME,
        ),
        box(f"neck-{face}", (end - 0.01, end + 0.01), _off(door, face, 0.0, _LEVER_OFF_M - 0.015), up, CHROME),
        box(
            f"handle-{face}",
            (end - _LEVER_M, end + 0.01),
            _off(door, face, _LEVER_OFF_M - 0.015, _LEVER_OFF_M),
            up,
            CHROME,
            solid=True,
        ),
    ]


def _across(door: Door, near: float, far: float) -> Span:
    """Returns the extent across a door leaf between two depths, measured from the face in the room it opens into."""
    one, other = sorted((-door.swing * near, -door.swing * far))
    return one, other


def _off(door: Door, face: str, near: float, far: float) -> Span:
    """Returns the extent across a door leaf between two distances off one of its faces."""
    if face == "front":
        return _across(door, -near, -far)
    return _across(door, door.thickness_m + near, door.thickness_m + far)


def frame_solids(number: int, passage: Passage, lintel: Wall) -> Iterator[Solid]:
    """Yields the visible frame around a doorway.

    Args:
        number: The doorway's, for the names.
        passage: The doorway.
        lintel: The piece of wall over it.
    """
    door = passage.door
    color = _FINISHES.get(door.style.partition(" ")[2], _FINISHES["white"])[0] if door else WHITE
    (x0, y0), (x1, y1) = passage.start, passage.end
    along_x = abs(x1 - x0) > abs(y1 - y0)
    low, high = sorted((x0, x1) if along_x else (y0, y1))
    at, top = (y0 if along_x else x0), lintel.bottom_m
    pieces = {
        "left": ((low - _CASING_M, low), (0.0, top + _CASING_M)),
        "right": ((high, high + _CASING_M), (0.0, top + _CASING_M)),
        "head": ((low, high), (top, top + _CASING_M)),
    }
    for side, sign in (("front", 1), ("back", -1)):
        across = at + sign * (lintel.thickness_m + _CASING_THICK_M) / 2
        for name, (span, up) in pieces.items():
            along, height = sum(span) / 2, sum(up) / 2
            length = span[1] - span[0]
            center = (along, across, height) if along_x else (across, along, height)
            size = (length, _CASING_THICK_M, up[1] - up[0]) if along_x else (_CASING_THICK_M, length, up[1] - up[0])
            yield Solid(f"doorframe_{number}_{name}_{side}", "box", center, size, "z", 0.0, color, False)


FULLY_OPEN_PERCENT = 100.0

HANDLE_M = 0.06
"""Distance by which door handles stick out from the leaf, in metres."""


def lintel_over(plan: Floorplan, passage: Passage) -> Wall:
    """Returns the piece of wall above a doorway (its lintel); each doorway of a plan must have one."""
    ends = {passage.start, passage.end}
    return next(wall for wall in plan.walls if wall.lintel and {wall.start, wall.end} == ends)


def leaf_corners(door: Door, angle_rad: float | None = None) -> list[Point]:
    """Returns the corners of a door leaf on the floor, counter-clockwise.

    Args:
        door: The door.
        angle_rad: Opening angle in radians; `None`: the initial one.
    """
    yaw = door.yaw_at(door.open_angle_rad if angle_rad is None else angle_rad)
    u, v = cos(yaw), sin(yaw)
    across = -door.swing * door.thickness_m
    corners = [(0.0, 0.0), (door.leaf_width_m, 0.0), (door.leaf_width_m, across), (0.0, across)]
    points = [(door.hinge[0] + x * u - y * v, door.hinge[1] + x * v + y * u) for x, y in corners]
    return points if door.swing < 0 else points[::-1]


def leaf_outlines(plan: Floorplan, *, fully_open: bool = False) -> list[list[Point]]:
    """Returns the outlines of all door leaves, as obstacles for a map.

    Args:
        plan: The plan.
        fully_open: Whether doors are taken as fully open, and not as they are initially.
    """
    doors = [passage.door for passage in plan.passages if passage.door]
    return [leaf_corners(door, door.max_angle_rad if fully_open else None) for door in doors]


def swept_box(door: Door) -> Box:
    """Returns the bounding box of the area that a door sweeps while it opens."""
    return _local_box(door, (-HANDLE_M, 0.0), (door.leaf_width_m, door.leaf_width_m))


def open_box(door: Door) -> Box:
    """Returns the bounding box of a fully open door."""
    return _local_box(door, (0.0, 0.0), (door.thickness_m, door.leaf_width_m))


def _local_box(door: Door, one: Point, other: Point) -> Box:
    """Returns the box between two points of the hinge's frame: (along the closed leaf, into the room), in metres."""
    # Walls run along axes.
    along = (float(round(cos(door.closed_yaw))), float(round(sin(door.closed_yaw))))
    into = (-door.swing * along[1], door.swing * along[0])
    (x, y), points = door.hinge, (one, other)
    first, last = ((x + a * along[0] + b * into[0], y + a * along[1] + b * into[1]) for a, b in points)
    return bounds((first, last))


_FRICTION_NM = 0.4
"""Friction torque of a door's hinge, in newton metres.

It keeps the leaf where it is; a robot of 3 kg that pushes with 7 N moves the leaf from 6 cm off the hinge on.
"""
_DAMPING_NMS = 0.8

WriteGeom = Callable[[Solid, str], str]
"""Function that writes a shape with its physical properties as a line of MJCF."""


def door_solids(door: Door, *, closed_frame: bool = False) -> Iterator[Solid]:
    """Yields a door's geometry in the world, in its initial position.

    Args:
        door: The door.
        closed_frame: Whether shapes are given in the leaf's own frame instead.
    """
    yaw = 0.0 if closed_frame else door.yaw_at(door.open_angle_rad)
    (x0, y0), c, s = ((0.0, 0.0) if closed_frame else door.hinge), cos(yaw), sin(yaw)
    for part in door_parts(door):
        x, y, z = part.center
        center = (x0 + c * x - s * y, y0 + s * x + c * y, z)
        yield Solid(f"{door.id}.{part.name}", part.shape, center, part.size, part.axis, yaw, part.color, part.solid)


def cut_door_solids(plan: Floorplan, top_m: float) -> Iterator[Solid]:
    """Yields the geometry of all doors and frames below a height in metres; what reaches above it is cut off there."""
    doors = [passage.door for passage in plan.passages if passage.door]
    for solid in (*doorframe_solids(plan), *(solid for door in doors for solid in door_solids(door))):
        low = solid.center[2] - solid.size[2] / 2
        height = min(solid.size[2], top_m - low)
        if height > 0:
            center = (solid.center[0], solid.center[1], low + height / 2)
            yield solid._replace(center=center, size=(solid.size[0], solid.size[1], height))


def doorframe_solids(plan: Floorplan) -> Iterator[Solid]:
    """Yields the geometry of all door frames."""
    for number, passage in enumerate(plan.passages):
        if passage.door:
            yield from frame_solids(number, passage, lintel_over(plan, passage))


def door_lines(plan: Floorplan, write: WriteGeom, *, solid_only: bool = False) -> Iterator[str]:
    """Yields the MJCF of all doors: hinged bodies and their frames.

    The joint's position is how far the leaf is open: 0 is closed.

    Args:
        plan: The plan.
        write: Writes a geom.
        solid_only: Whether what is for the eye only is left out.
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
    for solid in door_solids(door, closed_frame=True):
        if solid.solid or not solid_only:
            yield "  " + write(solid, f'mass="{_mass_kg(door, solid):g}"')
    yield "    </body>"


def _mass_kg(door: Door, solid: Solid) -> float:
    form = door.style.partition(" ")[0]
    return MASS_KG.get(form, MASS_KG[FORMS[0]]) if solid.name.endswith(".leaf") else HANDLE_KG


def door_resistance(door: Door) -> dict[str, float]:
    """Returns the MJCF joint attributes that make a door hard to turn (friction, damping, ...), by attribute name.

    Args:
        door: The door.
    """
    found = {"damping": _DAMPING_NMS, "frictionloss": _FRICTION_NM, "armature": 0.0, "stiffness": 0.0}
    found["mass"] = found["inertia"] = 0.0
    for solid in door_solids(door, closed_frame=True):
        if solid.solid:
            (x, y, _), (along, across, _), mass_kg = solid.center, solid.size, _mass_kg(door, solid)
            found["mass"] += mass_kg
            found["inertia"] += mass_kg * (x * x + y * y + (along * along + across * across) / 12)
    return found
