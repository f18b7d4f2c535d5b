"""Path follower: pure pursuit, with turning on the spot at sharp corners."""

import math

from ...robots.robot import Limits
from ...robots.scout import LIMITS
from .planner import Path

_LOOKAHEAD_MIN_M = 0.10
_LOOKAHEAD_PER_MPS_S = 0.55
_TURN_ON_SPOT_RAD = 0.95
_TURNED_RAD = 0.25
_TURN_GAIN = 3.5
_BRAKING_MPS2 = 0.7
_LATERAL_MPS2 = 0.45
"""Maximum lateral acceleration in m/s², which limits the speed in bends."""

_ARRIVED_M = 0.08
_SEARCH_POINTS = 12
"""Number of points after the last nearest path point among which the next nearest one is searched."""


class PathFollower:
    """Path tracking controller: computes velocity commands along one path from the robot's poses."""

    def __init__(self, path: Path, limits: Limits = LIMITS) -> None:
        """Prepares to follow a path from its beginning.

        Args:
            path: Points of shape (n, 2) in metres, about 5 cm apart, n at least 2.
            limits: Speed and acceleration limits of the robot.
        """
        self._max_linear, self._max_angular = limits.linear_mps, limits.angular_radps
        self._points: list[tuple[float, float]] = [(x, y) for x, y in path.tolist()]
        self._along = [0.0]
        for (x0, y0), (x1, y1) in zip(self._points, self._points[1:], strict=False):
            self._along.append(self._along[-1] + math.hypot(x1 - x0, y1 - y0))
        self._nearest = 0
        self._turning = True

    @property
    def remaining_m(self) -> float:
        """Length in metres of the path that is left, from the path point nearest to the robot."""
        return self._along[-1] - self._along[self._nearest]

    @property
    def arrived(self) -> bool:
        """Whether the robot has reached the end of the path."""
        return self.remaining_m < _ARRIVED_M

    def ahead(self, distance_m: float) -> list[tuple[float, float]]:
        """Returns the points of the path ahead of the robot, up to a distance in metres."""
        end = self._index_at(distance_m)
        return self._points[self._nearest : end + 1]

    def command(self, x: float, y: float, yaw: float, speed: float, speed_limit: float) -> tuple[float, float]:
        """Computes a velocity command from the robot's pose.

        Args:
            x: Position, metres.
            y: Position, metres.
            yaw: Heading, radians.
            speed: Present forward speed, m/s; sets how far ahead to aim.
            speed_limit: Maximum speed that is allowed now, m/s.

        Returns:
            Forward velocity in m/s and turning rate in rad/s.
        """
        self._advance(x, y)
        lookahead_m = _LOOKAHEAD_MIN_M + _LOOKAHEAD_PER_MPS_S * max(0.0, speed)
        target_x, target_y = self._points[self._index_at(lookahead_m)]
        distance_m = math.hypot(target_x - x, target_y - y)
        error = math.remainder(math.atan2(target_y - y, target_x - x) - yaw, math.tau)
        self._turning = abs(error) > (_TURNED_RAD if self._turning else _TURN_ON_SPOT_RAD)
        if self._turning:
            return 0.0, _clip(_TURN_GAIN * error, self._max_angular)
        curvature = 2 * math.sin(error) / max(distance_m, 0.1)
        bend_limit = math.sqrt(_LATERAL_MPS2 / max(abs(curvature), 1e-3))
        brake_limit = math.sqrt(2 * _BRAKING_MPS2 * self.remaining_m) + 0.03
        linear = min(self._max_linear, speed_limit, bend_limit, brake_limit)
        return linear, _clip(linear * curvature, self._max_angular)

    def _advance(self, x: float, y: float) -> None:
        """Advances to the path point nearest to the robot, never backwards."""
        points, best = self._points, math.inf
        for index in range(self._nearest, min(self._nearest + _SEARCH_POINTS, len(points))):
            point_x, point_y = points[index]
            square = (point_x - x) ** 2 + (point_y - y) ** 2
            if square < best:
                best, self._nearest = square, index

    def _index_at(self, distance_m: float) -> int:
        """Returns the index of the first path point at least `distance_m` ahead of the robot's nearest point."""
        wanted = self._along[self._nearest] + distance_m
        index, last = self._nearest, len(self._points) - 1
        while index < last and self._along[index] < wanted:
            index += 1
        return index


def _clip(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
