"""Polylines of one SDF shape: rings inside others are holes, rings in holes are separate parts, as in Gazebo."""

from collections.abc import Sequence

import numpy as np

Ring = tuple[tuple[float, float], ...]
"""Corners of a closed polygon; the first one is not repeated."""


def parts_of(rings: Sequence[Ring]) -> tuple[Ring, ...]:
    """Joins holes to the outlines around them, each by an edge that runs there and back.

    Args:
        rings: Closed lines that do not cross each other, in either direction.

    Returns:
        An outline for each part.
    """
    around = [[other for other in range(len(rings)) if other != own and _is_in(rings[own], rings[other])] for own in range(len(rings))]  # fmt: skip # noqa: E501
    found: list[Ring] = []
    for own, ring in enumerate(rings):
        if len(around[own]) % 2:
            continue  # a hole
        holes = [rings[hole] for hole in range(len(rings)) if own in around[hole] and len(around[hole]) == len(around[own]) + 1]  # fmt: skip # noqa: E501
        outline = _turning(ring, left=True)
        # The hole that is furthest to the east first: no later one lies between it and the outline.
        for hole in sorted(holes, key=lambda each: -max(x for x, _ in each)):
            outline = _joined(outline, _turning(hole, left=False))
        found.append(outline)
    return tuple(found)


def _is_in(ring: Ring, around: Ring) -> bool:
    """Whether most corners of a ring are inside another ring, as some may be on it."""
    return sum(_is_inside(point, around) for point in ring) * 2 > len(ring)


def _is_inside(point: tuple[float, float], ring: Ring) -> bool:
    x, y = point
    is_inside = False
    for (x0, y0), (x1, y1) in zip(ring, (*ring[1:], ring[0]), strict=True):
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0):
            is_inside = not is_inside
    return is_inside


def _turning(ring: Ring, *, left: bool) -> Ring:
    x, y = np.array(ring).T
    turns_left = bool((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() > 0)
    return ring if turns_left == left else ring[::-1]


def _joined(outline: Ring, hole: Ring) -> Ring:
    """Returns an outline with a hole as one polygon.

    It goes from a corner that sees the hole's easternmost one, and back.
    """
    start = max(range(len(hole)), key=lambda index: hole[index][0])
    spot = hole[start]
    others = [*_edges(outline), *_edges(hole)]
    near = sorted(range(len(outline)), key=lambda index: _away(outline[index], spot))
    seen = next((at for at in near if not any(_cross((outline[at], spot), edge) for edge in others)), near[0])
    return (*outline[: seen + 1], *hole[start:], *hole[: start + 1], *outline[seen:])


def _edges(ring: Ring) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    return list(zip(ring, (*ring[1:], ring[0]), strict=True))


def _away(one: tuple[float, float], other: tuple[float, float]) -> float:
    return (one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2


def _cross(
    one: tuple[tuple[float, float], tuple[float, float]], other: tuple[tuple[float, float], tuple[float, float]]
) -> bool:
    """Whether two line segments cross, or touch elsewhere than at common ends."""
    if {*one} & {*other}:
        return False
    (a, b), (c, d) = one, other
    return _side(a, b, c) * _side(a, b, d) <= 0 and _side(c, d, a) * _side(c, d, b) <= 0


def _side(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
