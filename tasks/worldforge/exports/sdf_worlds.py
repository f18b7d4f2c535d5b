"""Worlds as SDF, and the models that they share: equal furniture, objects and doors are stored once."""

import hashlib
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from math import tan

import numpy as np

from .export_scene import BUILDING, Joint, Matrix, Scene, Shape, Thing
from .sdf import SDF_VERSION, model_files, pose_text, xml_text

_SAME_M = 6e-4
"""Largest difference of coordinates of equal pieces, in metres.

The MJCF's numbers have four digits, poses in `world.json` three.
"""


class SharedModels:
    """Gazebo models shared by exported worlds, each written once."""

    def __init__(self) -> None:
        self.files: dict[str, dict[str, str]] = {}
        """Files of each shared Gazebo model's folder, by the model's name."""
        self._things: dict[str, Thing] = {}

    def add(self, thing: Thing, scene: Scene) -> str:
        """Adds a model for an object unless an equal one exists; returns the model's name.

        The name depends on the thing alone: worlds exported at different times share models.
        """
        square = _square(thing)
        first = name = f"{slug(thing.label)}_{_digest(square, scene)}"
        number = 1
        while name in self._things:
            if _equal(self._things[name], square):
                return name
            number += 1
            name = f"{first}_{number}"
        self._things[name] = square
        self.files[name] = model_files(square, name, scene)
        return name


def slug(text: str) -> str:
    """Converts a text to a file name: small letters, digits and underscores."""
    return re.sub(r"[^a-z0-9]+", "_", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", text).lower()).strip("_")


def _square(thing: Thing) -> Thing:
    shapes, hung = tuple(_squared(shape) for shape in thing.shapes), tuple(_square(inner) for inner in thing.hung)
    return replace(thing, shapes=shapes, hung=hung)


def _squared(shape: Shape) -> Shape:
    """Returns a shape with swapped sizes and without rotation, where that is the same shape.

    Equal pieces that are turned in the room have swapped sizes in the MJCF, and would look different.
    """
    turned = np.abs(shape.rotation)
    # Bricks on a box run along its own axes; boxes of SDF have plain colours.
    if shape.kind in ("box", "ellipsoid") and _is_permutation(turned):
        first, second, third = (float(value) for value in turned @ shape.half)
        return replace(shape, half=(first, second, third), rotation=np.eye(3))
    if shape.kind == "sphere":
        return replace(shape, rotation=np.eye(3))
    if shape.kind in ("cylinder", "capsule") and turned[:, 2].max() > 1 - 1e-6:
        return replace(shape, rotation=_AXES[int(turned[:, 2].argmax())])
    return shape


_AXES: tuple[Matrix, ...] = (
    np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    np.eye(3),
)
"""Rotation matrices that turn the z axis to x, y and z."""


def _is_permutation(turned: Matrix) -> bool:
    return bool(np.all((turned < 1e-6) | (turned > 1 - 1e-6)))


def _digest(thing: Thing, scene: Scene) -> str:
    """Returns a digest that distinguishes objects with equal labels, by their parts and the generator that made them.

    Sizes and places of parts are left out, as rounding differs from piece to piece.
    """
    text = repr((scene.world.generator_version, thing.label, *_told(thing)))
    return hashlib.sha256(text.encode()).hexdigest()[:6]


def _told(thing: Thing) -> tuple[object, ...]:
    parts = [(shape.name, shape.kind, shape.color, shape.drawn, shape.collides) for shape in thing.shapes]
    joint = thing.joint and (thing.joint.kind, *(round(value, 2) for value in _joint_values(thing.joint)))
    return parts, joint, *(_told(inner) for inner in thing.hung)


def _joint_values(joint: Joint) -> tuple[float, ...]:
    return (*joint.position, *joint.axis, joint.lower, joint.upper, joint.damping, joint.friction)


def _equal(first: Thing, second: Thing) -> bool:
    if bool(first.inertia) != bool(second.inertia) or len(first.shapes) != len(second.shapes):
        return False
    if first.inertia and second.inertia and not np.isclose(first.inertia.mass_kg, second.inertia.mass_kg, rtol=1e-3):
        return False
    if len(first.hung) != len(second.hung) or not all(map(_hang_alike, first.hung, second.hung)):
        return False
    return all(_equal_shapes(*pair) for pair in zip(first.shapes, second.shapes, strict=True))


def _hang_alike(first: Thing, second: Thing) -> bool:
    """Whether the bodies attached to two equal objects are equal and attached in the same way."""
    joints = [_joint_values(each.joint) if each.joint else () for each in (first, second)]
    away = max(np.abs(first.position - second.position).max(), np.abs(first.rotation - second.rotation).max())
    alike = len(joints[0]) == len(joints[1]) and np.allclose(*joints, atol=_SAME_M)
    return bool(away < _SAME_M) and alike and _equal(first, second)


def _equal_shapes(first: Shape, second: Shape) -> bool:
    return (
        (first.name, first.kind, first.color, first.friction)
        == (second.name, second.kind, second.color, second.friction)
        and bool(np.abs(first.position - second.position).max() < _SAME_M)
        and max(abs(a - b) for a, b in zip(first.half, second.half, strict=True)) < _SAME_M
        and bool(np.abs(first.rotation - second.rotation).max() < 1e-3)
    )


_FIELD_OF_VIEW_RAD = 1.047
"""Field of view of the camera of Gazebo's window, in radians."""


@dataclass(frozen=True, slots=True)
class SdfWorld:
    """Gazebo files that belong to one exported world alone."""

    world: str
    """Content of the Gazebo `.world` file."""
    building: dict[str, str]
    """Files of the building's Gazebo model, by path."""
    models: tuple[str, ...]
    """Names of the shared models that the world includes, each once."""


def sdf_world(scene: Scene, name: str, shared: SharedModels) -> SdfWorld:
    """Converts a world to a Gazebo SDF world; its building becomes a model of the world's name.

    Args:
        scene: The world.
        name: Name of the world in archives.
        shared: Gets the models that are not in it yet.
    """
    root = ET.Element("sdf", version=SDF_VERSION)
    world = ET.SubElement(root, "world", name=name)
    _add(world, "gravity", "0 0 -9.81")
    _physics(world)
    _light(world)
    _window(world, scene)
    building, *others = scene.things
    _include(world, BUILDING, name, "0 0 0 0 0 0")
    used: list[str] = []
    for thing in others:
        model = shared.add(thing, scene)
        used.append(model)
        _include(world, thing.name, model, pose_text(thing.position, thing.rotation))
    return SdfWorld(xml_text(root), model_files(building, name, scene), tuple(dict.fromkeys(used)))


def _add(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text


def _include(world: ET.Element, name: str, model: str, pose: str) -> None:
    include = ET.SubElement(world, "include")
    _add(include, "name", name)
    _add(include, "uri", f"model://{model}")
    _add(include, "pose", pose)


def _physics(world: ET.Element) -> None:
    physics = ET.SubElement(world, "physics", name="default_physics", default="1", type="ode")
    _add(physics, "max_step_size", "0.001")
    _add(physics, "real_time_factor", "1")
    _add(physics, "real_time_update_rate", "1000")


def _light(world: ET.Element) -> None:
    scene = ET.SubElement(world, "scene")
    _add(scene, "ambient", "0.5 0.5 0.5 1")
    _add(scene, "background", "0.75 0.82 0.88 1")
    _add(scene, "shadows", "true")
    sun = ET.SubElement(world, "light", name="sun", type="directional")
    _add(sun, "cast_shadows", "true")
    _add(sun, "pose", "0 0 10 0 0 0")
    _add(sun, "diffuse", "0.7 0.7 0.68 1")
    _add(sun, "specular", "0.1 0.1 0.1 1")
    _add(sun, "direction", "-0.3 0.4 -0.87")


def _window(world: ET.Element, scene: Scene) -> None:
    """Adds Gazebo's window to an SDF world, with a camera that looks at the whole building from the south."""
    corners = np.array(scene.world.floorplan.footprint)
    x, y = (corners.max(axis=0) + corners.min(axis=0)) / 2
    width, depth = corners.max(axis=0) - corners.min(axis=0)
    distance = max(width, depth * 1.4) / 2 / tan(_FIELD_OF_VIEW_RAD / 2) + scene.world.floorplan.ceiling_height_m
    tilt = 1.1
    camera = ET.SubElement(ET.SubElement(world, "gui"), "camera", name="user_camera")
    position = np.array([x, y - distance * np.cos(tilt), distance * np.sin(tilt)])
    _add(camera, "pose", f"{position[0]:.3f} {position[1]:.3f} {position[2]:.3f} 0 {tilt} 1.570796")
