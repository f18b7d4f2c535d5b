"""Memory of obstacles that the range sensors see and the map does not show."""

import math

import numpy as np
from numpy.typing import NDArray

from ...episode.context import KeepsAttributes
from ..indoor_navigation import lidar
from .planner import GridPlanner

_NEAR_M = 1.6
"""Distance in metres up to which obstacles are remembered."""

_KNOWN_WITHIN_M = 0.12
"""Distance in metres up to which a measured point belongs to an obstacle on the map."""

_CELL_M = 0.025
"""Distance in metres below which two measured points count as one."""

_FORGET_S = 25.0

Pose = tuple[float, float, float]


class ObstacleMemory(KeepsAttributes):
    """Remembers obstacles that the map does not show, as points, and forgets them after a while."""

    KEPT = ("_seen_s",)

    def __init__(self, planner: GridPlanner) -> None:
        self._planner = planner
        self._seen_s: dict[tuple[int, int], float] = {}

    def points(self, now_s: float) -> NDArray[np.float64]:
        """Forgets old obstacle points, and returns the remembered ones in metres, shape (n, 2)."""
        self._seen_s = {cell: seen_s for cell, seen_s in self._seen_s.items() if now_s - seen_s <= _FORGET_S}
        return np.array(list(self._seen_s), dtype=np.float64).reshape(-1, 2) * _CELL_M

    def see(self, pose: Pose, hits: NDArray[np.complex128], now_s: float) -> NDArray[np.float64]:
        """Adds the obstacles of a lidar measurement to the memory.

        Args:
            pose: X, y in metres and yaw in radians, of the measurement.
            hits: Measured points in the robot's frame, from `near_hits`.
            now_s: Time of the measurement.

        Returns:
            Hits that the map does not show, as points of shape (n, 2), metres.
        """
        if not hits.size:
            return np.zeros((0, 2))
        x, y, yaw = pose
        turned = hits * complex(math.cos(yaw), math.sin(yaw)) + complex(x, y)
        points = turned.view(np.float64).reshape(-1, 2)
        unknown = points[self._planner.known_distance(points) > _KNOWN_WITHIN_M]
        if len(unknown):
            self.add(unknown, now_s)
        return unknown

    def add(self, points: NDArray[np.float64], now_s: float) -> None:
        """Adds obstacle points in metres, shape (n, 2), to the memory, as seen at a time in seconds."""
        for column, row in np.rint(points / _CELL_M).astype(int).tolist():
            self._seen_s[column, row] = now_s


def ray_directions(scan_angles_rad: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Returns the directions of the lidar's and bumper's rays as unit complex numbers, which a product rotates."""
    return np.exp(1j * np.concatenate((scan_angles_rad, lidar.PROXIMITY_ANGLES_RAD)))


def near_hits(
    rays: NDArray[np.complex128], scan: NDArray[np.float32], proximity: NDArray[np.float32]
) -> NDArray[np.complex128]:
    """Returns the points within 1.6 m that lidar and bumper rays hit, in the robot's frame.

    Args:
        rays: Directions of the rays, from `ray_directions`.
        scan: The lidar's ranges, metres.
        proximity: The bumper's ranges, metres.

    Returns:
        Points in the robot's frame, metres: forward is the real part, left the imaginary one.
    """
    ranges = np.concatenate((scan, proximity))
    near = np.flatnonzero(ranges < _NEAR_M)
    return rays[near] * ranges[near].astype(np.complex128)


def free_ahead(hits: NDArray[np.complex128], half_width_m: float) -> float:
    """Returns how far a disc can move straight ahead before it touches a hit, in metres.

    Args:
        hits: Points in the robot's frame.
        half_width_m: The disc's radius.
    """
    ahead = hits[(np.abs(hits.imag) < half_width_m) & (hits.real > 0)]
    if not ahead.size:
        return math.inf
    return float((ahead.real - np.sqrt(half_width_m**2 - ahead.imag**2)).min())


def nearest_to_path(points: NDArray[np.float64], path: list[tuple[float, float]]) -> float:
    """Returns the smallest distance between points and a path, in metres; infinite without points."""
    if len(points) == 0 or not path:
        return math.inf
    gaps = points[:, np.newaxis, :] - np.asarray(path)[np.newaxis, :, :]
    return float(np.sqrt((gaps**2).sum(axis=2).min()))
