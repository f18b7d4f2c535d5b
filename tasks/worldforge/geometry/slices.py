"""Outlines, seen from above, of the solid parts of a MuJoCo model between two heights."""

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
"""Number of corners with which a circle is approximated."""
_UPRIGHT = 1 - 1e-9
"""Cosine of the angle to the vertical up to which a part is upright: 0.04 mm on a metre."""

_BOX, _CYLINDER = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_ENDLESS = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)
"""Geom types without an outline, as integers: comparing an array with an enumeration member takes a millisecond."""
_ROUNDED = tuple(
    int(kind) for kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID, mujoco.mjtGeom.mjGEOM_CAPSULE)
)
_LEVEL_M = 1e-9
"""Difference of heights up to which corners are at the same height, in metres: only the last digits differ."""

Points = NDArray[np.float64]


def solid_outlines(
    model: mujoco.MjModel, data: mujoco.MjData, low_m: float, high_m: float, among: NDArray[np.bool_] | None = None
) -> Iterator[tuple[int, list[Point]]]:
    """Yields the outlines of all solid parts between two heights, counter-clockwise, with their geom numbers.

    Planes and height fields have none.

    Args:
        model: A world.
        data: MuJoCo state of the world, after `mj_kinematics`.
        low_m: The lower height.
        high_m: The upper height.
        among: Mask of the geoms that are looked at; all that collide unless told otherwise.
    """
    solid = model.geom_contype | model.geom_conaffinity != 0 if among is None else among
    endless = np.isin(model.geom_type, _ENDLESS)
    low, high = extents(model, data)
    chosen = solid & ~endless & (low[:, 2] <= high_m) & (high[:, 2] >= low_m)
    upright = {**_upright_boxes(model, data, chosen), **_upright_cylinders(model, data, chosen)}
    for geom in np.flatnonzero(chosen).tolist():
        if geom in upright:
            yield geom, upright[geom]
            continue
        corners = data.geom_xpos[geom] + _corners(model, geom) @ data.geom_xmat[geom].reshape(3, 3).T
        ringed = int(model.geom_type[geom]) in _ROUNDED and data.geom_xmat[geom, 8] > _UPRIGHT
        inside = _between(corners, low_m, high_m, ringed=bool(ringed))
        if len(inside) < 3:
            continue
        try:
            yield geom, [(float(x), float(y)) for x, y in inside[ConvexHull(inside).vertices]]
        except QhullError:
            continue  # it has no width


def extents(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Points, Points]:
    """Returns the lowest and the highest corner of the box around each geom, in metres.

    Args:
        model: A world.
        data: MuJoCo state of the world, after `mj_kinematics`.
    """
    axes, boxes = data.geom_xmat.reshape(-1, 3, 3), model.geom_aabb
    center = data.geom_xpos + (axes @ boxes[:, :3, None])[..., 0]
    half = (np.abs(axes) @ boxes[:, 3:, None])[..., 0]
    return center - half, center + half


def _upright_boxes(model: mujoco.MjModel, data: mujoco.MjData, chosen: NDArray[np.bool_]) -> dict[int, list[Point]]:
    """Returns the outlines of boxes that stand on one of their faces.

    These are most of a world, and a hundred times faster than a hull.
    """
    boxes = np.flatnonzero(chosen & (model.geom_type == _BOX))
    upwards = np.abs(data.geom_xmat[boxes, 6:])
    stands = (upwards > _UPRIGHT) @ np.ones(3) > 0
    boxes, upwards = boxes[stands], upwards[stands]
    axes, sizes = data.geom_xmat[boxes].reshape(-1, 3, 3), model.geom_size[boxes]
    across = np.argsort(upwards, axis=1)[:, :2]  # the two axes of a box that lie level
    each = np.arange(len(boxes))
    one, other = (axes[each, :2, across[:, side]] * sizes[each, across[:, side], None] for side in (0, 1))
    turned = one[:, 0] * other[:, 1] < one[:, 1] * other[:, 0]
    one, other = np.where(turned[:, None], other, one), np.where(turned[:, None], one, other)
    middle = data.geom_xpos[boxes, :2]
    corners = np.stack([middle - one - other, middle + one - other, middle + one + other, middle - one + other], axis=1)
    return {box: [(x, y) for x, y in outline] for box, outline in zip(boxes.tolist(), corners.tolist(), strict=True)}


def _upright_cylinders(model: mujoco.MjModel, data: mujoco.MjData, chosen: NDArray[np.bool_]) -> dict[int, list[Point]]:
    """Returns the outlines of the chosen upright cylinders by geom number, in metres in the world's frame."""
    stands = data.geom_xmat[:, 8] > _UPRIGHT
    cylinders = np.flatnonzero(chosen & (model.geom_type == _CYLINDER) & stands)
    circle = np.stack(_circle(), axis=1)
    turned = circle @ data.geom_xmat[cylinders].reshape(-1, 3, 3)[:, :2, :2].swapaxes(1, 2)
    corners = data.geom_xpos[cylinders, None, :2] + model.geom_size[cylinders, None, :1] * turned
    return {
        geom: [(x, y) for x, y in outline] for geom, outline in zip(cylinders.tolist(), corners.tolist(), strict=True)
    }


def _corners(model: mujoco.MjModel, geom: int) -> Points:
    """Returns the corners of a convex part, or of a polyhedron in place of a round one, in the part's frame."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        return np.asarray(model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])], np.float64)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        x, y = _circle()
        return np.array([(size[0] * u, size[0] * v, z) for z in (-size[1], size[1]) for u, v in zip(x, y, strict=True)])
    if kind in _ROUNDED:
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


def _between(corners: Points, low_m: float, high_m: float, *, ringed: bool) -> Points:
    """Returns the possible outline corners of a convex body between two heights, seen from above.

    Of a body made of rings, only edges between neighbouring rings are cut.
    """
    heights = corners[:, 2]
    found = [corners[(heights >= low_m) & (heights <= high_m), :2]]
    for level in (low_m, high_m):
        # Lines between corners below and above the level; those inside the body do no harm.
        is_below, is_above = heights < level, heights > level
        if ringed and is_below.any() and is_above.any():
            is_below &= heights > heights[is_below].max() - _LEVEL_M
            is_above &= heights < heights[is_above].min() + _LEVEL_M
        below, above = corners[is_below], corners[is_above]
        if len(below) and len(above):
            share = (level - below[:, None, 2]) / (above[None, :, 2] - below[:, None, 2])
            cut = below[:, None, :2] + share[..., None] * (above[None, :, :2] - below[:, None, :2])
            found.append(cut.reshape(-1, 2))
    return np.concatenate(found)
