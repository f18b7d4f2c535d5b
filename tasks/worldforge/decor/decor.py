"""Makes all decoration of a world as MJCF meshes and geoms, from the world and its seeds alone."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from random import Random

from ....schemas.worlds.world import Furniture, Point, Wall, World, bounds, contains
from ..furniture.catalogue import styles_of
from ..geometry.boxes import Box, pose_of
from ..geometry.parts import CHROME, Color, Span, rgb
from ..ornaments.ornament_shapes import Shapes
from ..ornaments.ornaments import Mesh, Ornament, color_look, mesh_path
from .faces import Face, faces, windows_in
from .lights_and_ceilings import ceilings, lamp_shades, skirting
from .on_tops import things_on_tops
from .on_walls import things_on_walls
from .openings import curtains, pierced_wall, window_frames
from .planters import planters

_COUNTERS = ("DishWashers", "Storage", "WashingMachinesAndDryers")
_COUNTER_MOST_M = 0.95
_UPPER: Span = (1.45, 2.15)
_UPPER_DEEP_M = 0.34

_RUGS = (
    (rgb("6d2f2c"), rgb("a98f6b")), (rgb("35465c"), rgb("b9b09c")), (rgb("8a8478"), rgb("cfc7b6")),
    (rgb("4f5f4c"), rgb("b3a98b")), (rgb("a5673f"), rgb("d8bf98")),
)  # fmt: skip
_RUG_M = 0.006
_BORDER_M = 0.12


def furnishings(world: World, faces: Sequence[Face], shapes: Shapes, dice: Random) -> Iterator[Ornament]:
    """Yields all decoration of a world: things on furniture, on walls and at windows."""
    yield from _rugs(world, dice)
    yield from _upper_cabinets(world, faces)
    yield from things_on_walls(world, faces, shapes, dice)


def _rugs(world: World, dice: Random) -> Iterator[Ornament]:
    """Yields a rug below each coffee table and one below the foot of each bed.

    Each is two flat boxes, the rim and the middle. One that would be narrow, or lie partly outside the room, is left
    out.
    """
    rooms = {room.name: room for room in world.floorplan.rooms}
    for item in world.furniture:
        if item.model_type not in ("CoffeeTables", "Beds"):
            continue
        pose = pose_of(item)
        if item.model_type == "Beds":
            box = pose.box(-0.1, item.depth_m / 2 + 0.45, -item.width_m / 2 - 0.45, item.width_m / 2 + 0.45)
        else:
            deep, wide = item.depth_m / 2 + 0.6, max(1.0, item.width_m / 2 + 0.45)
            box = pose.box(-deep, deep, -wide, wide)
        polygon = rooms[item.room].polygon
        x0, y0, x1, y1 = bounds(polygon)
        box = _within(box, (x0 + 0.2, y0 + 0.2, x1 - 0.2, y1 - 0.2))
        rim, middle = dice.choice(_RUGS)
        if not _lies_in(box, polygon) or min(box[2] - box[0], box[3] - box[1]) < 0.8:
            continue
        inner = (box[0] + _BORDER_M, box[1] + _BORDER_M, box[2] - _BORDER_M, box[3] - _BORDER_M)
        yield _flat(f"rug_{item.id}", box, _RUG_M, rim)
        yield _flat(f"rug_{item.id}_middle", inner, _RUG_M + 0.002, middle)


def _within(box: Box, room: Box) -> Box:
    return max(box[0], room[0]), max(box[1], room[1]), min(box[2], room[2]), min(box[3], room[3])


def _lies_in(box: Box, polygon: Sequence[Point]) -> bool:
    """Whether a rectangle is inside a room's polygon.

    All its corners are inside, and no corner of the room is in it.
    """
    corners = [(x, y) for x in box[::2] for y in box[1::2]]
    return all(contains(polygon, x, y) for x, y in corners) and not any(
        box[0] < x < box[2] and box[1] < y < box[3] for x, y in polygon
    )


def _flat(name: str, box: Box, top: float, color: Color) -> Ornament:
    center = ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2, top / 2)
    return Ornament(name, "box", center, ((box[2] - box[0]) / 2, (box[3] - box[1]) / 2, top / 2), color_look(color))


def _upper_cabinets(world: World, faces: Sequence[Face]) -> Iterator[Ornament]:
    """Yields wall cabinets above each kitchen counter whose wall has no window there, in the counters' colour."""
    kitchens = {room.name for room in world.floorplan.rooms if room.type == "Kitchen"}
    colors = {item.room: _counter_color(item) for item in world.furniture if item.model_type == "Storage"}
    for item in world.furniture:
        is_counter = item.model_type in _COUNTERS and item.height_m <= _COUNTER_MOST_M
        if item.room not in kitchens or not is_counter or item.room not in colors:
            continue
        face = _behind(item, faces)
        if face is None:
            continue
        middle = item.x if face.along_x else item.y
        span = (middle - item.width_m / 2, middle + item.width_m / 2)
        windows = [sides for _, sides in face.windows]
        above = _UPPER[1] < world.floorplan.ceiling_height_m - 0.1
        if above and all(high + 0.12 <= span[0] or span[1] <= low - 0.12 for low, high in windows):
            yield from _cabinet(f"cabinet_{item.id}", face, span, colors[item.room])


def _counter_color(item: Furniture) -> Color:
    style = next((style for style in styles_of("Storage") if style.name == item.style), styles_of("Storage")[0])
    return style.main


def _behind(item: Furniture, faces: Sequence[Face]) -> Face | None:
    """Returns the wall face that a piece of furniture has its back to; `None` if there is none."""
    x0, y0, x1, y1 = pose_of(item).box(-item.depth_m / 2 - 0.1, 0.0, -0.05, 0.05)
    for face in faces:
        along, across = ((x0, x1), (y0, y1)) if face.along_x else ((y0, y1), (x0, x1))
        reaches = face.span[0] <= along[0] and along[1] <= face.span[1]
        if face.room.name == item.room and reaches and across[0] <= face.at <= across[1]:
            return face
    return None


def _cabinet(name: str, face: Face, span: Span, color: Color) -> Iterator[Ornament]:
    yield face.bar(f"{name}_body", span, (0.0, _UPPER_DEEP_M - 0.02), _UPPER, color)
    doors = 2 if span[1] - span[0] > 0.7 else 1
    wide = (span[1] - span[0]) / doors
    front = (_UPPER_DEEP_M - 0.02, _UPPER_DEEP_M)
    for index in range(doors):
        door = (span[0] + index * wide + 0.004, span[0] + (index + 1) * wide - 0.004)
        yield face.bar(f"{name}_door_{index}", door, front, (_UPPER[0] + 0.004, _UPPER[1] - 0.004), color)
        at = door[1] - 0.05 if index == 0 else door[0] + 0.05
        handle = (_UPPER_DEEP_M, _UPPER_DEEP_M + 0.012)
        yield face.bar(f"{name}_handle_{index}", (at - 0.006, at + 0.006), handle, (1.5, 1.64), CHROME)


Sides = Callable[[Wall, World], tuple[str, str]]
"""Function that returns the surface materials of a wall's right and left face."""


@dataclass(slots=True)
class Decoration:
    """Decoration of a world (pictures, curtains, lamps, ...), as MJCF."""

    assets: list[str] = field(default_factory=list)
    """MJCF lines that define the decoration's meshes."""
    geoms: list[str] = field(default_factory=list)
    """MJCF lines of the decoration's geoms for the `worldbody`."""
    files: dict[str, str] = field(default_factory=dict)
    """Content of the mesh files, by their paths relative to the model."""


def decorate(world: World, sides: Sides, shapes: Shapes) -> Decoration:
    """Makes the decoration of a world.

    Args:
        world: The world.
        sides: Tells the surfaces of walls.
        shapes: Gathers the meshes of what stands and hangs about.
    """
    made = Decoration()
    for ornament, mesh in _ornaments(world, sides, shapes):
        made.geoms.append(ornament.line())
        if mesh is None:
            continue
        made.assets.append(mesh.line(ornament.mesh))
        if mesh.places is not None:
            made.files[mesh_path(ornament.mesh)] = mesh.obj_text()
    return made


def _ornaments(world: World, sides: Sides, shapes: Shapes) -> Iterator[tuple[Ornament, Mesh | None]]:
    for number, wall in enumerate(world.floorplan.walls):
        if windows_in(wall, world):
            yield from pierced_wall(number, wall, sides(wall, world), world)
    yield from ceilings(world)
    yield from lamp_shades(world)
    for ornament in ornaments(world, shapes):
        yield ornament, None


def ornaments(world: World, shapes: Shapes) -> Iterator[Ornament]:
    """Yields what rooms are decorated with, without what walls and ceilings are drawn as.

    Args:
        world: The world.
        shapes: Gathers the meshes of what stands and hangs about.
    """
    # As cheap and as lasting as chance gets: nothing else takes draws from it.
    dice = Random(world.floorplan_seed * 1_000_003 + world.interior_seed)  # noqa: S311 (chance, not secrecy)
    walls = list(faces(world))
    yield from window_frames(world, walls)
    yield from skirting(world, walls)
    yield from curtains(world, walls, shapes, dice)
    yield from furnishings(world, walls, shapes, dice)
    yield from things_on_tops(world, shapes, dice)
    yield from planters(world, shapes, dice)
