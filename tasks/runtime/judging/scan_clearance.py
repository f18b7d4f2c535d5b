"""Clearance in a recording: distances from the robot's surface to obstacles, from lidar scans."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ....schemas.runs.recording_sources import RecordingSources
from ....schemas.runs.requirement_kinds.kind import Blind, Rule
from .bags import Message
from .frames import FrameTree, Matrix, bare
from .silences import Source

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
_ALL_AROUND_RAD = math.radians(350)
"""Field of view in radians from which a scan counts as 360 degrees: many lidars have a small gap."""


class Scan:
    """Distances in metres from the robot's surface to obstacles, from recorded lidar scans.

    Rules become errors if the lidar cannot be trusted: its mounting is unknown, or it sees too little around the robot.
    """

    def __init__(self, topic: str, tree: FrameTree, base: str, sources: RecordingSources) -> None:
        self.topic = topic
        self.source = Source(topic, sources.max_gap_s)
        self._tree, self._base, self._radius_m = tree, base, sources.radius_m or 0.0
        self._partial = sources.partial_scan
        self._mount: Matrix | None = None
        self._rays: Any = None
        self._form: tuple[float, ...] = ()
        self._near: list[list[float]] = []
        self._latest_m = math.inf
        self._sees_rad = 0.0
        self._has_told: Any = None
        """Mask of the rays that ever had a valid value, including "nothing in range"."""
        self._has_seen = False

    def meter(self, rule: Rule[Any]) -> Callable[[float], tuple[float, str] | None]:
        """Returns a function that measures the smallest distance to obstacles since its last call, for a rule.

        The function gets the distance in metres below which it answers, and returns the distance and a description, or
        `None` if nothing is as near. Without a new scan it repeats the last one.
        """
        self.source.rules.append(rule)
        near = [math.inf]
        self._near.append(near)

        def measure(within_m: float) -> tuple[float, str] | None:
            distance_m, near[0] = min(near[0], self._latest_m), math.inf
            return (distance_m, f"what {self.topic} sees") if distance_m < within_m else None

        return measure

    def take(self, message: Message, time_s: float, path: object) -> None:
        """Reads a lidar scan; scans with too few valid rays, or whose mounting is not known, are skipped.

        Args:
            message: The message.
            time_s: Time in the run, in seconds.
            path: Path of the recording, for errors.
        """
        scan = message.content
        self.source.check_stamp(scan.header.stamp, path)
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        too_near = np.isneginf(ranges)  # REP 117: -Inf is nearer than the least range, Inf farther than the largest
        returned = np.isfinite(ranges) & (ranges >= scan.range_min) & (ranges < scan.range_max)
        # Many drivers write the largest range, and not Inf, where there is nothing.
        beyond = np.isposinf(ranges) | (np.isfinite(ranges) & (ranges >= scan.range_max))
        told = returned | too_near | beyond
        if not len(ranges) or told.mean() < 0.5 or not math.isfinite(scan.angle_min + scan.angle_increment):
            return
        if not self._is_mounted(scan, len(ranges)):
            return
        self._has_told |= told
        self.source.hear(time_s)
        ranges = np.where(too_near, scan.range_min, ranges)
        seen = returned | too_near
        self._has_seen = self._has_seen or bool(seen.any())
        self._latest_m = math.inf
        if not seen.any() or self._mount is None:
            return
        points = self._rays[seen] * ranges[seen, None] @ self._mount[:2, :2].T + self._mount[:2, 3]
        nearest_m = self._latest_m = float(np.hypot(points[:, 0], points[:, 1]).min()) - self._radius_m
        for near in self._near:
            near[0] = min(near[0], nearest_m)

    def _is_mounted(self, scan: Any, count: int) -> bool:
        """Determines the lidar's pose on the robot and its ray directions; returns false if the pose is not known.

        For an unknown pose, and for too small a field of view, an error is recorded in the rules.
        """
        frame = bare(scan.header.frame_id)
        self._mount = self._tree.relative(self._base, frame)
        if self._mount is None:
            self._fail(
                f"{self.topic} is in the frame {frame!r}; /tf and /tf_static do not say where it is on {self._base}"
            )
            return False
        form = (scan.angle_min, scan.angle_increment, float(count))
        if form != self._form:
            self._form = form
            self._has_told = np.zeros(count, dtype=np.bool_)
            angles = scan.angle_min + scan.angle_increment * np.arange(count)
            self._rays = np.column_stack((np.cos(angles), np.sin(angles)))
        sees_rad = self._sees_rad = abs(scan.angle_increment) * count
        if sees_rad < _ALL_AROUND_RAD and not self._partial:
            self._fail(
                f"{self.topic} sees {math.degrees(sees_rad):.0f} degrees, so what is elsewhere could be missed; "
                "partial_scan: true judges by what it sees"
            )
        self._tell_blind(scan.range_min)
        return True

    def finish(self) -> None:
        """Records an error in rules if the lidar never measured anything in some directions: rays may be dead."""
        if not self.source.messages:
            return  # that is an error already
        if not self._has_seen:
            self._fail(f"{self.topic} never saw anything in the whole run, so it could not be missed")
        dead_rad = self._sees_rad * (1 - float(self._has_told.mean()))
        if self._sees_rad - dead_rad < _ALL_AROUND_RAD and not self._partial:
            self._fail(
                f"rays of {self.topic} over {math.degrees(dead_rad):.0f} degrees never told anything, so what is there "
                "could be missed; partial_scan: true judges by what it sees"
            )

    def _tell_blind(self, range_min_m: float) -> None:
        """Tells the rules the distance from the robot's surface below which the lidar cannot measure."""
        assert self._mount is not None
        away_m = math.hypot(self._mount[0, 3], self._mount[1, 3])
        why = f"{self.topic} sees nothing nearer than {range_min_m:g} m, and the robot's radius is {self._radius_m:g} m"
        for rule in self.source.rules:
            rule.blind = Blind(range_min_m + away_m - self._radius_m, why)

    def _fail(self, why: str) -> None:
        for rule in self.source.rules:
            if rule.violated_s is None:  # what was found stands
                rule.fail(why)
