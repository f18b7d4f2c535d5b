"""Checks of a robot's size: parts in a wrong unit, no collision shapes, parts beyond the footprint."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import math
from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray

from .mapping import invalid
from .model import ModelBuilder, RobotFiles
from .shape import RobotModel

_OVERHANG_M = 0.01
"""Length in metres by which parts may stick out of the footprint before a warning."""

_TOO_LARGE = 20
"""Maximum extent of a robot's parts, in radii of its footprint.

This detects parts in millimetres from a fiftieth of the radius on, those in inches from half of it on.
"""

_TOO_SMALL = 100
"""Divisor of the footprint's radius that gives the minimum extent of a robot; a model in millimetres that is scaled
twice is 1000 times too small.
"""

_GEOM = mujoco.mjtGeom
_DIRECTIONS = 720
"""Number of horizontal directions in which the extent of round parts is measured; the error is at most 1e-5 of the
extent.
"""
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))

_Points = NDArray[np.float64]


def solid_reach_m(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Returns the largest horizontal distance from the origin of anything that collides, in metres."""
    solid = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    return max((geom_reach_m(model, data, geom) for geom in solid.tolist()), default=0.0)


def geom_reach_m(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """Returns the largest horizontal distance of a geom's surface from the origin, in metres.

    Boxes, meshes (by their vertices), spheres and capsules are exact, and so are cylinders and ellipsoids that stand
    upright. Others are measured by their bounding boxes.
    """
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    middle, axes = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
    if kind == _GEOM.mjGEOM_SPHERE.value:
        return math.hypot(middle[0], middle[1]) + float(size[0])
    if kind == _GEOM.mjGEOM_CAPSULE.value:
        ends = np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]])
        return _farthest_m(middle + ends @ axes.T) + float(size[0])
    if kind == _GEOM.mjGEOM_CYLINDER.value:
        along = _directions(middle) @ axes[:2, 2]
        width = size[0] * np.sqrt(np.maximum(0.0, 1.0 - along**2)) + size[1] * np.abs(along)
        return _widest_m(middle, width)
    if kind == _GEOM.mjGEOM_ELLIPSOID.value:
        return _widest_m(middle, np.linalg.norm(_directions(middle) @ axes[:2] * size, axis=1))
    return _farthest_m(middle + _points(model, geom) @ axes.T)


def _points(model: mujoco.MjModel, geom: int) -> _Points:
    """Returns the outer points of a geom in its own frame: a mesh's vertices, else the corners of its bounding box."""
    mesh = int(model.geom_dataid[geom])
    if int(model.geom_type[geom]) == _GEOM.mjGEOM_MESH.value and mesh >= 0:
        first = int(model.mesh_vertadr[mesh])
        return np.asarray(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], dtype=float)
    return model.geom_aabb[geom, :3] + _CORNERS * model.geom_aabb[geom, 3:]


def _directions(middle: _Points) -> _Points:
    """Returns horizontal unit vectors all around, beginning with the direction to a geom's centre."""
    angles = math.atan2(middle[1], middle[0]) + np.linspace(0.0, 2 * math.pi, _DIRECTIONS, endpoint=False)
    return np.column_stack((np.cos(angles), np.sin(angles)))


def _widest_m(middle: _Points, width_m: _Points) -> float:
    """Returns the largest horizontal distance of a convex shape from the origin in metres, by its support function."""
    return float((_directions(middle) @ middle[:2] + width_m).max())


def _farthest_m(points: _Points) -> float:
    return float(np.hypot(points[:, 0], points[:, 1]).max())


def check_shapes(model: mujoco.MjModel, where: str) -> None:
    """Raises `LaunchError` for a robot without collision shapes, which would go through walls unnoticed."""
    collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    if not (collides & (model.geom_bodyid > 0)).any():
        raise invalid(
            where,
            "model: the robot has no shape that collides, so it would go through walls; give a link of a URDF "
            "or SDF <collision>, or a geom of MJCF contype and conaffinity above 0",
        )


def check_sizes(
    mapping: RobotModel, model: mujoco.MjModel, data: mujoco.MjData, builder: ModelBuilder, files: RobotFiles
) -> None:
    """Raises `LaunchError` for parts of a robot in a unit other than metres, which are far too large or small.

    The measure is the radius of the robot's footprint.
    """
    radius_m, where = mapping.footprint.radius_m, files.mapping.name
    for geom in range(model.ngeom):
        reach_m = geom_reach_m(model, data, geom)
        if reach_m <= _TOO_LARGE * radius_m:
            continue
        said = f"reaches {reach_m:.3g} m from the base's origin, {reach_m / radius_m:.0f} times footprint.radius_m"
        if int(model.geom_type[geom]) != _GEOM.mjGEOM_MESH.value:
            link = model.body(int(model.geom_bodyid[geom])).name
            raise invalid(where, f"footprint.radius_m: a shape of {link!r} {said}, {radius_m:g} m; correct one of them")
        name = model.mesh(int(model.geom_dataid[geom])).name
        use = next((each for each in builder.reading.meshes if each.name == name), None)
        scale = [0.001 * float(each) for each in use.scale.split()] if use is not None and use.scale else [0.001] * 3
        shown = " ".join(f"{each:g}" for each in scale)
        raise invalid(
            f"{files.model}:{use.line}" if use is not None else files.model,
            f"the mesh {use.written if use is not None else name!r} {said}, {radius_m:g} m; lengths are in metres. If "
            f'the mesh is in millimetres, scale="{shown}" is meant in its <mesh>; otherwise correct footprint.radius_m',
        )
    reach_m = solid_reach_m(model, data)
    if reach_m * _TOO_SMALL < radius_m:
        raise invalid(
            where,
            f"footprint.radius_m: what collides of the robot reaches {reach_m:.3g} m from the base's origin and the "
            f"radius is {radius_m:g} m; lengths are in metres, so correct the scale of its meshes or the radius",
        )


def overhang(mapping: RobotModel, model: mujoco.MjModel, data: mujoco.MjData, where: str) -> list[str]:
    """Returns a warning if parts reach beyond the disc of the footprint: planners would drive into obstacles."""
    radius_m, reach_m = mapping.footprint.radius_m, solid_reach_m(model, data)
    if reach_m <= radius_m + _OVERHANG_M:
        return []
    said = f"the radius is {radius_m:g} m; parts reach up to {reach_m:.2f} m from the base's origin"
    return [f"{where}: footprint.radius_m: {said}"]
