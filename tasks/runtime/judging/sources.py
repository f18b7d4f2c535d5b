"""Sources of a recording: silence of topics, poses, contacts, and distances that a lidar sees."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from ....schemas.runs.recording_sources import RecordingSources
from ....schemas.runs.requirement_kinds.kind import ROUNDING_S, Rule
from .bags import Message, RecordingFault
from .frames import FrameTree, Matrix, bare, matrix_of, quaternion_of

TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""Types of `/tf`, of ROS 2 and 1 and of old ROS 1."""
_POSES: Mapping[str, Callable[[Any], tuple[Any, Any]]] = {
    "nav_msgs/msg/Odometry": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
    "geometry_msgs/msg/PoseStamped": lambda m: (m.pose.position, m.pose.orientation),
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
    "geometry_msgs/msg/TransformStamped": lambda m: (m.transform.translation, m.transform.rotation),
}
POSE_TYPES = tuple(_POSES)
"""Types of messages with one pose."""
_PLANAR = 1e-6
"""Sine of a tilt below which a pose is planar: rounding alone gives less."""
SCAN_TYPE = "sensor_msgs/msg/LaserScan"


class Source:
    """A source of measurements (topic) in a recording, with the longest time that it was silent."""

    def __init__(self, name: str, max_gap_s: float) -> None:
        """Begins to listen at the beginning of the run.

        Args:
            name: What it is heard on, for messages.
            max_gap_s: Longest silence that nothing is missed in, in seconds; infinite: it only speaks when something
                happens.
        """
        self.name = name
        self._max_gap_s = max_gap_s
        self._last_s = 0.0
        self._stamp_s = -math.inf
        self.rules: list[Rule[Any]] = []
        self.messages = 0

    def hear(self, time_s: float) -> None:
        """Records a message, and the silence before it."""
        self.messages += time_s >= 0
        self.look_back(time_s)
        self._last_s = max(self._last_s, time_s)

    def look_back(self, time_s: float) -> None:
        """Records a silence that is too long, before requirements are measured by old data."""
        if time_s - self._last_s > self._max_gap_s + ROUNDING_S:
            words = f"no message on {self.name} from {self._last_s:.2f} to {time_s:.2f} s"
            self._break(f"{words}, longer than max_gap_s ({self._max_gap_s:g} s), so something could have been missed")

    def finish(self, end_s: float) -> None:
        """Records the silence at the end of the run."""
        if not self.messages and math.isfinite(self._max_gap_s):
            self._break(f"no message on {self.name} could be used")
        self.look_back(end_s)

    def check_stamp(self, stamp: Any, path: object) -> None:
        """Raises an error if a topic's time stamps go backwards.

        Raises:
            RecordingFault: It does.
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
    """Whether all that counts was found before a time: a violation, or the thing that is asked for in time."""
    if rule.violated_s is not None:
        return rule.violated_s <= time_s + ROUNDING_S
    return rule.is_reached is True


class Pose:
    """The latest pose of a frame in the map; NaN before the first."""

    def __init__(self, sources: Sequence[Source]) -> None:
        self.sources = sources
        self.position = [math.nan] * 3
        """x, y and z in metres; changes in place."""
        self.orientation = [math.nan] * 4
        """Quaternion, w first; changes in place."""
        self.tilts = False
        """Whether it was ever tilted in the least: a planar one cannot tell."""

    @property
    def is_known(self) -> bool:
        """Whether one has come."""
        return not math.isnan(self.position[0])

    def set(self, matrix: Matrix) -> None:
        """Stores a new pose."""
        self.position[:] = matrix[:3, 3].tolist()
        self.orientation[:] = quaternion_of(matrix)
        self.tilts = self.tilts or abs(matrix[2, 0]) + abs(matrix[2, 1]) > _PLANAR


class PoseTopic:
    """A recorded topic with one pose in each message."""

    def __init__(self, topic: str, sources: RecordingSources) -> None:
        self.source = Source(topic, sources.max_gap_s)
        self.pose = Pose([self.source])
        self.frame = ""
        """Frame that the poses are in, once one came."""

    def take(self, message: Message, time_s: float, path: object) -> None:
        """Reads the pose of a message; invalid numbers are skipped."""
        self.source.check_stamp(message.content.header.stamp, path)
        matrix = matrix_of(*_POSES[message.type](message.content))
        if matrix is not None:
            self.frame = self.frame or bare(message.content.header.frame_id)
            self.source.hear(time_s)
            self.pose.set(matrix)


class TransformPoses:
    """Poses of frames computed from recorded `/tf` messages."""

    def __init__(self, tree: FrameTree, sources: RecordingSources) -> None:
        self._tree = tree
        self._max_gap_s = sources.max_gap_s
        self._links: dict[str, Source] = {}
        self._poses: dict[tuple[str, ...], Pose] = {}
        self._parents: dict[tuple[str, ...], list[str]] = {}
        """Parent of each frame in a chain, as it was found."""

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
        """Reads a `/tf` message."""
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
        """Makes an error of poses whose way leads over a frame that has another parent now, as two nodes may say it."""
        child, parent = bare(transform.child_frame_id), bare(transform.header.frame_id)
        for key, pose in self._poses.items():
            if child not in key:
                continue
            first = self._parents[key][key.index(child)]
            if first != parent:
                for rule in {id(rule): rule for source in pose.sources for rule in source.rules}.values():
                    rule.fail(f"{child!r} has two parents on /tf, {first!r} and {parent!r}; one of them would do")


class Contacts:
    """Contact forces from recorded topics: the largest force of each object since the last check."""

    def __init__(self, topics: Sequence[str], types: Mapping[str, Set[str]], sources: RecordingSources) -> None:
        """Begins to listen.

        Args:
            topics: Topics with contacts.
            types: Types of their messages.
            sources: What is said of them.
        """
        self.topics = list(topics)
        self.robot = sources.robot
        self._speak_on_touch = sources.contacts_on_touch
        self.sources = [Source(topic, self._longest_silence_s(types[topic], sources)) for topic in topics]
        self._is_own = {topic: MARKERS in types[topic] for topic in topics}
        """Topics that our recorder wrote: without a contact it writes none, whatever its sensors do."""
        self._by_topic = dict(zip(self.topics, self.sources, strict=True))
        self._is_robot_seen = False
        self._others: set[str] = set()
        self._readers: list[dict[str, float]] = []

    @staticmethod
    def _longest_silence_s(types: Set[str], sources: RecordingSources) -> float:
        """Longest silence in which nothing is missed: Gazebo classic also says that nothing is touched."""
        return sources.max_gap_s if _STATES in types and not sources.contacts_on_touch else math.inf

    def look_back(self, time_s: float) -> None:
        """Records silences of topics that always speak."""
        for source in self.sources:
            if source.messages:  # the end says of a topic that never spoke why that may be
                source.look_back(time_s)

    def reader(self, rule: Rule[Any]) -> Callable[[], Mapping[str, float]]:
        """Makes a function that returns the contact forces since its last call, by object."""
        felt: dict[str, float] = {}
        self._readers.append(felt)
        for source in self.sources:
            source.rules.append(rule)

        def read() -> Mapping[str, float]:
            now = dict(felt)
            felt.clear()
            return now

        return read

    def take(self, message: Message, time_s: float) -> None:
        """Reads a message with contacts."""
        source = self._by_topic[message.topic]
        source.hear(time_s)
        for name, force in CONTACT_TYPES[message.type](message.content, self._other_side):
            if not math.isfinite(force):
                for rule in source.rules:
                    rule.fail(f"{source.name} says that {name} was touched, and not how hard")
                continue
            for felt in self._readers:
                felt[name] = max(felt.get(name, 0.0), force)

    def _other_side(self, first: str, second: str) -> str | None:
        """The other side of a contact; None: the robot has no part in it, or it is on the floor."""
        ours = [_is_of(name, self.robot or "") for name in (first, second)]
        self._is_robot_seen = self._is_robot_seen or any(ours)
        if ours[0] == ours[1]:
            self._others.update(name.partition("::")[0] for name in (first, second) if not any(ours))
            return None
        other = second if ours[0] else first
        return None if _is_of(other, _FLOOR) else other

    def finish(self, end_s: float) -> None:
        """Checks at the end whether the robot's contacts could be recognised."""
        for source in self.sources:
            if not (source.messages or self._speak_on_touch or self._is_own[source.name]):
                for rule in source.rules:
                    rule.fail(
                        f"no message came on {source.name}: nothing was touched, or its sensor was off, which nothing "
                        "tells apart; contacts_on_touch: true (in the sources) says that it speaks on touch only"
                    )
            source.finish(end_s)
            for rule in source.rules if self._others and not self._is_robot_seen else ():
                models = ", ".join(sorted(self._others)[:_MAX_SHOWN])
                rule.fail(f"no contact on {source.name} is of a model named {self.robot!r} (robot); there are {models}")

    def remarks(self) -> Iterator[str]:
        """Yields notes about topics without messages."""
        for source in self.sources:
            if source.rules and not source.messages:
                yield f"no message came on {source.name}, which is taken for nothing was touched"


_FLOOR = "ground_plane"
"""Gazebo's own floor, which may always be touched."""
_MAX_SHOWN = 12
_OtherSide = Callable[[str, str], str | None]


def _is_of(name: str, model: str) -> bool:
    """Whether a collision is of a model: `model::link::collision`, also with the name of an outer one before."""
    return any(fnmatchcase(part, model) for part in name.split("::")[:-1])


def fits_floor(model: str) -> bool:
    """Whether a name of a model, with `*` for any text, is also one of the floor, as `*` alone is of everything."""
    return fnmatchcase(_FLOOR, model)


def _of_markers(content: Any, other_side: _OtherSide) -> Iterator[tuple[str, float]]:
    """Contacts of our own recordings: each thing's name, and its force in newtons as text; several are added."""
    del other_side  # they are all of the robot
    sums: dict[str, float] = {}
    for marker in content.markers:
        found = re.match(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", marker.text)
        sums[marker.ns] = sums.get(marker.ns, 0.0) + (float(found[0]) if found else math.nan)
    yield from sums.items()


def _of_states(content: Any, other_side: _OtherSide) -> Iterator[tuple[str, float]]:
    """Contacts of Gazebo classic."""
    for state in content.states:
        name = other_side(state.collision1_name, state.collision2_name)
        if name is not None:
            forces = [_along(wrench.force, state.contact_normals, i) for i, wrench in enumerate(state.wrenches)]
            yield name, sum(forces) if forces else math.nan


def _of_contacts(content: Any, other_side: _OtherSide) -> Iterator[tuple[str, float]]:
    """Contacts of Gazebo, by its bridge."""
    for contact in content.contacts:
        name = other_side(contact.collision1.name, contact.collision2.name)
        if name is not None:
            forces = [_along(w.body_1_wrench.force, contact.normals, i) for i, w in enumerate(contact.wrenches)]
            yield name, sum(forces) if forces else math.nan


def _along(force: Any, normals: Sequence[Any], index: int) -> float:
    """The part of a force along its contact's normal, in newtons; all of it where the normal is not told."""
    size = math.hypot(force.x, force.y, force.z)
    if index >= len(normals):
        return size
    normal = normals[index]
    length = math.hypot(normal.x, normal.y, normal.z)
    return abs(force.x * normal.x + force.y * normal.y + force.z * normal.z) / length if length > 0 else size


_STATES = "gazebo_msgs/msg/ContactsState"
CONTACT_TYPES: Mapping[str, Callable[[Any, _OtherSide], Iterator[tuple[str, float]]]] = {
    _STATES: _of_states,
    "ros_gz_interfaces/msg/Contacts": _of_contacts,
    "visualization_msgs/msg/MarkerArray": _of_markers,
}
"""Readers of contacts by type: what the robot touched, and how hard in newtons; NaN: that is not told."""
MARKERS = "visualization_msgs/msg/MarkerArray"
"""Type of contacts in our own recordings, which others draw anything with."""

_ALL_AROUND_RAD = math.radians(350)
"""Scans that see more are all around: many lidars have a gap of a few degrees between the last ray and the first."""


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
        """Rays that ever told anything, also that nothing was there."""
        self._has_seen = False

    def meter(self, rule: Rule[Any]) -> Callable[[float], tuple[float, str] | None]:
        """Meter of the smallest distance since it was last called; without a new scan it is that of the last one."""
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
        """Finds out where the lidar is on the robot and which way its rays go; what it cannot see is an error."""
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
        self._check_nearest(scan.range_min)
        return True

    def finish(self) -> None:
        """Checks at the end whether the lidar saw anything, and all around: rays may be dead, or blocked."""
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

    def _check_nearest(self, range_min_m: float) -> None:
        """A limit nearer than the lidar's least range could not be missed."""
        assert self._mount is not None
        away_m = math.hypot(self._mount[0, 3], self._mount[1, 3])
        for rule in self.source.rules:
            least_m = getattr(rule.asked, "min_m", math.inf)
            if least_m + self._radius_m - away_m < range_min_m:
                rule.fail(
                    f"{self.topic} sees nothing nearer than {range_min_m:g} m, so a clearance of {least_m:g} m from a "
                    f"robot with a radius of {self._radius_m:g} m could not be missed"
                )

    def _fail(self, why: str) -> None:
        for rule in self.source.rules:
            if rule.violated_s is None:  # what was found stands
                rule.fail(why)
