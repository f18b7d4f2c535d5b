"""Footprint radius of a model: how far its parts reach from the middle, seen from above."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

import math
from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray

_GEOM = mujoco.mjtGeom
_DIRECTIONS = 720
"""Horizontal directions that round parts are measured in; what lies between two is missed by 1e-5 of the reach."""
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))

_Points = NDArray[np.float64]


def solid_reach_m(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Returns the largest horizontal distance in m from the origin of anything that can be touched."""
    solid = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    return max((geom_reach_m(model, data, geom) for geom in solid.tolist()), default=0.0)


def geom_reach_m(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """Returns the largest horizontal distance in m of a geom's surface from the origin.

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
    """Horizontal unit vectors all around, beginning with the one that leads to a geom's middle."""
    angles = math.atan2(middle[1], middle[0]) + np.linspace(0.0, 2 * math.pi, _DIRECTIONS, endpoint=False)
    return np.column_stack((np.cos(angles), np.sin(angles)))


def _widest_m(middle: _Points, width_m: _Points) -> float:
    """The reach of a convex shape is the largest value of its support function."""
    return float((_directions(middle) @ middle[:2] + width_m).max())


def _farthest_m(points: _Points) -> float:
    return float(np.hypot(points[:, 0], points[:, 1]).max())
