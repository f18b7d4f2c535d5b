"""Smooths a path over grid cells for a robot to drive along."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

STEP_M = 0.05
"""Distance between the points of a finished path."""

_SHORTCUT_CLEARANCE_M = 0.30
_WINDOW = 9
"""Points that a corner is rounded over."""

_ROUNDS = 2
_LONGEST_SHORTCUT = 64
"""Grid steps that one straight line may replace."""

Clearance = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def smooth(points: NDArray[np.float64], clearance: Clearance, radius_m: float) -> NDArray[np.float64]:
    """Straightens and rounds a path.

    Args:
        points: the path, shape (n, 2), metres; its ends stay.
        clearance: distance to the nearest obstacle for points of shape (n, 2).
        radius_m: clearance that rounding must not go below.

    Returns:
        Points about `STEP_M` apart, shape (m, 2), m at least 2.
    """
    path = resample(_straighten(points, clearance))
    rounded = path
    for _ in range(_ROUNDS):
        rounded = _average(rounded)
    # The first points may lie too close already: the robot stands where it stands.
    worse = clearance(rounded) < np.minimum(clearance(path), radius_m)
    return path if worse.any() else resample(rounded)


def resample(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Spreads points evenly along a polyline, ends included."""
    lengths = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.zeros(0)
    along = np.concatenate(([0.0], np.cumsum(lengths)))
    count = max(2, round(float(along[-1]) / STEP_M) + 1)
    where = np.linspace(0.0, along[-1], count)
    return np.stack((np.interp(where, along, points[:, 0]), np.interp(where, along, points[:, 1])), axis=1)


def _straighten(points: NDArray[np.float64], clearance: Clearance) -> NDArray[np.float64]:
    """Replaces stretches by straight lines that are no tighter."""
    room = clearance(points)
    kept, here, last = [0], 0, len(points) - 1
    while here < last:
        span = min(_LONGEST_SHORTCUT, last - here)
        while span > 1 and not _is_no_tighter(points, room, here, here + span, clearance):
            span = max(1, span * 2 // 3)
        here += span
        kept.append(here)
    return points[kept]


def _is_no_tighter(
    points: NDArray[np.float64], room: NDArray[np.float64], first: int, last: int, clearance: Clearance
) -> bool:
    needed = min(_SHORTCUT_CLEARANCE_M, float(room[first : last + 1].min()))
    count = 2 * (last - first)
    line = points[first] + np.linspace(0.0, 1.0, count)[:, np.newaxis] * (points[last] - points[first])
    return bool(clearance(line).min() >= needed)


def _average(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Moving average; near the ends, where the window would stick out, it is narrower."""
    count = len(points)
    index = np.arange(count)
    half = np.minimum(_WINDOW // 2, np.minimum(index, count - 1 - index))
    sums = np.concatenate((np.zeros((1, 2)), np.cumsum(points, axis=0)))
    return (sums[index + half + 1] - sums[index - half]) / (2 * half + 1)[:, np.newaxis]
