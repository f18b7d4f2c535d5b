"""Outlines of solid parts between two heights, seen from above."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterator
from math import pi

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ....schemas.worlds.world import Point

_ROUND = 24
"""Corners of a circle."""

Points = NDArray[np.float64]


def solid_outlines(
    model: mujoco.MjModel, data: mujoco.MjData, low_m: float, high_m: float
) -> Iterator[tuple[int, list[Point]]]:
    """Yields the outlines of all solid parts between two heights, with their geom numbers.

    Planes and height fields have none.

    Args:
        model: a world.
        data: where everything is; needs what `mj_kinematics` computes.
        low_m: the lower height.
        high_m: the upper height.
    """
    solid = model.geom_contype | model.geom_conaffinity != 0
    endless = (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) | (model.geom_type == mujoco.mjtGeom.mjGEOM_HFIELD)
    for geom in np.flatnonzero(solid & ~endless):
        corners = data.geom_xpos[geom] + _corners(model, int(geom)) @ data.geom_xmat[geom].reshape(3, 3).T
        inside = _between(corners, low_m, high_m)
        if len(inside) < 3:
            continue
        try:
            yield int(geom), [(float(x), float(y)) for x, y in inside[ConvexHull(inside).vertices]]
        except QhullError:
            continue  # it has no width


def _corners(model: mujoco.MjModel, geom: int) -> Points:
    """Corners of a convex part, or of what stands for its roundness, in its own frame."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        return np.asarray(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], np.float64)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        x, y = _circle()
        return np.array([(size[0] * u, size[0] * v, z) for z in (-size[1], size[1]) for u, v in zip(x, y, strict=True)])
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID, mujoco.mjtGeom.mjGEOM_CAPSULE):
        half = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size[0])
        up = size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
        x, y = _circle()
        ball = [
            (u * np.cos(tilt), v * np.cos(tilt), np.sin(tilt))
            for tilt in np.linspace(-pi / 2, pi / 2, _ROUND // 2 + 1)
            for u, v in zip(x, y, strict=True)
        ]
        return np.concatenate([np.array(ball) * half + (0.0, 0.0, shift) for shift in {-up, up}])
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    return signs * size


def _circle() -> tuple[Points, Points]:
    angles = np.arange(_ROUND) * (2 * pi / _ROUND)
    return np.cos(angles), np.sin(angles)


def _between(corners: Points, low_m: float, high_m: float) -> Points:
    """Possible corners of a convex body between two heights, seen from above."""
    heights = corners[:, 2]
    found = [corners[(heights >= low_m) & (heights <= high_m), :2]]
    for level in (low_m, high_m):
        # Lines between corners below and above the level; those inside the body do no harm.
        below, above = corners[heights < level], corners[heights > level]
        if len(below) and len(above):
            share = (level - below[:, None, 2]) / (above[None, :, 2] - below[:, None, 2])
            cut = below[:, None, :2] + share[..., None] * (above[None, :, :2] - below[:, None, :2])
            found.append(cut.reshape(-1, 2))
    return np.concatenate(found)
