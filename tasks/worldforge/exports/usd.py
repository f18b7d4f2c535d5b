"""Writes a world as a USD stage with UsdPhysics, for Isaac Sim and other programs.

Every object is an `Xform` of `/World` by its name in `world.json`, its shapes below it. Colliding shapes are
primitives, as in the MJCF; a textured shape is a mesh beside one. Letters that USD's names do not allow are `_`;
`displayName` has the original name.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from math import degrees, radians

import numpy as np

from .export_meshes import drawn_mesh, is_pictured, picture_coordinates
from .export_scene import UNLIMITED_RAD, Inertia, Joint, Matrix, Placed, Scene, Shape, Thing, Vector, with_hung
from .usd_text import Looks, Prim, PrimNames, integers, number, numbers, quaternion, quoted, vectors

_HEAD = """\
#usda 1.0
(
    defaultPrim = "World"
    doc = "Made by prefect-robomaker."
    kilogramsPerUnit = 1
    metersPerUnit = 1
    upAxis = "Z"
)

"""
_MESHES = ("mesh", "ellipsoid", "terrain")
"""Kinds of shapes for which USD has no primitive."""
_PLACED = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]'
_SCALED = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient", "xformOp:scale"]'


def scene_usd(scene: Scene) -> str:
    """Converts a scene to USD text (`.usda`), with textures referenced by path."""
    looks = Looks(scene, "/World")
    root = Prim("Xform", "World", metadata=['kind = "assembly"'])
    physics = Prim("PhysicsScene", "PhysicsScene")
    physics.set("vector3f", "physics:gravityDirection", "(0, 0, -1)")
    physics.set("float", "physics:gravityMagnitude", "9.81")
    sky = Prim("DomeLight", "Sky")
    sky.set("float", "inputs:intensity", "1000")
    names = PrimNames()
    for taken in ("PhysicsScene", "Sky", "Looks"):
        names.take(taken)
    things: list[Prim] = []
    paths: dict[int, str] = {}
    for outermost in scene.things:
        for placed in with_hung(outermost, outermost.position, outermost.rotation):
            name = names.take(placed.thing.name)
            paths[id(placed)] = f"/World/{name}"
            above = "" if placed.above is None else paths[id(placed.above)]
            things.append(_thing(scene, placed, name, looks, above))
    root.children = [physics, sky, looks.scope, *things]
    return _HEAD + "\n".join([*root.lines(), ""])


def _thing(scene: Scene, placed: Placed, name: str, looks: Looks, above: str) -> Prim:
    """Makes the USD prim of an object, next to all others, as rigid bodies do not nest.

    `above` is the path of its parent.
    """
    thing = placed.thing
    prim = Prim("Xform", name, metadata=['kind = "component"', *_called(name, thing.name)])
    prim.metadata.append(f"customData = {{ string label = {quoted(thing.label)} }}")
    _place(prim, placed.position, placed.rotation)
    if thing.inertia:
        prim.schemas += ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
        _weigh(prim, thing.inertia)
        if thing.joint is None:
            prim.set("uniform bool", "physics:startsAsleep", "1")
    names = PrimNames()
    for shape in thing.shapes:
        prim.children += _shapes(scene, shape, names, looks)
    if thing.joint:
        prim.children.append(_joint(thing, thing.joint, names.take("hinge"), f"/World/{name}", above))
    return prim


def _called(name: str, text: str) -> list[str]:
    return [] if name == text else [f"displayName = {quoted(text)}"]


def _place(prim: Prim, position: Vector, rotation: Matrix) -> None:
    prim.set("double3", "xformOp:translate", numbers(position))
    prim.set("quatf", "xformOp:orient", quaternion(rotation))
    prim.attributes.append(_PLACED)


def _weigh(prim: Prim, inertia: Inertia) -> None:
    moments, axes = np.linalg.eigh(inertia.moments)
    if np.linalg.det(axes) < 0:
        axes[:, 2] *= -1
    prim.set("float", "physics:mass", number(inertia.mass_kg))
    prim.set("point3f", "physics:centerOfMass", numbers(inertia.position))
    # These are far below 1.
    prim.set("float3", "physics:diagonalInertia", f"({', '.join(f'{value:.6g}' for value in moments)})")
    prim.set("quatf", "physics:principalAxes", quaternion(axes))


def _shapes(scene: Scene, shape: Shape, names: PrimNames, looks: Looks) -> list[Prim]:
    """Returns the USD prims of a shape: one visible and one colliding, or one that is both.

    A shape that neither is seen nor collides has none.
    """
    seen = shape.drawn and shape.color[3] > 0 and not shape.endless
    pictured = seen and (is_pictured(scene.model, shape) or shape.ceiling)
    as_mesh = shape.kind in _MESHES or pictured
    made = []
    if seen:
        name = names.take(shape.name)
        prim = _mesh(scene, shape, name) if as_mesh else _solid(shape, name)
        prim.metadata += _called(name, shape.name)
        looks.bind(prim, shape)
        made.append(prim)
    if shape.collides and (pictured or not seen):
        name = names.take(f"{shape.name}_collider" if seen else shape.name)
        prim = _mesh(scene, shape, name) if shape.kind in _MESHES else _solid(shape, name)
        prim.metadata += _called(name, shape.name)
        prim.set("uniform token", "purpose", '"guide"')
        made.append(prim)
    if shape.collides:
        prim = made[-1]
        prim.schemas.append("PhysicsCollisionAPI")
        if prim.kind == "Mesh":
            prim.schemas.append("PhysicsMeshCollisionAPI")
            # The hull of terrain would fill its valleys.
            form = "none" if shape.kind == "terrain" else "convexHull"
            prim.set("uniform token", "physics:approximation", quoted(form))
        looks.bind_friction(prim, shape.friction)
    return made


def _solid(shape: Shape, name: str) -> Prim:
    """Makes a USD primitive (cube, plane, sphere, cylinder, ...) of a shape, at its pose in the frame of its link."""
    x, y, z = shape.half
    if shape.kind == "box":
        prim = Prim("Cube", name)
        prim.set("double", "size", "2")
        prim.set("float3[]", "extent", "[(-1, -1, -1), (1, 1, 1)]")
        _place(prim, shape.position, shape.rotation)
        prim.attributes[-1] = f"float3 xformOp:scale = {numbers(shape.half)}"
        prim.attributes.append(_SCALED)
        return prim
    prim = Prim(shape.kind.capitalize(), name)
    if shape.kind == "plane":
        prim.set("uniform token", "axis", '"Z"')
        if not shape.endless:
            prim.set("double", "width", number(2 * x))
            prim.set("double", "length", number(2 * y))
    else:
        prim.set("double", "radius", number(x))
        if shape.kind != "sphere":
            prim.set("uniform token", "axis", '"Z"')
            prim.set("double", "height", number(2 * z))
        reach = np.array([x, y, z + x if shape.kind == "capsule" else z])
        prim.set("float3[]", "extent", vectors(np.array([-reach, reach])))
    _place(prim, shape.position, shape.rotation)
    return prim


def _mesh(scene: Scene, shape: Shape, name: str) -> Prim:
    mesh = drawn_mesh(scene.model, shape)
    prim = Prim("Mesh", name)
    underside = shape.ceiling and shape.kind == "box"
    _place(prim, shape.position - shape.rotation[:, 2] * shape.half[2] * underside, shape.rotation)
    prim.set("float3[]", "extent", vectors(np.array([mesh.positions.min(axis=0), mesh.positions.max(axis=0)])))
    prim.set("int[]", "faceVertexCounts", integers([3] * len(mesh.triangles)))
    prim.set("int[]", "faceVertexIndices", integers(mesh.triangles.ravel().tolist()))
    prim.set("point3f[]", "points", vectors(mesh.positions))
    where = f'(\n        interpolation = "{"faceVarying" if mesh.flat else "vertex"}"\n    )'
    prim.attributes.append(f"normal3f[] normals = {vectors(mesh.normals, times=3 if mesh.flat else 1)} {where}")
    prim.set("uniform token", "subdivisionScheme", '"none"')
    if is_pictured(scene.model, shape):
        places = vectors(picture_coordinates(scene.model, shape, mesh))
        prim.attributes.append(f"texCoord2f[] primvars:st = {places} {where}")
    return prim


_JOINTS = {"revolute": "PhysicsRevoluteJoint", "prismatic": "PhysicsPrismaticJoint", "ball": "PhysicsSphericalJoint"}


def _joint(thing: Thing, joint: Joint, name: str, body: str, above: str) -> Prim:
    """Makes a USD joint with the world or a parent body, at position 0 in the body's pose.

    The joint's axis is the z axis of its frames.
    """
    frame = _frame_along(joint.axis)
    turning = joint.kind == "revolute"
    prim = Prim(_JOINTS[joint.kind], name)
    prim.set("uniform token", "physics:axis", '"Z"')
    if above:
        prim.set("rel", "physics:body0", f"<{above}>")
    prim.set("rel", "physics:body1", f"<{body}>")
    prim.set("point3f", "physics:localPos0", numbers(thing.position + thing.rotation @ joint.position))
    prim.set("quatf", "physics:localRot0", quaternion(thing.rotation @ frame))
    prim.set("point3f", "physics:localPos1", numbers(joint.position))
    prim.set("quatf", "physics:localRot1", quaternion(frame))
    if joint.kind == "ball":
        return prim
    if joint.upper < UNLIMITED_RAD:
        for side, limit in (("lower", joint.lower), ("upper", joint.upper)):
            prim.set("float", f"physics:{side}Limit", number(degrees(limit) if turning else limit))
    drive = "angular" if turning else "linear"
    prim.schemas.append(f"PhysicsDriveAPI:{drive}")
    # USD counts in degrees.
    prim.set("float", f"drive:{drive}:physics:damping", f"{radians(joint.damping) if turning else joint.damping:.6g}")
    prim.set("float", f"drive:{drive}:physics:stiffness", "0")
    return prim


def _frame_along(axis: Vector) -> Matrix:
    """Returns the rotation matrix of a frame whose z axis is the given axis."""
    z = axis / np.linalg.norm(axis)
    aside = np.eye(3)[int(np.abs(z).argmin())]
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
