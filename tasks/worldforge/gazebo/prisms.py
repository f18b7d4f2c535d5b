"""Converts Gazebo's polylines (extruded polygons) and cones to convex parts, and to triangles."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ...sdf.meshes import Triangles
from ...sdf.sdf_types import Geometry
from .convex_parts import HullPart, Points

COMPOSED = ("mesh", "prism", "cone")
"""Shape kinds that become several convex parts for collisions, or a mesh for drawing."""
_LEAST_TURN_M2 = 1e-6
"""Twice the area below which a triangle is degenerate: its corners are on a line."""
_ROUND = 32
"""Number of corners with which a cone's base is approximated: within half a per cent of its radius."""

Outline = Sequence[tuple[float, float]]


def prism_parts(geometry: Geometry) -> list[HullPart]:
    """Returns the convex pieces of closed polygons, extruded up from z = 0, or of a cone, centred on z = 0.

    Args:
        geometry: A shape of kind `prism` or `cone`.
    """
    if geometry.kind == "cone":
        foot, top = _cone(geometry)
        return [HullPart(np.concatenate([foot, top]))]
    return [part for outline in geometry.outlines for part in _parts(outline, geometry.size[0])]


def _parts(outline: Outline, height_m: float) -> list[HullPart]:
    points = np.array(outline)
    try:
        hull = ConvexHull(points)
    except QhullError:
        return []
    whole = [range(len(points))] if len(hull.vertices) == len(points) else ears(outline)
    low = np.column_stack([points, np.zeros(len(points))])
    return [
        HullPart(np.concatenate([low[list(ring)], low[list(ring)] + (0.0, 0.0, height_m)]))
        for ring in whole
        if len(ring) > 3 or abs(_turn(*points[list(ring)])) > _LEAST_TURN_M2
    ]


def _cone(geometry: Geometry) -> tuple[Points, Points]:
    """Returns the base corners of a cone, counter-clockwise, and its apex."""
    radius, length = geometry.size
    turns = 2 * np.pi * np.arange(_ROUND) / _ROUND
    foot = np.column_stack([radius * np.cos(turns), radius * np.sin(turns), np.full(_ROUND, -length / 2)])
    return foot, np.array([[0.0, 0.0, length / 2]])


def ears(outline: Outline) -> list[tuple[int, int, int]]:
    """Triangulates a polygon (ear clipping); returns corner numbers.

    Args:
        outline: Corners of the polygon, in either direction; a hole is joined to it by an edge that is used twice.
    """
    points = np.array(outline)
    left = list(range(len(points)))
    x, y = points.T
    if (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() < 0:
        left.reverse()
    found: list[tuple[int, int, int]] = []
    while len(left) > 3:
        ear = next((at for at in range(len(left)) if _is_ear(points, left, at)), 0)
        triangle = left[ear - 1], left[ear], left[(ear + 1) % len(left)]
        found.append(triangle)
        left.pop(ear)
    return [*found, (left[0], left[1], left[2])]


def _is_ear(points: Points, left: list[int], at: int) -> bool:
    corners = [left[index % len(left)] for index in (at - 1, at, at + 1)]
    a, b, c = points[corners]
    if _turn(a, b, c) <= 0:
        return False
    others = points[left]
    # Where a hole is joined, two corners are in one place.
    others = others[(others[:, None] != points[corners]).any(axis=2).all(axis=1)]
    inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
    return not inside.any()


def _turn(a: Points, b: Points, c: Points) -> Points:
    """Returns twice the signed area of triangles; positive where they turn left."""
    return (b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0])


def prism_triangles(geometry: Geometry) -> Triangles:
    """Returns the surface triangles of closed polygons, extruded up from z = 0, or of a cone, centred on z = 0.

    Args:
        geometry: A shape of kind `prism` or `cone`.
    """
    if geometry.kind == "cone":
        foot, top = _cone(geometry)
        after = np.roll(foot, -1, axis=0)
        middle = np.broadcast_to([0.0, 0.0, foot[0, 2]], foot.shape)
        sides = np.stack([foot, after, np.broadcast_to(top, foot.shape)], axis=1)
        return np.concatenate([sides, np.stack([after, foot, middle], axis=1)])
    return np.concatenate([_surface(outline, geometry.size[0]) for outline in geometry.outlines])


def _surface(outline: Outline, height_m: float) -> Triangles:
    low = np.array([(x, y, 0.0) for x, y in outline])
    high = low + np.array((0.0, 0.0, height_m))
    cut = np.array(ears(outline))
    x, y = low[:, 0], low[:, 1]
    following = np.roll(np.arange(len(low)), -1)
    if (x * y[following] - x[following] * y).sum() < 0:
        low, high = low[::-1], high[::-1]
        cut = len(low) - 1 - cut
    after = np.roll(np.arange(len(low)), -1)
    sides = [np.stack([low, low[after], high[after]], axis=1), np.stack([low, high[after], high], axis=1)]
    return np.concatenate([low[cut[:, ::-1]], high[cut], *sides])
