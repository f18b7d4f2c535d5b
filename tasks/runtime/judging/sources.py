"""Sources of measurements in a recording: silences of topics, poses, and lidar distances."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ....schemas.runs.recording_sources import RecordingSources
from ....schemas.runs.requirement_kinds.kind import ROUNDING_S, Blind, Rule
from .bags import Message, RecordingFault
from .frames import FrameTree, Matrix, bare, matrix_of, quaternion_of

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""ROS types of `/tf` messages, in ROS 2, ROS 1 and old ROS 1."""
_POSES: Mapping[str, Callable[[Any], tuple[Any, Any]]] = {
    "nav_msgs/msg/Odometry": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
    "geometry_msgs/msg/PoseStamped": lambda m: (m.pose.position, m.pose.orientation),
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
    "geometry_msgs/msg/TransformStamped": lambda m: (m.transform.translation, m.transform.rotation),
}
POSE_TYPES = tuple(_POSES)
"""ROS types of messages with one pose."""
_PLANAR = 1e-6
"""Tolerance within which a pose is planar: sine of the tilt, and change of height in metres. Rounding errors are
smaller.
"""
SCAN_TYPE = "sensor_msgs/msg/LaserScan"


class Source:
    """A source of measurements (topic) in a recording, with the longest time that it was silent."""

    def __init__(self, name: str, max_gap_s: float) -> None:
        """Starts to listen at the beginning of the run.

        Args:
            name: Name of the topic, for messages.
            max_gap_s: Longest acceptable silence in seconds; infinite for topics that publish events only.
        """
        self.name = name
        self._max_gap_s = max_gap_s
        self._last_s = 0.0
        self._stamp_s = -math.inf
        self.rules: list[Rule[Any]] = []
        self.messages = 0

    def hear(self, time_s: float) -> None:
        """Records that a topic has a message, and how long it was silent before."""
        self.messages += time_s >= 0
        self.look_back(time_s)
        self._last_s = max(self._last_s, time_s)

    def look_back(self, time_s: float) -> None:
        """Records a silence that has become too long, before requirements use outdated measurements."""
        if time_s - self._last_s > self._max_gap_s + ROUNDING_S:
            words = f"no message on {self.name} from {self._last_s:.2f} to {time_s:.2f} s"
            self._break(f"{words}, longer than max_gap_s ({self._max_gap_s:g} s), so something could have been missed")

    def finish(self, end_s: float) -> None:
        """Records how long a topic was silent at the end of the run."""
        if not self.messages and math.isfinite(self._max_gap_s):
            self._break(f"no message on {self.name} could be used")
        self.look_back(end_s)

    def check_stamp(self, stamp: Any, path: object) -> None:
        """Checks that a topic's time stamps do not go backwards.

        Raises:
            RecordingFault: The time stamps go backwards.
        """
        stamp_s = stamp.sec + stamp.nanosec / 1e9
        if stamp_s < self._stamp_s - min(1.0, self._max_gap_s):
            raise RecordingFault(
                f"{path}: time goes backwards on {self.name}, from {self._stamp_s:.3f} to {stamp_s:.3f} s; record each "
                "run in a recording of its own"
            )
        self._stamp_s = max(self._stamp_s, stamp_s)

    def _break(self, why: str) -> None:
        for rule in self.rules:
            if not _is_decided(rule, self._last_s):
                rule.fail(why)


def _is_decided(rule: Rule[Any], time_s: float) -> bool:
    """Returns whether a rule was decided before a time: by a violation, or by reaching its goal in time."""
    if rule.violated_s is not None:
        return rule.violated_s <= time_s + ROUNDING_S
    return rule.is_reached is True


class Pose:
    """Latest pose of a frame in the map; NaN before the first message."""

    def __init__(self, sources: Sequence[Source]) -> None:
        self.sources = sources
        self.position = [math.nan] * 3
        """Position x, y and z in metres; updated in place."""
        self.orientation = [math.nan] * 4
        """Orientation as a quaternion, w first; updated in place."""
        self.tilts = False
        """Whether any pose was tilted: planar poses cannot show a tilt."""
        self.rises = False
        """Whether the height ever changed: planar poses cannot show a height."""
        self._first_z_m = math.nan

    @property
    def is_known(self) -> bool:
        """Whether a pose of the frame was received."""
        return not math.isnan(self.position[0])

    def set(self, matrix: Matrix) -> None:
        """Sets the latest pose of the frame."""
        self.position[:] = matrix[:3, 3].tolist()
        self.orientation[:] = quaternion_of(matrix)
        self.tilts = self.tilts or abs(matrix[2, 0]) + abs(matrix[2, 1]) > _PLANAR
        self._first_z_m = self.position[2] if math.isnan(self._first_z_m) else self._first_z_m
        self.rises = self.rises or abs(self.position[2] - self._first_z_m) > _PLANAR


class PoseTopic:
    """A recorded topic with one pose in each message."""

    def __init__(self, topic: str, sources: RecordingSources) -> None:
        self.source = Source(topic, sources.max_gap_s)
        self.pose = Pose([self.source])
        self.frame = ""
        """Name of the frame in which the poses are given; empty before the first pose."""

    def take(self, message: Message, time_s: float, path: object) -> bool:
        """Reads the pose of a message, and returns whether its numbers are valid; invalid poses are ignored."""
        self.source.check_stamp(message.content.header.stamp, path)
        matrix = matrix_of(*_POSES[message.type](message.content))
        if matrix is None:
            return False
        self.frame = self.frame or bare(message.content.header.frame_id)
        self.source.hear(time_s)
        self.pose.set(matrix)
        return True


class TransformPoses:
    """Poses of frames computed from recorded `/tf` messages."""

    def __init__(self, tree: FrameTree, sources: RecordingSources) -> None:
        self._tree = tree
        self._max_gap_s = sources.max_gap_s
        self._links: dict[str, Source] = {}
        self._poses: dict[tuple[str, ...], Pose] = {}
        self._parents: dict[tuple[str, ...], list[str]] = {}
        """Parents of the frames in each chain when it was found."""

    def is_static(self, frame: str) -> bool:
        """Returns whether a frame never moves relative to its parent."""
        return self._tree.is_static[frame]

    def pose(self, chain: Sequence[str]) -> Pose:
        """Returns the pose at the end of a chain of frames (see `FrameTree.chain`)."""
        key = tuple(chain)
        if key not in self._poses:
            moving = [frame for frame in key if not self._tree.is_static[frame]]
            for frame in moving:
                name = f"/tf ({self._tree.parents[frame]} to {frame})"
                self._links.setdefault(frame, Source(name, self._max_gap_s))
            self._parents[key] = [self._tree.parents[frame] for frame in key]
            pose = self._poses[key] = Pose([self._links[frame] for frame in moving])
            if not moving and (matrix := self._tree.along(key)) is not None:
                pose.set(matrix)
        return self._poses[key]

    def take(self, message: Message, time_s: float, path: object) -> None:
        """Reads the transforms of a recorded `/tf` message."""
        changed: set[str] = set()
        for transform in message.content.transforms:
            link = self._links.get(bare(transform.child_frame_id))
            if link is not None:
                link.check_stamp(transform.header.stamp, path)
            self._check_parent(transform)
            frame = self._tree.place(transform, is_static=False)
            if frame is not None and link is not None:
                link.hear(time_s)
                changed.add(frame)
        for chain, pose in self._poses.items():
            if changed.intersection(chain) and (matrix := self._tree.along(chain)) is not None:
                pose.set(matrix)

    def _check_parent(self, transform: Any) -> None:
        """Makes rules errors whose chain of frames has a frame with a new parent: two nodes may publish it."""
        child, parent = bare(transform.child_frame_id), bare(transform.header.frame_id)
        for key, pose in self._poses.items():
            if child not in key:
                continue
            first = self._parents[key][key.index(child)]
            if first != parent:
                for rule in {id(rule): rule for source in pose.sources for rule in source.rules}.values():
                    rule.fail(f"{child!r} has two parents on /tf, {first!r} and {parent!r}; one of them would do")


_ALL_AROUND_RAD = math.radians(350)
"""Field of view in radians from which a scan counts as 360 degrees: many lidars have a small gap."""


class Scan:
    """Distances from the robot's surface to obstacles, from recorded lidar scans."""

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
        """Returns a function for the smallest distance since its last call; without a new scan it repeats it."""
        self.source.rules.append(rule)
        near = [math.inf]
        self._near.append(near)

        def measure(within_m: float) -> tuple[float, str] | None:
            distance_m, near[0] = min(near[0], self._latest_m), math.inf
            return (distance_m, f"what {self.topic} sees") if distance_m < within_m else None

        return measure

    def take(self, message: Message, time_s: float, path: object) -> None:
        """Reads a lidar scan; scans with too few valid rays are skipped."""
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
        """Determines the lidar's pose on the robot and its ray directions; too small a field of view is an error."""
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
        """Checks at the end whether the lidar measured anything in all directions: rays may be dead, or blocked."""
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
