"""Writes a world as MJCF that every MuJoCo from 3.0 on reads: static geoms in the worldbody, loose objects, doors.

| name | what |
| --- | --- |
| `floor_<room>_<n>` | slabs that everything stands on, each with the friction of its material |
| `ground` | the plane below them, not drawn (group 3) |
| `ceiling_<room>_<n>` | drawn only: seen from below if decorated, else in group 4, which cameras leave out |
| `wall_<n>`, `wall_<n>_left`, `wall_<n>_right` | walls, lintels, railings; two halves where the two faces differ |
| `window_<n>_…` | drawn only |
| `wall_<n>_…_seen` | decorated: drawn around windows in place of the wall that collides, then in group 3 |
| `lamp_<n>`, `skirting_<n>`, `curtain_<n>_…`, `blind_<n>_…` | drawn only, in decorated models |
| `cabinet_<id>_…`, `rug_<id>` | the same; `<id>` is the piece above or below |
| `picture_<room>_<n>_…`, `mirror_…`, `clock_…`, `shelf_…`, `coats_…`, `towels_…` | the same, on walls |
| `thing_<id>_<n>_<kind>`, `book_<id>_<shelf>_<row>_<n>` | the same; small things, `<id>` is what they stand on |
| `<furniture id>.<part>` | parts of furniture; those for the eye only are in group 2 and never collide, |
| | what only collides, such as the inside of a cushion, is in group 3 |
| `<furniture id>.<part>_seen` | decorated: drawn in place of the part that collides, then in group 3 |
| body `<furniture id>` | a loose object |
| `doorframe_<passage>_…` | frames of doors, drawn only |
| body and joint `door-<n>` | a leaf on hinges, with its geoms `door-<n>.<part>`; at 0 it is closed |
| cameras `top`, `iso` | the whole plan |

A robot is attached with a prefix of its own, which no name here has. That loose objects and doors may sleep until
something touches them is not in the file, as MuJoCo before 3.4 refuses it: the program that runs the world says so.
"""

from collections.abc import Iterator
from math import cos, hypot, radians, sin, tan

from ....schemas.worlds.appearance import APPEARANCES, DAY
from ....schemas.worlds.world import Furniture, Room, Wall, World, bounds, contains
from ..decor.decor import Decoration, decorate
from ..decor.faces import WINDOW_HEAD_M as WINDOW_HEAD_M
from ..decor.faces import WINDOW_SILL_M as WINDOW_SILL_M
from ..decor.faces import walls_of_windows, windows_in
from ..decor.lights_and_ceilings import light_lines, material_lines, reach_m
from ..decor.openings import LAID, wall_halves
from ..doors.door_parts import door_lines
from ..furniture.catalogue import IMPORTED, styles_of
from ..furniture.placed_parts import Solid, solids_of
from ..geometry.boxes import room_rects
from ..geometry.parts import Axis
from ..materials.materials import FLOORS, surface_finish, surface_name
from ..materials.textures import LAYOUT, SKY, texture_size_m
from ..ornaments.ornament_shapes import Shapes
from ..ornaments.ornaments import ALONG_X, ALONG_Y, CYLINDER_QUAT, VISUAL
from ..ornaments.ornaments import numbers as _numbers
from ..ornaments.things import shaped

TEXTURES_FOLDER = "textures"
"""Folder of the texture files, beside the model."""

SLAB_M = 0.1
"""Thickness of the floor slabs in metres; their tops are at height 0."""

_FOVY_DEG = 45.0
_ASPECT = 4 / 3
# Of the first style of each kind.
_MASS_KG = {
    "Ball": 0.3, "Book": 0.5, "Carton": 1.2, "Clothes": 0.4, "Cup": 0.35, "Plate": 0.5, "Shoe": 0.35, "ToyBlock": 0.15,
}  # fmt: skip


_HEAD = (
    '<mujoco model="world">',
    '  <compiler angle="radian" autolimits="true"/>',
    '  <option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="10"/>',
)
_GROUND = f'    <geom name="ground" type="plane" pos="0 0 {-SLAB_M:g}" size="0 0 1" group="3"/>'


def world_mjcf(world: World, *, textured: bool = False) -> str:
    """Converts a world to an MJCF (MuJoCo) model text, in daylight.

    Args:
        world: The world.
        textured: Whether it is decorated: floors and walls have pictures, `textures/<surface>.png` for each
            surface in `surfaces`, and there is all that rooms have for the eye only, some of it in files of
            `decorated_mjcf`; without, the text is complete in itself and has what physics needs. Both collide alike.
    """
    return decorated_mjcf(world)[0] if textured else _text(world, Decoration(), None)


def decorated_mjcf(world: World) -> tuple[str, dict[str, str]]:
    """Converts a world to decorated MJCF text, with the mesh files that it names.

    Args:
        world: The world.

    Returns:
        The text, and the content of each mesh file by its path relative to the model.
    """
    shapes = Shapes()
    made = decorate(world, wall_surfaces, shapes)
    return _text(world, made, shapes), made.files


def proof_mjcf(world: World) -> str:
    """Converts a world to MJCF with colliding geoms only, for its checks.

    Args:
        world: The world.
    """
    plan = world.floorplan
    lines = [*_HEAD, "  <asset>", *_materials(world, False), "  </asset>", "  <worldbody>", _GROUND]
    for index, room in enumerate(plan.rooms):
        lines += _surfaces(index, room, None)
    for index, wall in enumerate(plan.walls):
        lines += _wall(index, wall, world, hidden=False)
    lines += door_lines(plan, _geom, solid_only=True)
    for item in world.furniture:
        lines += _loose(item, None, solid_only=True) if item.movable else piece_geoms(item, solid_only=True)
    return "\n".join([*lines, "  </worldbody>", "</mujoco>", ""])


def _text(world: World, made: Decoration, shapes: Shapes | None) -> str:
    plan, textured = world.floorplan, shapes is not None
    pieces = [line for item in world.furniture for line in (_loose if item.movable else piece_geoms)(item, shapes)]
    lines = [
        *_HEAD,
        *_visual(world),
        "  <asset>",
        _sky(textured),
        *_materials(world, textured),
        *(material_lines() if textured else ()),
        *made.assets,
        *(shapes.lines() if shapes else ()),
        "  </asset>",
        "  <worldbody>",
        *_cameras(world),
        *light_lines(world),
        _GROUND,
    ]
    for index, room in enumerate(plan.rooms):
        lines += _surfaces(index, room, None if textured else plan.ceiling_height_m)
    for index, wall in enumerate(plan.walls):
        lines += _wall(index, wall, world, hidden=textured and bool(windows_in(wall, world)))
    if not textured:
        for index, wall in sorted(walls_of_windows(world).items()):
            lines += _window(index, wall, world)
    lines += made.geoms
    lines += door_lines(plan, _geom)
    lines += pieces
    return "\n".join([*lines, "  </worldbody>", "</mujoco>", ""])


def _sky(textured: bool) -> str:
    look = 'builtin="gradient" width="64" height="384" rgb1="0.93 0.95 0.97" rgb2="0.74 0.8 0.86"'
    if textured:
        look = f'file="{TEXTURES_FOLDER}/{SKY}.png" {LAYOUT}'
    return f'    <texture name="{SKY}" type="skybox" {look}/>'


def _visual(world: World) -> Iterator[str]:
    lit = APPEARANCES[DAY]
    x0, y0, x1, y1 = bounds(world.floorplan.footprint)
    height = world.floorplan.ceiling_height_m
    center = _numbers((x0 + x1) / 2, (y0 + y1) / 2, height / 2)
    yield f'  <statistic center="{center}" extent="{_numbers(reach_m(world))}" meansize="0.3"/>'
    yield "  <visual>"
    ambient, ahead = _numbers(*lit.ambient), _numbers(*[lit.headlight] * 3)
    yield f'    <headlight ambient="{ambient}" diffuse="{ahead}" specular="0 0 0"/>'
    yield '    <map znear="0.005" zfar="12"/>'
    yield '    <global offwidth="1280" offheight="960"/>'
    yield "  </visual>"


def surfaces(world: World) -> list[str]:
    """Lists the names of the floor and wall surfaces of a world, each once; the last is `wall_outside`."""
    rooms = world.floorplan.rooms
    used = {surface_name("floor", room) for room in rooms} | {surface_name("wall", room) for room in rooms}
    return [*sorted(used), "wall_outside"]


def _materials(world: World, textured: bool) -> Iterator[str]:
    for name in surfaces(world):
        size_m = texture_size_m(name) if textured else None
        if size_m is None:
            yield f'    <material name="{name}" rgba="{_numbers(*surface_finish(name).color)}" specular="0.1"/>'
            continue
        yield f'    <texture name="{name}" type="2d" file="{TEXTURES_FOLDER}/{name}.png"/>'
        # MuJoCo lays `texrepeat` pictures on two metres.
        repeat = _numbers(2 / size_m[0], 2 / size_m[1])
        yield f'    <material name="{name}" texture="{name}" texrepeat="{repeat}" texuniform="true" specular="0.1"/>'
        if name.startswith("wall_"):
            yield f'    <material name="{name}{LAID}" texture="{name}" specular="0.1"/>'


def _cameras(world: World) -> Iterator[str]:
    x0, y0, x1, y1 = bounds(world.floorplan.footprint)
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    half = max((y1 - y0) / 2, (x1 - x0) / 2 / _ASPECT) + 0.4
    height = half / tan(radians(_FOVY_DEG / 2)) + world.floorplan.ceiling_height_m
    yield f'    <camera name="top" pos="{_numbers(x, y, height)}" fovy="{_FOVY_DEG:g}"/>'
    tilt, distance = radians(50), height * 1.05
    pos = _numbers(x, y - distance * cos(tilt), distance * sin(tilt))
    axes = f"1 0 0 {_numbers(0, sin(tilt), cos(tilt))}"
    yield f'    <camera name="iso" pos="{pos}" xyaxes="{axes}" fovy="{_FOVY_DEG:g}"/>'


def _surfaces(index: int, room: Room, ceiling_m: float | None) -> Iterator[str]:
    """Yields the MJCF of a room's floor, and of its ceiling if a height is given.

    Floors of neighbours meet under their walls and doorways, flush. MuJoCo takes the larger friction of two geoms that
    touch, so a wheel with less friction than the floor grips as well as the floor lets it.
    """
    grip = _numbers(FLOORS[room.floor_material].friction, 0.005, 0.0001)
    for number, (x0, y0, x1, y1) in enumerate(room_rects(room)):
        middle, half = ((x0 + x1) / 2, (y0 + y1) / 2), ((x1 - x0) / 2, (y1 - y0) / 2)
        slab = f'type="box" pos="{_numbers(*middle, -SLAB_M / 2)}" size="{_numbers(*half, SLAB_M / 2)}"'
        material = surface_name("floor", room)
        yield f'    <geom name="floor_{index}_{number}" {slab} material="{material}" friction="{grip}"/>'
        if ceiling_m is None or room.is_outdoor:
            continue
        ceiling = f'type="box" pos="{_numbers(*middle, ceiling_m + 0.05)}" size="{_numbers(*half, 0.05)}"'
        hidden = VISUAL.replace('group="2"', 'group="4"')
        yield f'    <geom name="ceiling_{index}_{number}" {ceiling} rgba="0.96 0.95 0.93 1" {hidden}/>'


def wall_surfaces(wall: Wall, world: World) -> tuple[str, str]:
    """Returns the material names of a wall's right and left side, seen from its start.

    A side that is in no room has `wall_outside`.
    """
    length = hypot(wall.end[0] - wall.start[0], wall.end[1] - wall.start[1])
    u, v = (wall.end[0] - wall.start[0]) / length, (wall.end[1] - wall.start[1]) / length
    x, y = (wall.start[0] + wall.end[0]) / 2, (wall.start[1] + wall.end[1]) / 2
    rooms = [room for room in world.floorplan.rooms if room.name in wall.rooms]

    def face(side: float) -> str:
        spot = (x - v * side, y + u * side)
        for room in rooms:
            if contains(room.polygon, *spot):
                return surface_name("wall", room)
        return "wall_outside"

    return face(-wall.thickness_m), face(wall.thickness_m)


def _wall(index: int, wall: Wall, world: World, *, hidden: bool) -> Iterator[str]:
    height = world.floorplan.top_of(wall) - wall.bottom_m
    (x0, y0), (x1, y1) = wall.start, wall.end
    along_x = abs(x1 - x0) >= abs(y1 - y0)
    x, y, z = (x0 + x1) / 2, (y0 + y1) / 2, wall.bottom_m + height / 2
    half_length = (abs(x1 - x0) + abs(y1 - y0)) / 2
    quat, group = ALONG_X if along_x else ALONG_Y, ' group="3"' if hidden else ""
    for suffix, shift, half, material in wall_halves(wall, wall_surfaces(wall, world)):
        pos = _numbers(x, y + shift, z) if along_x else _numbers(x - shift, y, z)
        size = _numbers(half_length, height / 2, half)
        shape = f'type="box" pos="{pos}" quat="{quat}" size="{size}" material="{material}"'
        yield f'    <geom name="wall_{index}{suffix}" {shape}{group}/>'


def _window(index: int, wall: Wall, world: World) -> Iterator[str]:
    window = world.floorplan.windows[index]
    (x0, y0), (x1, y1) = window.start, window.end
    head = min(WINDOW_HEAD_M, world.floorplan.ceiling_height_m - 0.2)
    z, half_z = (WINDOW_SILL_M + head) / 2, (head - WINDOW_SILL_M) / 2
    along_x = abs(x1 - x0) >= abs(y1 - y0)
    half = (abs(x1 - x0) + abs(y1 - y0)) / 2
    for name, inset, bulge, rgba in (
        ("frame", 0.0, 0.008, "0.97 0.97 0.95 1"),
        ("glass", 0.06, 0.012, "0.68 0.83 0.9 1"),
    ):
        through = wall.thickness_m / 2 + bulge
        size = (half - inset, through, half_z - inset) if along_x else (through, half - inset, half_z - inset)
        pos = _numbers((x0 + x1) / 2, (y0 + y1) / 2, z)
        shape = f'type="box" pos="{pos}" size="{_numbers(*size)}"'
        yield f'    <geom name="window_{index}_{name}" {shape} rgba="{rgba}" {VISUAL}/>'


def piece_geoms(
    item: Furniture, shapes: Shapes | None = None, mass_kg: float | None = None, *, solid_only: bool = False
) -> Iterator[str]:
    """Yields the MJCF geoms of a piece of furniture.

    Args:
        item: The piece.
        shapes: Draws parts as procedural shapes and gathers their meshes; absent: all are drawn as primitives.
        mass_kg: Mass of a loose object, in kilograms; fixed furniture has none.
        solid_only: Whether what is for the eye only is left out.
    """
    if shapes is None:
        yield from (
            _geom(solid, _physics(solid, mass_kg)) for solid in solids_of(item) if solid.solid or not solid_only
        )
        return
    for solid, seen in shaped(item, shapes):
        if solid.solid or not seen:
            yield _geom(solid, _physics(solid, mass_kg, hidden=bool(seen)))
        yield from (ornament.line() for ornament in seen)


def _physics(solid: Solid, mass_kg: float | None, *, hidden: bool = False) -> str:
    """Returns attributes of colliding geoms; a loose object's undrawn geoms lie inside those that have mass.

    `mass_kg` is `None` for what is no loose object; such geoms that are drawn have no attributes.
    """
    loose = "" if mass_kg is None else f'mass="{mass_kg if solid.drawn else 0:g}" condim="4" friction="0.8 0.02 0.002"'
    return f'{loose} group="3"'.lstrip() if hidden or not solid.drawn else loose


def _loose(item: Furniture, shapes: Shapes | None, *, solid_only: bool = False) -> Iterator[str]:
    pose = f'pos="{_numbers(item.x, item.y, item.base_m)}" euler="0 0 {_numbers(item.yaw)}"'
    yield f'    <body name="{item.id}" {pose}>'
    yield f'      <freejoint name="{item.id}"/>'
    resting = item.model_copy(update={"x": 0.0, "y": 0.0, "yaw": 0.0, "base_m": 0.0})
    yield from ("  " + line for line in piece_geoms(resting, shapes, _mass_kg(item), solid_only=solid_only))
    yield "    </body>"


def _mass_kg(item: Furniture) -> float:
    """Returns the mass of a loose object in kilograms, to the gram: in proportion to the volume within its kind."""
    if item.style == IMPORTED:
        return 1.0  # only pictures are drawn of it
    first = styles_of(item.model_type)[0]
    share = item.width_m * item.depth_m * item.height_m / (first.width_m * first.depth_m * first.height_m)
    return round(_MASS_KG[item.model_type] * share, 3)


def _geom(solid: Solid, physics: str = "") -> str:
    half_x, half_y, half_z = (extent / 2 for extent in solid.size)
    kind, quat = solid.shape, ""
    if solid.shape == "cylinder":
        kind, size, quat = "cylinder", *_cylinder(solid.axis, (half_x, half_y, half_z))
    elif solid.shape == "ellipsoid" and half_x == half_y == half_z:
        kind, size = "sphere", _numbers(half_x)
    else:
        size = _numbers(half_x, half_y, half_z)
    turn = f' quat="{quat}"' if quat else ""
    look = f'rgba="{_numbers(*solid.color)}"'
    rest = physics if solid.solid else VISUAL
    pos = _numbers(*solid.center)
    return f'    <geom name="{solid.name}" type="{kind}" pos="{pos}"{turn} size="{size}" {look} {rest}'.rstrip() + "/>"


def _cylinder(axis: Axis, half: tuple[float, float, float]) -> tuple[str, str]:
    """Returns the MJCF texts of size and rotation of a cylinder along an axis, from its half extents on x, y and z."""
    index = "xyz".index(axis)
    radius = half[(index + 1) % 3]
    return _numbers(radius, half[index]), CYLINDER_QUAT[axis]
