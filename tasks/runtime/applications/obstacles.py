"""Remembers what the range sensors see and the map does not show."""

import math

import numpy as np
from numpy.typing import NDArray

from . import lidar
from .planner import GridPlanner

_NEAR_M = 1.6
"""Farther obstacles can wait."""

_KNOWN_WITHIN_M = 0.12
"""Points this near to something on the map belong to it."""

_CELL_M = 0.025
"""Sightings closer together than this are one."""

_FORGET_S = 25.0

_SCAN_ANGLES = lidar.SCAN_ANGLE_MIN_RAD + lidar.SCAN_ANGLE_INCREMENT_RAD * np.arange(lidar.SCAN_RAYS)
_SCAN_COS, _SCAN_SIN = np.cos(_SCAN_ANGLES), np.sin(_SCAN_ANGLES)
_BUMPER_COS, _BUMPER_SIN = np.cos(lidar.PROXIMITY_ANGLES_RAD), np.sin(lidar.PROXIMITY_ANGLES_RAD)

Pose = tuple[float, float, float]


class ObstacleMemory:
    """Sightings of unknown things, as points in the map, forgotten after a while."""

    def __init__(self, planner: GridPlanner) -> None:
        self._planner = planner
        self._seen_s: dict[tuple[int, int], float] = {}

    def points(self, now_s: float) -> NDArray[np.float64]:
        """Everything that is remembered, shape (n, 2), metres."""
        self._seen_s = {cell: seen_s for cell, seen_s in self._seen_s.items() if now_s - seen_s <= _FORGET_S}
        return np.array(list(self._seen_s), dtype=np.float64).reshape(-1, 2) * _CELL_M

    def see(
        self, pose: Pose, scan: NDArray[np.float32], proximity: NDArray[np.float32], now_s: float
    ) -> NDArray[np.float64]:
        """Takes in a measurement.

        Args:
          pose: x, y in metres and yaw in radians, of the measurement.
          scan: the lidar's ranges, metres.
          proximity: the bumper's ranges, metres.
          now_s: time.

        Returns:
          The unknown points of this measurement within 1.6 m, shape (n, 2), metres.
        """
        near = np.flatnonzero(scan < _NEAR_M)
        close = np.flatnonzero(proximity < _NEAR_M)
        if not near.size and not close.size:
            return np.zeros((0, 2))
        forward = np.concatenate((scan[near] * _SCAN_COS[near], proximity[close] * _BUMPER_COS[close]))
        left = np.concatenate((scan[near] * _SCAN_SIN[near], proximity[close] * _BUMPER_SIN[close]))
        x, y, yaw = pose
        c, s = math.cos(yaw), math.sin(yaw)
        points = np.stack((x + c * forward - s * left, y + s * forward + c * left), axis=1)
        unknown = points[self._planner.known_distance(points) > _KNOWN_WITHIN_M]
        self.add(unknown, now_s)
        return unknown

    def add(self, points: NDArray[np.float64], now_s: float) -> None:
        """Remembers points of shape (n, 2)."""
        for column, row in np.rint(points / _CELL_M).astype(int).tolist():
            self._seen_s[column, row] = now_s


def nearest_to_path(points: NDArray[np.float64], path: list[tuple[float, float]]) -> float:
    """Smallest distance between points of shape (n, 2) and the points of a path; infinite without any."""
    if len(points) == 0 or not path:
        return math.inf
    gaps = points[:, np.newaxis, :] - np.asarray(path)[np.newaxis, :, :]
    return float(np.sqrt((gaps**2).sum(axis=2).min()))
