"""Writes a world as MJCF: static shapes in the world body, bodies that move, lights, and what is drawn.

| name | what |
| --- | --- |
| `<piece>.s<n>` | shapes that collide, of a model that never moves |
| `<piece>.v<n>` | drawn only |
| body and joint `<piece>` | a body that can move, with its shapes `<piece>.s<n>` |
| `sun`, `lamp_<n>` | lights |
| cameras `top`, `iso` | the whole world |

A piece is a model's name in letters, digits, `_` and `-`.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from math import cos, pi, radians, sin, tan

import numpy as np

from ....schemas.worlds.appearance import APPEARANCES, DAY
from ...sdf.sdf_types import Light, Matrix, Pose, Vector
from .bodies import Body, body_inertia
from .solids import Solid
from .visuals import Heightmaps, SeenGeom, Visuals

Bounds = tuple[Vector, Vector]

DAY_SKY = (
    '<texture name="sky" type="skybox" builtin="gradient" width="64" height="384" rgb1="0.93 0.95 0.97" '
    'rgb2="0.74 0.8 0.86"/>'
)
"""MJCF texture of the sky by day."""
_HIDDEN = ' group="3"'
_DRAWN_ONLY = ' contype="0" conaffinity="0" group="2" mass="0"'
_MOST_LAMPS = 6
"""Limit of lamps: MuJoCo's renderer draws eight lights, the headlight and the sun included."""
_LEAST_SIZE_M = 1e-5
"""Smallest size that is written to MJCF, in metres; smaller ones could not be told from 0."""
_NOT_EACH_OTHER = {"frame": ' contype="2" conaffinity="1"', "leaf": ' contype="4" conaffinity="1"'}
"""MJCF contact attributes of two bodies that a joint connects: they do not collide with each other, as in Gazebo.

Both collide with everything else.
"""


class Names:
    """Gives unique MJCF names to the objects of a Gazebo world."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def new(self, name: str) -> str:
        """Returns a unique name of letters, digits, `_` and `-`.

        Args:
            name: The name in the world file.
        """
        plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_")[:80] or "model"
        # Names that our own worlds and robots have.
        plain = f"{plain}_model" if plain in ("world", "sun", "ground", "top", "iso", "building") else plain
        found, number = plain, 2
        while found in self._taken:
            found, number = f"{plain}_{number}", number + 1
        self._taken.add(found)
        return found


@dataclass(slots=True)
class Scene:
    """An imported Gazebo world that is ready to be written as MJCF."""

    fixed: list[tuple[str, Solid]]
    """Collision shapes that never move, each with the name of its piece."""
    bodies: list[tuple[str, Body]]
    """Movable bodies with their names, each after the body that it is attached to."""
    seen: list[tuple[str, SeenGeom]] = field(default_factory=list)
    """Visual shapes that never move, each with the name of its piece."""
    seen_of: Mapping[str, list[SeenGeom]] = field(default_factory=dict)
    """Visual shapes of each movable body, by the body's name."""
    lights: list[Light] = field(default_factory=list)
    tied_pieces: frozenset[str] = frozenset()
    """Names of pieces to which a joint connects a body."""


def scene_text(scene: Scene, bounds: Bounds, visuals: Visuals | None, heightmaps: Heightmaps) -> str:
    """Writes an imported Gazebo world as MJCF text.

    Args:
        scene: The world.
        bounds: Lowest and highest corner of all that is in it.
        visuals: Materials and meshes of what is drawn; absent: only what collides is written.
        heightmaps: Terrain.
    """
    geoms, assets = _Geoms(heightmaps), []
    lines: list[str] = []
    for piece, solid in scene.fixed:
        tied = _NOT_EACH_OTHER["frame"] if piece in scene.tied_pieces else ""
        is_hidden = visuals is not None and not _is_drawn(solid)
        lines.append(geoms.solid(piece, solid, solid.pose, tied + (_HIDDEN if is_hidden else "")))
    for piece, seen in scene.seen if visuals is not None else ():
        lines.append(geoms.seen(piece, seen, seen.pose))
    lines += _bodies(scene, geoms, visuals is not None)
    if visuals is not None:
        assets += visuals.asset_lines()
    return "\n".join([
        '<mujoco model="world">',
        '  <compiler angle="radian" autolimits="true"/>',
        '  <option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="10"/>',
        *_visual(bounds),
        "  <asset>",
        f"    {DAY_SKY}",
        *assets,
        *geoms.assets,
        "  </asset>",
        "  <worldbody>",
        *_cameras(bounds),
        *_lights(scene.lights, bounds),
        *lines,
        "  </worldbody>",
        "</mujoco>",
        "",
    ])  # fmt: skip


def _is_drawn(solid: Solid) -> bool:
    """Whether a collision shape is also drawn, as terrain from a heightmap picture is."""
    return solid.kind == "hfield" and solid.terrain is None


class _Geoms:
    """Writes MJCF geoms and the assets that they use."""

    def __init__(self, heightmaps: Heightmaps) -> None:
        self.assets: list[str] = []
        self._hulls: dict[bytes, str] = {}
        self._heightmaps = heightmaps
        self._count: dict[str, int] = {}

    def _name(self, piece: str, kind: str) -> str:
        number = self._count.get(piece + kind, 0)
        self._count[piece + kind] = number + 1
        return f"{piece}.{kind}{number}"

    def solid(self, piece: str, solid: Solid, pose: Pose, more: str) -> str:
        friction = f' friction="{numbers(solid.friction)} 0.005 0.0001"'
        return self._line(self._name(piece, "s"), self._shape(solid, pose), friction + more)

    def seen(self, piece: str, seen: SeenGeom, pose: Pose) -> str:
        shape = f'type="mesh" mesh="{seen.mesh}"' if seen.mesh else f'type="{seen.kind}" size="{_sizes(seen.size)}"'
        look = f' material="{seen.material}"' if seen.material else f' rgba="{numbers(*seen.rgba)}"'
        return self._line(self._name(piece, "v"), f"{shape} {pose_attributes(pose)}", look + _DRAWN_ONLY)

    def _line(self, name: str, shape: str, more: str) -> str:
        return f'    <geom name="{name}" {shape}{more}/>'

    def _shape(self, solid: Solid, pose: Pose) -> str:
        if solid.kind == "hull":
            return f'type="mesh" mesh="{self._hull(solid)}" {pose_attributes(pose)}'
        if solid.kind == "hfield":
            return self._terrain(solid, pose)
        if solid.kind == "plane":
            # MuJoCo's planes collide without an end, whatever they are drawn like.
            return f'type="plane" size="{numbers(*solid.size, 1.0)}" {pose_attributes(pose)}'
        return f'type="{solid.kind}" size="{_sizes(solid.size)}" {pose_attributes(pose)}'

    def _terrain(self, solid: Solid, pose: Pose) -> str:
        if solid.terrain is not None:
            name, line = self._heightmaps.asset_of(solid.terrain)
        else:
            assert solid.geometry is not None
            name, line = self._heightmaps.asset(solid.geometry)
            pose = pose @ Pose(np.array([0.0, 0.0, float(self._heightmaps.heights(solid.geometry).min())]), np.eye(3))
        if line not in self.assets:
            self.assets.append(line)
        return f'type="hfield" hfield="{name}" {pose_attributes(pose)}'

    def _hull(self, solid: Solid) -> str:
        assert solid.corners is not None
        corners = np.round(solid.corners, 5)
        key = corners.tobytes()
        if key not in self._hulls:
            self._hulls[key] = name = f"hull_{len(self._hulls)}"
            self.assets.append(f'    <mesh name="{name}" vertex="{numbers(*corners.ravel())}"/>')
        return self._hulls[key]


def _bodies(scene: Scene, geoms: _Geoms, is_drawn: bool) -> Iterator[str]:
    names = {id(body): name for name, body in scene.bodies}
    children: dict[str, list[tuple[str, Body]]] = {}
    for name, body in scene.bodies:
        above = names[id(body.parent)] if body.parent is not None else ""
        children.setdefault(above, []).append((name, body))

    def written(name: str, body: Body, around: Pose) -> Iterator[str]:
        inside = body.pose.inverse()
        yield f'    <body name="{name}" {pose_attributes(around.inverse() @ body.pose)}>'
        yield _joint(name, body)
        inertia = body_inertia(body)
        at = inside @ inertia.pose
        turned = at.rotation @ inertia.moments @ at.rotation.T if inertia.moments is not None else np.eye(3)
        full = [turned[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        yield f'    <inertial pos="{numbers(*at.position)}" mass="{inertia.mass_kg:.6g}" fullinertia="{_exact(full)}"/>'
        tied = _NOT_EACH_OTHER["leaf"] if body.joint is not None else ""
        for solid in body.solids:
            condim = ' condim="4"' if body.joint is None else ""
            yield geoms.solid(name, solid, inside @ solid.pose, tied + condim + (_HIDDEN if is_drawn else ""))
        for seen in scene.seen_of.get(name, []) if is_drawn else ():
            yield geoms.seen(name, seen, inside @ seen.pose)
        for inner_name, inner in children.get(name, []):
            yield from written(inner_name, inner, body.pose)
        yield "    </body>"

    for name, body in children.get("", []):
        yield from written(name, body, Pose(np.zeros(3), np.eye(3)))


def _joint(name: str, body: Body) -> str:
    joint = body.joint
    if joint is None:
        return f'      <freejoint name="{name}"/>'
    inside = body.pose.inverse() @ Pose(joint.pose.position, np.eye(3))
    place = f'pos="{numbers(*inside.position)}"'
    if joint.kind == "ball":
        return f'      <joint name="{name}" type="ball" {place} damping="{joint.damping:g}"/>'
    axis = body.pose.rotation.T @ joint.axis * (-1.0 if body.is_reversed else 1.0)
    limits = ""
    if joint.lower is not None or joint.upper is not None:
        # MuJoCo knows two limits or none.
        far = 1e3 if joint.kind == "slide" else 1e2 * pi
        low, high = -far if joint.lower is None else joint.lower, far if joint.upper is None else joint.upper
        limits = f' range="{numbers(low, high)}"' if low < high else ""
    motion = f' damping="{max(joint.damping, 0.0):g}" frictionloss="{max(joint.friction, 0.0):g}"'
    # Joints count from where the file has their links, wherever these were saved.
    reference = f' ref="{numbers(joint.position)}"' if joint.position else ""
    return (
        f'      <joint name="{name}" type="{joint.kind}" {place} axis="{numbers(*axis)}"{limits}{reference}{motion}/>'
    )


def _exact(values: Iterable[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _lights(lights: Iterable[Light], bounds: Bounds) -> Iterator[str]:
    """Yields the MJCF of the sun and the first lamps.

    A world without a sun gets one from above, so that camera images are not dark.
    """
    low, high = bounds
    center, reach = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    every = list(lights)
    sun = next((light for light in every if light.kind == "directional"), None)
    direction = sun.direction / np.linalg.norm(sun.direction) if sun is not None else np.array([0.2, 0.3, -0.93])
    place = center - direction * (reach + 2)
    casts = "true" if sun is not None and sun.casts_shadows else "false"
    color = numbers(*APPEARANCES[DAY].sun)
    yield f'    <light name="sun" type="directional" pos="{numbers(*place)}" dir="{numbers(*direction)}" diffuse="{color}" specular="0 0 0" castshadow="{casts}"/>'  # noqa: E501
    lamps = [light for light in every if light.kind != "directional"][:_MOST_LAMPS]
    for number, lamp in enumerate(lamps):
        cone = 180 if lamp.kind == "point" else max(5, round(lamp.outer_angle_rad * 180 / pi))
        # Gazebo's lamps are not limited by how many shine on a spot: here they share the light of one room.
        diffuse = numbers(*(channel * 0.5 for channel in lamp.diffuse))
        yield f'    <light name="lamp_{number}" pos="{numbers(*lamp.pose.position)}" dir="{numbers(*lamp.direction)}" cutoff="{cone}" exponent="0" attenuation="1 0 0.05" diffuse="{diffuse}" specular="0 0 0" castshadow="false"/>'  # noqa: E501


def _visual(bounds: Bounds) -> Iterator[str]:
    low, high = bounds
    lit = APPEARANCES[DAY]
    extent = max(float(np.linalg.norm(high - low)) / 2, 1.0)
    yield f'  <statistic center="{numbers(*((low + high) / 2))}" extent="{numbers(extent)}" meansize="0.3"/>'
    yield "  <visual>"
    ambient, ahead = numbers(*lit.ambient), numbers(*[lit.headlight] * 3)
    yield f'    <headlight ambient="{ambient}" diffuse="{ahead}" specular="0 0 0"/>'
    yield '    <map znear="0.005" zfar="12"/>'
    yield '    <global offwidth="1280" offheight="960"/>'
    yield "  </visual>"


def _cameras(bounds: Bounds) -> Iterator[str]:
    low, high = bounds
    (x, y), (wide, deep) = ((low + high) / 2)[:2], (high - low)[:2]
    distance = max(deep / 2, wide / 2 * 0.75) + 0.4
    height = distance / tan(radians(22.5)) + float(high[2])
    yield f'    <camera name="top" pos="{numbers(x, y, height)}" fovy="45"/>'
    tilt, away = radians(50), height * 1.05
    pos, axes = numbers(x, y - away * cos(tilt), away * sin(tilt)), f"1 0 0 {numbers(0, sin(tilt), cos(tilt))}"
    yield f'    <camera name="iso" pos="{pos}" xyaxes="{axes}" fovy="45"/>'


def numbers(*values: float) -> str:
    """Formats numbers for MJCF, to a hundredth of a millimetre."""
    return " ".join(f"{round(float(value), 5) + 0.0:.10g}" for value in values)


def _sizes(values: Iterable[float]) -> str:
    """Formats sizes, above 0 as MuJoCo requires."""
    return numbers(*(max(value, _LEAST_SIZE_M) for value in values))


def pose_attributes(pose: Pose) -> str:
    """Formats a pose as MJCF attributes `pos` and `quat`."""
    place = f'pos="{numbers(*pose.position)}"'
    if np.allclose(pose.rotation, np.eye(3), atol=1e-7):
        return place
    return f'{place} quat="{" ".join(f"{value:.7g}" for value in quaternion(pose.rotation))}"'


def quaternion(rotation: Matrix) -> Vector:
    """Converts a rotation matrix to a quaternion w, x, y, z."""
    import mujoco

    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, rotation.ravel())  # pyright: ignore[reportAttributeAccessIssue]
    return np.round(quat, 9) + 0.0
