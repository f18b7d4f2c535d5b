"""Light of a world by day (sun and ceiling lamps), and ceilings and skirting boards.

MuJoCo's renderer takes eight lights, its headlight among them, in the order of the file.
"""

from collections.abc import Iterator, Sequence
from math import hypot

from ....schemas.worlds.appearance import APPEARANCES, DAY
from ....schemas.worlds.world import Room, World, bounds
from ..geometry.boxes import room_rects
from ..geometry.parts import Vector, rgb
from ..materials.materials import surface_finish, surface_name
from ..ornaments.ornaments import Mesh, Ornament, joined, numbers, sheet, turned_open
from .faces import Face, faces

MOST_LAMPS = 6
"""Limit of ceiling lamps in a world: MuJoCo draws eight lights, two of which are the headlight and the sun."""

LAMP_SHADE = "lamp_shade"
"""Name of the material of lamp shades."""

_SUN_FAR_M = 12.0
_SUN_DIRECTIONS: tuple[Vector, ...] = ((-0.6, 0.35, -0.62), (0.6, 0.35, -0.62))
_BELOW_CEILING_M = 0.4
_WIDE_M2 = 24.0
_SHADE_M = 0.09
_NEAR, _FADE = 0.7, 1.2
"""Constant and quadratic attenuation of lamps: at the corner of its room about half of a lamp's light is left."""
_DAY = APPEARANCES[DAY]


def light_lines(world: World) -> Iterator[str]:
    """Yields the MJCF of a world's sun and lamps by day."""
    direction = _sun_direction(world)
    (x, y, z), far = _middle(world), max(_SUN_FAR_M, 2 * reach_m(world))
    # A directional light's map of shadows lies where its axis runs: through the building's middle.
    place = numbers(x - far * direction[0], y - far * direction[1], z - far * direction[2])
    sun = f'dir="{numbers(*direction)}" diffuse="{numbers(*_DAY.sun)}" specular="0 0 0"'
    yield f'    <light name="sun" directional="true" castshadow="true" pos="{place}" {sun}/>'
    # A spot that is open all round; MuJoCo draws nothing of lights of the type `point`.
    shine = f'cutoff="180" exponent="0" diffuse="{numbers(*_DAY.lamps)}" castshadow="false" specular="0 0 0"'
    for index, (x, y, far) in enumerate(lamp_spots(world)):
        at = numbers(x, y, world.floorplan.ceiling_height_m - _BELOW_CEILING_M)
        # Lamps shine through walls, as lights without shadows do: those of small rooms do not reach far.
        fade = f"{_NEAR:g} 0 {numbers(_FADE / far**2)}"
        yield f'    <light name="lamp_{index}" pos="{at}" dir="0 0 -1" attenuation="{fade}" {shine}/>'


def reach_m(world: World) -> float:
    """Returns the distance from the middle of a building to its corners, in metres."""
    x0, y0, x1, y1 = bounds(world.floorplan.footprint)
    return hypot(x1 - x0, y1 - y0) / 2


def _middle(world: World) -> Vector:
    x0, y0, x1, y1 = bounds(world.floorplan.footprint)
    return (x0 + x1) / 2, (y0 + y1) / 2, world.floorplan.ceiling_height_m / 2


def _sun_direction(world: World) -> Vector:
    """Returns the direction of sunlight: from the south-east or the south-west, whichever side has more glass."""
    east = west = 0.0
    for face in faces(world):
        for _, (low, high) in face.windows:
            if not face.along_x:
                east, west = east + (high - low) * (face.inward < 0), west + (high - low) * (face.inward > 0)
    return _SUN_DIRECTIONS[0] if east >= west else _SUN_DIRECTIONS[1]


def lamp_spots(world: World) -> list[Vector]:
    """Chooses where ceiling lamps are: x, y, and how far each has to shine, in metres.

    One lamp in each room, the largest room first, and a second one in wide rooms while lights are left.
    """
    inside = [room for room in world.floorplan.rooms if not room.is_outdoor]
    rooms = sorted(inside, key=lambda room: -room.area_m2)[:MOST_LAMPS]
    left = MOST_LAMPS - len(rooms)
    spots: list[Vector] = []
    for room in rooms:
        twice = left > 0 and room.area_m2 >= _WIDE_M2
        left -= twice
        spots += _spots(room, 2 if twice else 1)
    return spots


def _spots(room: Room, count: int) -> list[Vector]:
    """Returns lamp positions along the middle of a room's largest rectangle: x, y and reach of the light, in metres.

    There is one lamp if `count` is 1, and there are two otherwise.
    """
    x0, y0, x1, y1 = max(room_rects(room).tolist(), key=lambda box: (box[2] - box[0]) * (box[3] - box[1]))
    x, y, wide, deep = (x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0
    if count == 1:
        return [(x, y, hypot(wide, deep) / 2)]
    far = hypot(max(wide, deep) / 2, min(wide, deep)) / 2
    shares = (0.28, 0.72)
    return [(x0 + share * wide, y, far) if wide > deep else (x, y0 + share * deep, far) for share in shares]


def lamp_shades(world: World) -> Iterator[tuple[Ornament, Mesh | None]]:
    """Yields a lamp shade under the ceiling for each lamp.

    All lamps have one mesh, which comes with the first of them; for the others it is `None`.
    """
    profile = ((0.0, 0.0), (0.1, 0.012), (0.17, 0.04), (0.2, _SHADE_M))
    bowl = turned_open(profile, 16)
    for index, (x, y, _) in enumerate(lamp_spots(world)):
        place = (x, y, world.floorplan.ceiling_height_m - _SHADE_M)
        look = f'material="{LAMP_SHADE}"'
        yield Ornament(f"lamp_{index}", "mesh", place, (), look, mesh="lamp"), bowl if index == 0 else None


def material_lines() -> Iterator[str]:
    """Yields the MJCF materials of ceilings and lamp shades, which shine by day."""
    for name, color, shine in (("ceiling", rgb("f5f2ed"), _DAY.ceiling), (LAMP_SHADE, rgb("fbf3df"), _DAY.shades)):
        yield f'    <material name="{name}" rgba="{numbers(*color)}" emission="{shine:g}" specular="0"/>'


CEILING = "ceiling"
"""Name of the material of ceilings."""

_RIM_M = 0.05
_CELL_M = 0.8
_BELOW_M = 0.004


def ceilings(world: World) -> Iterator[tuple[Ornament, Mesh]]:
    """Yields a ceiling, with its mesh, for each rectangle of a room inside; it is invisible from above."""
    for index, room in enumerate(world.floorplan.rooms):
        if room.is_outdoor:
            continue
        for number, (x0, y0, x1, y1) in enumerate(room_rects(room).tolist()):
            name = f"ceiling_{index}_{number}"
            wide, deep = x1 - x0, y1 - y0
            cells = max(1, round(wide / _CELL_M)), max(1, round(deep / _CELL_M))
            up = (0.0, 0.0, _RIM_M)
            tray = joined(
                [
                    sheet((0.0, deep, 0.0), (wide, 0.0, 0.0), (0.0, -deep, 0.0), cells),
                    sheet((0.0, 0.0, 0.0), (wide, 0.0, 0.0), up, (1, 1)),
                    sheet((wide, 0.0, 0.0), (0.0, deep, 0.0), up, (1, 1)),
                    sheet((wide, deep, 0.0), (-wide, 0.0, 0.0), up, (1, 1)),
                    sheet((0.0, deep, 0.0), (0.0, -deep, 0.0), up, (1, 1)),
                ]
            )
            # A little below the walls' upper ends, which would shine through.
            place = (x0, y0, world.floorplan.ceiling_height_m - _BELOW_M)
            yield Ornament(name, "mesh", place, (), f'material="{CEILING}"', mesh=name), Mesh(*tray)


SKIRTED = ("plain", "stripes", "trellis", "sprigs", "panels")
"""Wall patterns that get a skirting board; tiles, bricks and stones go down to the floor."""

_HEIGHT_M = 0.08
_THICK_M = 0.012
_CASING_M = 0.06
_COLOR = rgb("f3f1ec")


def skirting(world: World, faces: Sequence[Face]) -> Iterator[Ornament]:
    """Yields a skirting board along each wall side, with gaps at doors.

    Walls whose finish has no skirting board, such as tiles, are left out.
    """
    ends = {end for passage in world.floorplan.passages if passage.door for end in (passage.start, passage.end)}
    for number, face in enumerate(faces):
        if surface_finish(surface_name("wall", face.room)).pattern not in SKIRTED:
            continue
        low, high = face.span
        first, last = sorted((face.wall.start, face.wall.end))
        # Casings of doors stand beside the doorway, as far out as the board.
        low, high = low + _CASING_M * (first in ends), high - _CASING_M * (last in ends)
        if high - low > 0.02:
            yield face.bar(f"skirting_{number}", (low, high), (0.0, _THICK_M), (0.0, _HEIGHT_M), _COLOR)
