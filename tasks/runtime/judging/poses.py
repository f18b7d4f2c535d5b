"""Poses of frames in a recording, from topics with one pose in each message or from `/tf`."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ....schemas.runs.recording_sources import RecordingSources
from .bags import Message
from .frames import FrameTree, Matrix, bare, matrix_of, quaternion_of
from .silences import Source

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


class Pose:
    """Latest pose of a frame in the map (metres; quaternion, w first), updated in place; NaN before a message."""

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
        """Sets the frame's latest pose from a 4 × 4 matrix in metres, and notes if it ever tilts or rises."""
        self.position[:] = matrix[:3, 3].tolist()
        self.orientation[:] = quaternion_of(matrix)
        self.tilts = self.tilts or abs(matrix[2, 0]) + abs(matrix[2, 1]) > _PLANAR
        self._first_z_m = self.position[2] if math.isnan(self._first_z_m) else self._first_z_m
        self.rises = self.rises or abs(self.position[2] - self._first_z_m) > _PLANAR


class PoseTopic:
    """A recorded topic with one pose in each message, and the latest of its poses."""

    def __init__(self, topic: str, sources: RecordingSources) -> None:
        self.source = Source(topic, sources.max_gap_s)
        self.pose = Pose([self.source])
        self.frame = ""
        """Name of the frame in which the poses are given; empty before the first pose."""

    def take(self, message: Message, time_s: float, path: object) -> bool:
        """Reads the pose of a recorded message, and returns whether its numbers are valid; invalid poses are ignored.

        Args:
            message: The message.
            time_s: Time in the run, in seconds.
            path: Path of the recording, for errors.
        """
        self.source.check_stamp(message.content.header.stamp, path)
        matrix = matrix_of(*_POSES[message.type](message.content))
        if matrix is None:
            return False
        self.frame = self.frame or bare(message.content.header.frame_id)
        self.source.hear(time_s)
        self.pose.set(matrix)
        return True


class TransformPoses:
    """Poses of frames, computed from recorded `/tf` messages and updated with each of them."""

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
        """Returns the pose at the end of a chain of frames (see `FrameTree.chain`); later `/tf` messages update it."""
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
        """Reads the transforms of a recorded `/tf` message, and updates the poses that depend on them.

        Args:
            message: The message.
            time_s: Time in the run, in seconds.
            path: Path of the recording, for errors.
        """
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
        """Records an error in rules whose chain of frames has a frame with a new parent: two nodes may publish it."""
        child, parent = bare(transform.child_frame_id), bare(transform.header.frame_id)
        for key, pose in self._poses.items():
            if child not in key:
                continue
            first = self._parents[key][key.index(child)]
            if first != parent:
                for rule in {id(rule): rule for source in pose.sources for rule in source.rules}.values():
                    rule.fail(f"{child!r} has two parents on /tf, {first!r} and {parent!r}; one of them would do")
