"""Writes models in SDF 1.6, which Gazebo 9, Gazebo 11 and Gazebo Sim read.

That version has boxes, cylinders, spheres, planes and meshes. Visible ellipsoids become meshes, and colliding ones
boxes of the same volume; a capsule becomes a cylinder and two spheres. Terrain is a mesh, as Gazebo reads height maps
of some pictures only.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from math import asin, atan2, pi
from pathlib import PurePosixPath

import numpy as np

from .export_meshes import (
    compiled_mesh,
    drawn_mesh,
    is_pictured,
    obj_text,
    picture_coordinates,
    terrain_mesh,
    unit_mesh,
)
from .export_scene import Inertia, Joint, Matrix, Placed, Scene, Shape, Thing, Vector, texture_file, with_hung

SDF_VERSION = "1.6"

_ENDLESS_PLANE_M = 100.0
"""Side of an infinite plane in the SDF, where SDF requires a size, in metres."""
_SAME_VOLUME = (pi / 6) ** (1 / 3)
"""Factor from an ellipsoid's extents to those of a box of the same volume."""
_TERRAIN_DIGITS = 8
"""Significant digits of terrain coordinates: terrain may be kilometres wide, and a millimetre counts."""
_SPECULAR = "0.05 0.05 0.05 1"

Pictures = dict[str, tuple[str, str]]
"""Paths of mesh file and texture file, relative to the model's folder, by the name of the shape that has them."""


def model_files(thing: Thing, name: str, scene: Scene) -> dict[str, str]:
    """Returns the files of a Gazebo model: `model.config`, `model.sdf` and meshes.

    Args:
        thing: Object that is converted; only a building has texture files, which are beside the model.
        name: The model's name, which is its folder's.
        scene: The world that the thing is from.
    """
    meshes: dict[str, str] = {}
    pictures: Pictures = {}
    for shape in (shape for part in _parts(thing) for shape in part.thing.shapes):
        if (picture := _picture(thing, shape, scene)) is not None:
            path, mesh = f"meshes/{shape.name}_drawn.obj", drawn_mesh(scene.model, shape)
            pictures[shape.name] = path, picture
            look = PurePosixPath(picture).stem
            meshes[path] = obj_text(mesh, picture_coordinates(scene.model, shape, mesh), look)
            # Gazebo 9 and 11 know no PBR materials.
            meshes[f"meshes/{look}.mtl"] = f"newmtl {look}\nKd 1 1 1\nmap_Kd ../{picture}\n"
        if shape.kind == "ellipsoid" and shape.drawn:
            meshes[_mesh_path(shape)] = _ellipsoid_obj()
        elif shape.kind == "mesh" and (shape.collides or shape.name not in pictures):
            meshes[_mesh_path(shape)] = obj_text(compiled_mesh(scene.model, shape.mesh))
        elif shape.kind == "terrain":
            meshes[_mesh_path(shape)] = obj_text(terrain_mesh(scene.model, shape.mesh), digits=_TERRAIN_DIGITS)
    return {"model.config": _config(thing, name), "model.sdf": model_sdf(thing, name, pictures), **meshes}


def _picture(thing: Thing, shape: Shape, scene: Scene) -> str | None:
    """Returns the path of a shape's texture file in the world's bundle; `None` if it has none."""
    pictured = thing.kind == "building" and shape.drawn and not shape.endless and is_pictured(scene.model, shape)
    return texture_file(scene, shape.material) if pictured else None


def _parts(thing: Thing) -> list[Placed]:
    """Lists an object and the objects that hang on it, with poses in the frame of the object."""
    return list(with_hung(thing, np.zeros(3), np.eye(3)))


def model_sdf(thing: Thing, name: str, pictures: Pictures) -> str:
    """Returns a model as SDF text: static unless it moves, a link and a joint for it and for each that hangs on it."""
    root = ET.Element("sdf", version=SDF_VERSION)
    model = ET.SubElement(root, "model", name=name)
    _text(model, "static", "false" if thing.inertia else "true")
    parts = _parts(thing)
    # Equal models have equal links: their names do not depend on the world.
    names = {id(part): f"link_{number}" if number else "link" for number, part in enumerate(parts)}
    for part in parts:
        link = ET.SubElement(model, "link", name=names[id(part)])
        _placed(link, part.position, part.rotation)
        if part.thing.inertia:
            _inertial(link, part.thing.inertia)
        for shape in part.thing.shapes:
            for simple in _simple_collisions(shape):
                _collision(link, simple, name)
            for simple in _simple_visuals(shape):
                _visual(link, simple, name, pictures.get(shape.name))
    for part in parts:
        if part.thing.joint:
            above = "world" if part.above is None else names[id(part.above)]
            _joint(model, part.thing.joint, above, names[id(part)])
    return xml_text(root)


def xml_text(root: ET.Element) -> str:
    """Formats an XML document with indentation."""
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'


def numbers(values: Iterable[float], digits: int = 4) -> str:
    """Formats numbers for SDF, rounded to some digits, with blanks between them: `1 0.5 0`."""
    return " ".join(f"{round(float(value), digits) + 0.0:.10g}" for value in values)


def pose_text(position: Vector, rotation: Matrix) -> str:
    """Formats a pose for SDF: x, y, z (m), roll, pitch and yaw (rad), as `1 2 0 0 0 1.570796`."""
    return f"{numbers(position)} {numbers(_roll_pitch_yaw(rotation), 6)}"


def _roll_pitch_yaw(rotation: Matrix) -> tuple[float, float, float]:
    sine = min(1.0, max(-1.0, -float(rotation[2, 0])))
    if abs(sine) > 1 - 1e-9:  # roll and yaw turn about the same axis
        return 0.0, asin(sine), atan2(-rotation[0, 1], rotation[1, 1])
    return atan2(rotation[2, 1], rotation[2, 2]), asin(sine), atan2(rotation[1, 0], rotation[0, 0])


def _text(parent: ET.Element, tag: str, text: str) -> ET.Element:
    child = ET.SubElement(parent, tag)
    child.text = text
    return child


def _placed(parent: ET.Element, position: Vector, rotation: Matrix) -> None:
    if position.any() or not np.array_equal(rotation, np.eye(3)):
        _text(parent, "pose", pose_text(position, rotation))


def _simple_collisions(shape: Shape) -> Iterator[Shape]:
    if not shape.collides:
        return
    if shape.kind == "ellipsoid":
        half = (shape.half[0] * _SAME_VOLUME, shape.half[1] * _SAME_VOLUME, shape.half[2] * _SAME_VOLUME)
        yield replace(shape, kind="box", half=half)
    else:
        yield from _without_capsules(shape)


def _simple_visuals(shape: Shape) -> Iterator[Shape]:
    if not shape.drawn or shape.color[3] <= 0:
        return
    if shape.ceiling and shape.kind == "box":
        underside = shape.position - shape.rotation[:, 2] * shape.half[2]
        # Drawn from one side only, so that a view from above shows the rooms.
        yield replace(shape, kind="plane", position=underside, half=(*shape.half[:2], 0.0))
    else:
        yield from _without_capsules(shape)


def _without_capsules(shape: Shape) -> Iterator[Shape]:
    if shape.kind != "capsule":
        yield shape
        return
    radius, _, half_length = shape.half
    yield replace(shape, kind="cylinder")
    for side, name in ((1.0, "head"), (-1.0, "foot")):
        position = shape.position + side * half_length * shape.rotation[:, 2]
        yield replace(
            shape, name=f"{shape.name}-{name}", kind="sphere", position=position, half=(radius, radius, radius)
        )


def _collision(link: ET.Element, shape: Shape, model: str) -> None:
    # Nothing else in a link may have a collision's name, not even a visual.
    collision = ET.SubElement(link, "collision", name=f"{shape.name}-collision")
    _placed(collision, shape.position, shape.rotation)
    _geometry(collision, shape, model)
    friction = ET.SubElement(ET.SubElement(collision, "surface"), "friction")
    ode = ET.SubElement(friction, "ode")
    _text(ode, "mu", numbers([shape.friction]))
    _text(ode, "mu2", numbers([shape.friction]))


def _visual(link: ET.Element, shape: Shape, model: str, pictured: tuple[str, str] | None) -> None:
    visual = ET.SubElement(link, "visual", name=shape.name)
    _placed(visual, shape.position, shape.rotation)
    if pictured is None:
        _geometry(visual, shape, model)
    else:
        _text(ET.SubElement(ET.SubElement(visual, "geometry"), "mesh"), "uri", f"model://{model}/{pictured[0]}")
    if shape.ceiling:
        _text(visual, "cast_shadows", "false")
    if shape.color[3] < 1:
        _text(visual, "transparency", numbers([1 - shape.color[3]]))
    material = ET.SubElement(visual, "material")
    # A picture is multiplied by the colour.
    color = numbers(shape.color, 3) if pictured is None else numbers([1, 1, 1, shape.color[3]], 3)
    for tag, value in (("ambient", color), ("diffuse", color), ("specular", _SPECULAR)):
        _text(material, tag, value)
    if pictured is not None:
        metal = ET.SubElement(ET.SubElement(material, "pbr"), "metal")
        _text(metal, "albedo_map", f"model://{model}/{pictured[1]}")
        _text(metal, "metalness", "0")
        _text(metal, "roughness", "0.85")


def _geometry(parent: ET.Element, shape: Shape, model: str) -> None:
    geometry = ET.SubElement(parent, "geometry")
    kind = "mesh" if shape.kind in ("ellipsoid", "terrain") else shape.kind
    element = ET.SubElement(geometry, kind)
    size = [2 * half for half in shape.half]
    if kind == "box":
        _text(element, "size", numbers(size))
    elif kind == "sphere":
        _text(element, "radius", numbers(shape.half[:1]))
    elif kind == "cylinder":
        _text(element, "radius", numbers(shape.half[:1]))
        _text(element, "length", numbers(size[2:]))
    elif kind == "plane":
        _text(element, "normal", "0 0 -1" if shape.ceiling else "0 0 1")
        _text(element, "size", numbers(side or _ENDLESS_PLANE_M for side in size[:2]))
    else:
        _text(element, "uri", f"model://{model}/{_mesh_path(shape)}")
        if shape.kind == "ellipsoid":
            _text(element, "scale", numbers(shape.half))


@cache
def _ellipsoid_obj() -> str:
    return obj_text(unit_mesh("ellipsoid"))


def _mesh_path(shape: Shape) -> str:
    return "meshes/ellipsoid.obj" if shape.kind == "ellipsoid" else f"meshes/mesh_{shape.mesh_name}.obj"


def _inertial(link: ET.Element, inertia: Inertia) -> None:
    inertial = ET.SubElement(link, "inertial")
    _placed(inertial, inertia.position, np.eye(3))
    _text(inertial, "mass", numbers([inertia.mass_kg]))
    moments = ET.SubElement(inertial, "inertia")
    for row, column, tag in ((0, 0, "ixx"), (0, 1, "ixy"), (0, 2, "ixz"), (1, 1, "iyy"), (1, 2, "iyz"), (2, 2, "izz")):
        _text(moments, tag, f"{inertia.moments[row, column] + 0.0:.6g}")


def _joint(model: ET.Element, joint: Joint, parent: str, child: str) -> None:
    element = ET.SubElement(model, "joint", name=child.replace("link", "joint"), type=joint.kind)
    _placed(element, joint.position, np.eye(3))
    _text(element, "parent", parent)
    _text(element, "child", child)
    if joint.kind == "ball":
        return
    axis = ET.SubElement(element, "axis")
    _text(axis, "xyz", numbers(joint.axis))
    limit = ET.SubElement(axis, "limit")
    _text(limit, "lower", numbers([joint.lower], 6))
    _text(limit, "upper", numbers([joint.upper], 6))
    dynamics = ET.SubElement(axis, "dynamics")
    _text(dynamics, "damping", numbers([joint.damping]))
    _text(dynamics, "friction", numbers([joint.friction]))


def _config(thing: Thing, name: str) -> str:
    root = ET.Element("model")
    _text(root, "name", name)
    _text(root, "version", "1.0")
    _text(root, "sdf", "model.sdf").set("version", SDF_VERSION)
    author = ET.SubElement(root, "author")
    _text(author, "name", "prefect-robomaker")
    _text(root, "description", thing.label)
    return xml_text(root)
