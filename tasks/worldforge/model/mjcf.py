"""Writes a world as MJCF: static geoms in the worldbody, sleep enabled.

| name | what |
| --- | --- |
| `floor_<room>_<n>` | slabs that everything stands on, each with the friction of its material |
| `ground` | the plane below them, not drawn (group 3) |
| `ceiling_<room>_<n>` | drawn only, in group 4, which cameras leave out by default |
| `wall_<n>`, `wall_<n>_left`, `wall_<n>_right` | walls and lintels; two halves where the two faces differ |
| `window_<n>_frame`, `window_<n>_glass` | drawn only |
| `<furniture id>.<part>` | parts of furniture; those for the eye only are in group 2 and never collide |
| body `<furniture id>` | a loose object |
| `doorframe_<passage>_…` | frames of doors, drawn only |
| body and joint `door-<n>` | a leaf on hinges, with its geoms `door-<n>.<part>`; at 0 it is closed |
| cameras `top`, `iso` | the whole plan |

A robot is attached with a prefix of its own, which no name here has.
"""

from collections.abc import Iterator
from math import cos, hypot, radians, sin, sqrt, tan

from ....schemas.worlds.polygons import contains
from ....schemas.worlds.world import Furniture, Room, Wall, Window, World
from ..doors.model import door_lines
from ..furniture.solids import Solid, solids_of
from ..geometry.parts import Axis
from ..interiors.placement import room_rects
from ..materials.materials import FLOORS, surface_finish, surface_name
from ..materials.textures import texture_size_m

TEXTURES_FOLDER = "textures"
"""Where a textured model has its pictures, beside itself."""

SLAB_M = 0.1
"""Thickness of the floors, whose tops are at 0."""

WINDOW_SILL_M = 0.9
WINDOW_HEAD_M = 2.1

_HALF = sqrt(0.5)
# Local axes of a wall's box are along, up, through: textures are projected along the last.
_ALONG_X = f"{_HALF:.6f} {_HALF:.6f} 0 0"
_ALONG_Y = "0.5 0.5 0.5 0.5"
_CYLINDER_QUAT = {"x": f"{_HALF:.6f} 0 {_HALF:.6f} 0", "y": f"{_HALF:.6f} {_HALF:.6f} 0 0", "z": ""}
_FOVY_DEG = 45.0
_ASPECT = 4 / 3
_MASS_KG = {
    "Ball": 0.3, "Book": 0.5, "Carton": 1.2, "Clothes": 0.4, "Cup": 0.35, "Plate": 0.5, "Shoe": 0.35, "ToyBlock": 0.15,
}  # fmt: skip

_VISUAL = 'contype="0" conaffinity="0" group="2" mass="0"'


def world_mjcf(world: World, *, textured: bool = False) -> str:
    """The world as MJCF text.

    Args:
        world: the world.
        textured: whether floors and walls have pictures, `textures/<surface>.png` for each surface in
            `surfaces`; without, they have plain colours and the text is complete in itself.
    """
    plan = world.floorplan
    lines = [
        '<mujoco model="world">',
        '  <compiler angle="radian" autolimits="true"/>',
        '  <option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="10">',
        '    <flag sleep="enable"/>',
        "  </option>",
        *_visual(world),
        "  <asset>",
        '    <texture name="sky" type="skybox" builtin="gradient" width="64" height="384" '
        'rgb1="0.93 0.95 0.97" rgb2="0.74 0.8 0.86"/>',
        *_materials(world, textured),
        "  </asset>",
        "  <worldbody>",
        *_cameras(world),
        f'    <geom name="ground" type="plane" pos="0 0 {-SLAB_M:g}" size="0 0 1" group="3"/>',
    ]
    for index, room in enumerate(plan.rooms):
        lines += _surfaces(index, room, plan.ceiling_height_m)
    for index, wall in enumerate(plan.walls):
        lines += _wall(index, wall, world)
    for index, window in enumerate(plan.windows):
        lines += _window(index, window, world)
    lines += door_lines(plan, _geom)
    for item in world.furniture:
        lines += _loose(item) if item.movable else piece_geoms(item)
    return "\n".join([*lines, "  </worldbody>", "</mujoco>", ""])


def _numbers(*values: float) -> str:
    return " ".join(f"{round(value, 4) + 0.0:g}" for value in values)


def _extent(world: World) -> tuple[float, float, float, float]:
    xs, ys = zip(*world.floorplan.footprint, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def _visual(world: World) -> Iterator[str]:
    x0, y0, x1, y1 = _extent(world)
    height = world.floorplan.ceiling_height_m
    center = _numbers((x0 + x1) / 2, (y0 + y1) / 2, height / 2)
    yield f'  <statistic center="{center}" extent="{_numbers(hypot(x1 - x0, y1 - y0) / 2)}" meansize="0.3"/>'
    yield "  <visual>"
    yield '    <headlight ambient="0.42 0.42 0.42" diffuse="0.38 0.38 0.38" specular="0 0 0"/>'
    yield '    <map znear="0.005"/>'
    yield '    <global offwidth="1280" offheight="960"/>'
    yield "  </visual>"


def surfaces(world: World) -> list[str]:
    """Names of the floors and walls that a world shows."""
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
        repeat = _numbers(1 / size_m[0], 1 / size_m[1])
        yield f'    <material name="{name}" texture="{name}" texrepeat="{repeat}" texuniform="true" specular="0.1"/>'


def _cameras(world: World) -> Iterator[str]:
    x0, y0, x1, y1 = _extent(world)
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    half = max((y1 - y0) / 2, (x1 - x0) / 2 / _ASPECT) + 0.4
    height = half / tan(radians(_FOVY_DEG / 2)) + world.floorplan.ceiling_height_m
    yield f'    <camera name="top" pos="{_numbers(x, y, height)}" fovy="{_FOVY_DEG:g}"/>'
    tilt, distance = radians(50), height * 1.05
    pos = _numbers(x, y - distance * cos(tilt), distance * sin(tilt))
    axes = f"1 0 0 {_numbers(0, sin(tilt), cos(tilt))}"
    yield f'    <camera name="iso" pos="{pos}" xyaxes="{axes}" fovy="{_FOVY_DEG:g}"/>'
    light = f'pos="{_numbers(x, y, height)}" dir="-0.3 0.4 -0.87" diffuse="0.4 0.4 0.38" specular="0 0 0"'
    yield f'    <light name="sun" type="directional" castshadow="true" {light}/>'


def _surfaces(index: int, room: Room, ceiling_m: float) -> Iterator[str]:
    """The floor and the ceiling of a room.

    Floors of neighbours meet under their walls and doorways, flush. MuJoCo takes the larger friction of two geoms that
    touch, so a wheel whose own is below the floor's grips as well as the floor lets it.
    """
    grip = _numbers(FLOORS[room.floor_material].friction, 0.005, 0.0001)
    for number, (x0, y0, x1, y1) in enumerate(room_rects(room)):
        middle, half = ((x0 + x1) / 2, (y0 + y1) / 2), ((x1 - x0) / 2, (y1 - y0) / 2)
        slab = f'type="box" pos="{_numbers(*middle, -SLAB_M / 2)}" size="{_numbers(*half, SLAB_M / 2)}"'
        material = surface_name("floor", room)
        yield f'    <geom name="floor_{index}_{number}" {slab} material="{material}" friction="{grip}"/>'
        ceiling = f'type="box" pos="{_numbers(*middle, ceiling_m + 0.05)}" size="{_numbers(*half, 0.05)}"'
        hidden = _VISUAL.replace('group="2"', 'group="4"')
        yield f'    <geom name="ceiling_{index}_{number}" {ceiling} rgba="0.96 0.95 0.93 1" {hidden}/>'


def wall_faces(wall: Wall, world: World) -> tuple[str, str]:
    """Names of the materials on a wall's right and left face, looking from its start to its end."""
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


def _wall(index: int, wall: Wall, world: World) -> Iterator[str]:
    height = world.floorplan.ceiling_height_m - wall.bottom_m
    (x0, y0), (x1, y1) = wall.start, wall.end
    along_x = abs(x1 - x0) >= abs(y1 - y0)
    x, y, z = (x0 + x1) / 2, (y0 + y1) / 2, wall.bottom_m + height / 2
    half_length = (abs(x1 - x0) + abs(y1 - y0)) / 2
    quat = _ALONG_X if along_x else _ALONG_Y
    right, left = wall_faces(wall, world)
    if (x1 - x0) + (y1 - y0) < 0:
        right, left = left, right

    def piece(name: str, shift: float, half_thickness: float, material: str) -> str:
        pos = _numbers(x, y + shift, z) if along_x else _numbers(x - shift, y, z)
        size = _numbers(half_length, height / 2, half_thickness)
        return f'    <geom name="{name}" type="box" pos="{pos}" quat="{quat}" size="{size}" material="{material}"/>'

    if right == left:
        yield piece(f"wall_{index}", 0.0, wall.thickness_m / 2, right)
        return
    quarter = wall.thickness_m / 4
    yield piece(f"wall_{index}_right", -quarter, quarter, right)
    yield piece(f"wall_{index}_left", quarter, quarter, left)


def _window(index: int, window: Window, world: World) -> Iterator[str]:
    thickness = max(wall.thickness_m for wall in world.floorplan.walls if wall.exterior)
    (x0, y0), (x1, y1) = window.start, window.end
    head = min(WINDOW_HEAD_M, world.floorplan.ceiling_height_m - 0.2)
    z, half_z = (WINDOW_SILL_M + head) / 2, (head - WINDOW_SILL_M) / 2
    along_x = abs(x1 - x0) >= abs(y1 - y0)
    half = (abs(x1 - x0) + abs(y1 - y0)) / 2
    for name, inset, bulge, rgba in (
        ("frame", 0.0, 0.008, "0.97 0.97 0.95 1"),
        ("glass", 0.06, 0.012, "0.68 0.83 0.9 1"),
    ):
        through = thickness / 2 + bulge
        size = (half - inset, through, half_z - inset) if along_x else (through, half - inset, half_z - inset)
        pos = _numbers((x0 + x1) / 2, (y0 + y1) / 2, z)
        shape = f'type="box" pos="{pos}" size="{_numbers(*size)}"'
        yield f'    <geom name="window_{index}_{name}" {shape} rgba="{rgba}" {_VISUAL}/>'


def piece_geoms(item: Furniture) -> Iterator[str]:
    """A piece of furniture as geoms of the body that it stands in."""
    return (_geom(solid) for solid in solids_of(item))


def _loose(item: Furniture) -> Iterator[str]:
    """A free body that sleeps until something touches it."""
    pose = f'pos="{_numbers(item.x, item.y, item.base_m)}" euler="0 0 {_numbers(item.yaw)}"'
    yield f'    <body name="{item.id}" {pose} sleep="init">'
    yield f'      <freejoint name="{item.id}"/>'
    resting = item.model_copy(update={"x": 0.0, "y": 0.0, "yaw": 0.0, "base_m": 0.0})
    for solid in solids_of(resting):
        mass = f'mass="{_MASS_KG[item.model_type]:g}" condim="4" friction="0.8 0.02 0.002"'
        yield "  " + _geom(solid, mass)
    yield "    </body>"


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
    rest = physics if solid.solid else _VISUAL
    pos = _numbers(*solid.center)
    return f'    <geom name="{solid.name}" type="{kind}" pos="{pos}"{turn} size="{size}" {look} {rest}'.rstrip() + "/>"


def _cylinder(axis: Axis, half: tuple[float, float, float]) -> tuple[str, str]:
    """Size and rotation of a cylinder."""
    index = "xyz".index(axis)
    radius = half[(index + 1) % 3]
    return _numbers(radius, half[index]), _CYLINDER_QUAT[axis]
