"""Polygons on the ground, such as the rooms of a floor plan."""

from collections.abc import Iterable, Sequence

from .world import Point


def bounds(points: Iterable[Point]) -> tuple[float, float, float, float]:
    """The box around some points: west, south, east and north."""
    xs, ys = zip(*points, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def contains(polygon: Sequence[Point], x: float, y: float) -> bool:
    """Whether a point lies inside a simple polygon (even-odd rule), in metres."""
    inside = False
    previous_x, previous_y = polygon[-1]
    for corner_x, corner_y in polygon:
        if (corner_y > y) != (previous_y > y):
            crossing = corner_x + (y - corner_y) / (previous_y - corner_y) * (previous_x - corner_x)
            inside ^= x < crossing
        previous_x, previous_y = corner_x, corner_y
    return inside
