"""Scene of a world export: a world bundle as a list of objects made of shapes.

Shapes, masses, friction and joints are those of the compiled MJCF, so that every export format shows and weighs the
same. `world.json` says which furniture a geom belongs to and where the furniture is.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from math import cos, pi, sin
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ....schemas.worlds.world import Furniture, World
from ..bundle.bundle import MODEL_FILE, read_world

Kind = Literal["box", "sphere", "ellipsoid", "cylinder", "capsule", "plane", "mesh", "terrain"]
ThingKind = Literal["building", "furniture", "body"]
Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

BUILDING = "building"
UNLIMITED_RAD = 1e16
"""Limit in radians for an exported hinge without limits: some readers take a joint without limits for a fixed one."""

_KINDS: dict[int, Kind] = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
    mujoco.mjtGeom.mjGEOM_HFIELD: "terrain",
}
_JOINT_KINDS: dict[int, Literal["revolute", "prismatic", "ball"]] = {
    mujoco.mjtJoint.mjJNT_HINGE: "revolute",
    mujoco.mjtJoint.mjJNT_SLIDE: "prismatic",
    mujoco.mjtJoint.mjJNT_BALL: "ball",
}
_DEFAULT_COLOR = (0.5, 0.5, 0.5, 1.0)
_NOT_DRAWN_GROUP = 3
_CEILING_GROUP = 4
_CEILING = "ceiling_"
_FILE_NAME = re.compile(r"[A-Za-z0-9_.-]{1,200}")


@dataclass(frozen=True, slots=True)
class Shape:
    """A geom of an exported world, in the frame of its object: form, size, pose and material."""

    name: str
    """Name of a shape that is unique within its object."""
    kind: Kind
    half: tuple[float, float, float]
    """Half extents along the shape's own axes, in metres.

    Round ends of a capsule are added to the third. A plane's third number means nothing, and 0 in the others means that
    it is infinite. The third of terrain is its whole height above its own origin.
    """
    position: Vector
    rotation: Matrix
    color: tuple[float, float, float, float]
    """Mean colour of a shape, texture included: red, green, blue and opacity, 0 to 1."""
    material: int
    """Material index of a shape in the compiled MuJoCo model, or -1."""
    mesh: int
    """Mesh index in the compiled MuJoCo model (of terrain: height field index), or -1."""
    mesh_name: str
    """File name for the shape's mesh, the same in all worlds that have this mesh; empty without mesh.

    Terrain has a name of its world.
    """
    drawn: bool
    ceiling: bool
    """Whether it is a ceiling, which is visible from below only, so that one can look into rooms from above."""
    collides: bool
    friction: float

    @property
    def endless(self) -> bool:
        """Whether the shape is an infinite plane."""
        return self.kind == "plane" and 0.0 in self.half[:2]


@dataclass(frozen=True, slots=True)
class Joint:
    """The joint that connects an exported body to the world, or to the body that it hangs on."""

    kind: Literal["revolute", "prismatic", "ball"]
    position: Vector
    """Position of a joint in the body's frame, in metres."""
    axis: Vector
    lower: float
    """Lower limit of the joint, relative to the body's current position, in radians or metres."""
    upper: float
    damping: float
    friction: float


@dataclass(frozen=True, slots=True)
class Inertia:
    """Mass and moments of inertia of an exported body."""

    mass_kg: float
    position: Vector
    moments: Matrix
    """Moments of inertia in the body's axes, in kg m2."""


@dataclass(frozen=True, slots=True)
class Thing:
    """An object of an exported world: the building, a piece of furniture, or a movable body."""

    name: str
    """Name of an exported object that is unique in the world."""
    kind: ThingKind
    label: str
    """Kind of an exported object, equal for equal objects, such as `door 850x40x2050`."""
    position: Vector
    rotation: Matrix
    shapes: tuple[Shape, ...]
    inertia: Inertia | None = None
    """Mass and moments of inertia of an exported object; `None`: the object never moves."""
    joint: Joint | None = None
    """Joint of an exported object; `None`: the object moves freely, or not at all."""
    hung: tuple["Thing", ...] = ()
    """Bodies that are attached to this one by joints, such as the links of an arm, with poses in its frame."""


@dataclass(frozen=True, slots=True)
class Placed:
    """An object, and its pose in the frame of the outermost object that it hangs on."""

    thing: Thing
    above: "Placed | None"
    position: Vector
    rotation: Matrix


def with_hung(thing: Thing, position: Vector, rotation: Matrix, above: Placed | None = None) -> Iterator[Placed]:
    """Yields an object and all objects that hang on it, parents before children.

    Args:
        thing: The thing.
        position: Position of the object in the target frame.
        rotation: Rotation of the object in the target frame.
        above: The thing that it hangs on.
    """
    placed = Placed(thing, above, position, rotation)
    yield placed
    for inner in thing.hung:
        yield from with_hung(inner, position + rotation @ inner.position, rotation @ inner.rotation, placed)


@dataclass(frozen=True, slots=True)
class Scene:
    """All objects of a world, prepared for export to other formats."""

    world: World
    model: mujoco.MjModel
    things: tuple[Thing, ...]
    """Objects of the world: the building first, furniture in the order of `world.json`, then bodies as in the MJCF."""
    folder: Path | None = None
    """Folder of the world's bundle, which has the texture files that the MJCF names."""


def read_scene(bundle: Path) -> Scene:
    """Reads a world's files as a scene for export.

    Raises:
        FileNotFoundError: The bundle lacks `world.json` or `world.xml`.
        ValueError: A file is not what its name says, or the MJCF has an element that exports cannot hold.
    """
    world = read_world(bundle)
    path = bundle / MODEL_FILE
    if not path.is_file():
        raise FileNotFoundError(f"{path}: a world bundle has its MJCF there")
    return make_scene(world, mujoco.MjModel.from_xml_path(str(path)), bundle)


def make_scene(world: World, model: mujoco.MjModel, folder: Path | None = None) -> Scene:
    """Makes a scene for export from a world's compiled MuJoCo model.

    Args:
        world: The world that the MJCF was written for.
        model: The compiled MJCF.
        folder: Folder of its texture files; without it, textures are generated where they are needed.

    Raises:
        ValueError: The MJCF has something that exports cannot hold.
    """
    fixed = {item.id: item for item in world.furniture if not item.movable}
    colors = _material_colors(model)
    owned: dict[str, list[Shape]] = {BUILDING: [], **{name: [] for name in fixed}}
    for geom in np.flatnonzero(model.geom_bodyid == 0):
        shape = _shape(model, int(geom), colors)
        owner, _, part = shape.name.partition(".")
        if part and owner in fixed:
            owned[owner].append(_moved(shape, fixed[owner], part))
        else:
            owned[BUILDING].append(shape)
    things = [Thing(BUILDING, "building", "building", np.zeros(3), np.eye(3), tuple(owned.pop(BUILDING)))]
    for name, shapes in owned.items():
        item = fixed[name]
        things.append(Thing(name, "furniture", _label(item), _spot(item), _turned(item.yaw), tuple(shapes)))
    labels = {item.id: _label(item) for item in world.furniture}
    things += [
        _body_thing(model, body, labels, colors) for body in range(1, model.nbody) if model.body_parentid[body] == 0
    ]
    return Scene(world, model, tuple(things), folder)


def _label(item: Furniture) -> str:
    sizes = "x".join(f"{1000 * size:.0f}" for size in (item.width_m, item.depth_m, item.height_m))
    return f"{item.model_type} {item.style} {sizes}"


def _spot(item: Furniture) -> Vector:
    return np.array([item.x, item.y, item.base_m])


def _turned(yaw: float) -> Matrix:
    quarters = yaw / (pi / 2)
    # Cosine and sine exact for quarter turns, which most furniture has.
    exact = abs(quarters - round(quarters)) < 1e-6
    c, s = (round(cos(yaw)), round(sin(yaw))) if exact else (cos(yaw), sin(yaw))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _moved(shape: Shape, item: Furniture, name: str) -> Shape:
    """Returns a shape in the frame of the furniture that it is part of."""
    back = _turned(item.yaw).T
    position, rotation = back @ (shape.position - _spot(item)), back @ shape.rotation
    return replace(shape, name=name, position=position, rotation=rotation)


def _shape(model: mujoco.MjModel, geom: int, colors: list[Vector]) -> Shape:
    name = model.geom(geom).name or f"geom_{geom}"
    kind = _KINDS.get(int(model.geom_type[geom]))
    if kind is None:
        raise ValueError(f"geom {name!r}: exports hold {', '.join(_KINDS.values())}, not type {model.geom_type[geom]}")
    material = int(model.geom_matid[geom])
    color = model.geom_rgba[geom]
    if material >= 0 and np.allclose(color, _DEFAULT_COLOR):
        color = colors[material]
    group = int(model.geom_group[geom])
    form = int(model.geom_dataid[geom]) if kind in ("mesh", "terrain") else -1
    size = model.hfield_size[form, :3] if kind == "terrain" else model.geom_size[geom]
    half, position = _half(kind, size), model.geom_pos[geom].copy()
    rotation = matrix_of(model.geom_quat[geom])
    ceiling = group == _CEILING_GROUP or (kind == "mesh" and name.startswith(_CEILING))
    if ceiling and kind == "mesh":
        # A tray that is open at the top: each format has its own way to show a ceiling from below only.
        kind, half, position, rotation = "box", *_surrounding_box(model, geom, position, rotation)
    return Shape(
        name=name,
        kind=kind,
        half=half,
        position=position,
        rotation=rotation,
        color=tuple(round(float(value), 3) for value in color),  # pyright: ignore[reportArgumentType]
        material=material,
        mesh=form if kind in ("mesh", "terrain") else -1,
        mesh_name=_mesh_name(model, kind, form),
        drawn=group != _NOT_DRAWN_GROUP,
        ceiling=ceiling,
        collides=bool(model.geom_contype[geom] or model.geom_conaffinity[geom]),
        friction=round(float(model.geom_friction[geom, 0]), 4),
    )


def _mesh_name(model: mujoco.MjModel, kind: Kind, form: int) -> str:
    if kind not in ("mesh", "terrain"):
        return ""
    name = model.mesh(form).name if kind == "mesh" else f"field_{model.hfield(form).name}"
    return name if _FILE_NAME.fullmatch(name) else str(form)


def _surrounding_box(
    model: mujoco.MjModel, geom: int, position: Vector, rotation: Matrix
) -> tuple[tuple[float, float, float], Vector, Matrix]:
    """Returns half extents, centre and rotation of the box around a geom that is rotated by quarter turns only."""
    x, y, z = (float(value) for value in np.abs(rotation) @ model.geom_aabb[geom, 3:])
    return (x, y, z), position + rotation @ model.geom_aabb[geom, :3], np.eye(3)


def _half(kind: Kind, size: Vector) -> tuple[float, float, float]:
    first, second, third = (float(value) for value in size)
    if kind == "sphere":
        return first, first, first
    if kind in ("cylinder", "capsule"):
        return first, first, second
    return first, second, third


def matrix_of(quaternion: Vector) -> Matrix:
    """Converts a quaternion (w, x, y, z) to a rotation matrix, exact for quarter turns."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion / np.linalg.norm(quaternion))
    nearest = np.round(matrix)
    # MJCF is written with six digits.
    return np.where(np.abs(matrix - nearest) < 2e-6, nearest, matrix).reshape(3, 3)


def _material_colors(model: mujoco.MjModel) -> list[Vector]:
    """Returns the mean colour (RGBA from 0 to 1) of every material of the model, textures included."""
    colors = []
    for material in range(model.nmat):
        color = model.mat_rgba[material].astype(np.float64)
        pixels = texture_pixels(model, material)
        if pixels is not None:
            color[:3] *= pixels[..., :3].mean(axis=(0, 1)) / 255
        colors.append(color)
    return colors


def texture_pixels(model: mujoco.MjModel, material: int) -> NDArray[np.uint8] | None:
    """Returns the texture image of a material, rows from top to bottom; `None` for a plain colour."""
    texture = int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    if texture < 0:
        return None
    shape = (model.tex_height[texture], model.tex_width[texture], model.tex_nchannel[texture])
    start = int(model.tex_adr[texture])
    return model.tex_data[start : start + int(np.prod(shape))].reshape(shape)


def texture_name(model: mujoco.MjModel, material: int) -> str:
    """Returns the name of a material's texture; the material must have one."""
    return model.tex(int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])).name


def texture_file(scene: Scene, material: int) -> str | None:
    """Returns the path of a material's texture file among the world's files; `None` if there is no file.

    Only PNG files inside the world's own folder count; the path is relative to that folder.
    """
    texture = int(scene.model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    start = int(scene.model.tex_pathadr[texture]) if texture >= 0 else -1
    if start < 0 or scene.folder is None:
        return None
    # MuJoCo tells it from where the process is.
    path = Path(scene.model.paths[start:].split(b"\0", 1)[0].decode()).resolve()
    folder = scene.folder.resolve()
    inside = path.suffix == ".png" and path.is_relative_to(folder) and path.is_file()
    return path.relative_to(folder).as_posix() if inside else None


def material_png(scene: Scene, material: int) -> bytes:
    """Returns a material's texture as PNG: the content of its file, or made from its pixels; it must have a texture."""
    if scene.folder is not None and (name := texture_file(scene, material)) is not None:
        return (scene.folder / name).read_bytes()
    pixels, png = texture_pixels(scene.model, material), BytesIO()
    assert pixels is not None
    Image.fromarray(pixels.squeeze()).save(png, "PNG")
    return png.getvalue()


def _body_thing(model: mujoco.MjModel, body: int, labels: dict[str, str], colors: list[Vector]) -> Thing:
    name = model.body(body).name or f"body_{body}"
    shapes = tuple(
        replace(shape, name=shape.name.removeprefix(f"{name}."))
        for shape in (_shape(model, int(geom), colors) for geom in np.flatnonzero(model.geom_bodyid == body))
    )
    return Thing(
        name=name,
        kind="body",
        label=labels.get(name) or _size_label(name, shapes),
        position=model.body_pos[body].copy(),
        rotation=matrix_of(model.body_quat[body]),
        shapes=shapes,
        inertia=_inertia(model, body),
        joint=_joint(model, body, name),
        hung=tuple(
            _body_thing(model, int(inner), labels, colors) for inner in np.flatnonzero(model.body_parentid == body)
        ),
    )


def _size_label(name: str, shapes: tuple[Shape, ...]) -> str:
    """Returns the label of a body that `world.json` does not list as furniture, from kind and size.

    `door 850x40x2050`.
    """
    spans = np.array([np.abs(shape.rotation) @ shape.half for shape in shapes if shape.collides] or [np.zeros(3)])
    centers = np.array([shape.position for shape in shapes if shape.collides] or [np.zeros(3)])
    size = (centers + spans).max(axis=0) - (centers - spans).min(axis=0)
    return f"{name.rstrip('-_0123456789')} {'x'.join(f'{1000 * extent:.0f}' for extent in size)}"


def _inertia(model: mujoco.MjModel, body: int) -> Inertia:
    axes = matrix_of(model.body_iquat[body])
    moments = axes @ np.diag(model.body_inertia[body]) @ axes.T
    return Inertia(float(model.body_mass[body]), model.body_ipos[body].copy(), moments)


def _joint(model: mujoco.MjModel, body: int, name: str) -> Joint | None:
    count, joint = int(model.body_jntnum[body]), int(model.body_jntadr[body])
    kind = int(model.jnt_type[joint]) if count else -1
    if count == 1 and kind == mujoco.mjtJoint.mjJNT_FREE:
        return None
    if count != 1 or kind not in _JOINT_KINDS:
        raise ValueError(f"body {name!r}: exports hold bodies with one free, hinge, slide or ball joint")
    is_ball = kind == mujoco.mjtJoint.mjJNT_BALL
    now = 0.0 if is_ball else float(model.qpos0[model.jnt_qposadr[joint]])
    limited = bool(model.jnt_limited[joint]) and not is_ball
    lower, upper = (float(limit) - now for limit in model.jnt_range[joint])
    freedom = int(model.jnt_dofadr[joint])
    return Joint(
        kind=_JOINT_KINDS[kind],
        position=model.jnt_pos[joint].copy(),
        axis=model.jnt_axis[joint].copy(),
        lower=lower if limited else -UNLIMITED_RAD,
        upper=upper if limited else UNLIMITED_RAD,
        damping=float(model.dof_damping[freedom]),
        friction=float(model.dof_frictionloss[freedom]),
    )
