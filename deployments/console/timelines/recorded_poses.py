"""Poses of a robot along a run, from its recording, thinned out for a page."""

import math
import os
import struct
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from ....schemas.runs.requirement_kinds.kind import yaw_rad

ODOMETRY = "/odom"
"""Topic with the robot's pose; that of `indoor-navigation` is exact, and its frame is the world's."""
MOST_POSES = 4_000
"""Limit of the poses that a page gets: all of 80 s at 50 Hz, and some 200 kB as JSON."""
_MOST_MESSAGES = 60_000
"""Limit of the messages that are read for a page: twenty minutes at 50 Hz, which take a second or two."""
_MOST_BYTES = 512 * 1024 * 1024
"""Limit of the size of a recording that is opened for a page."""


_NEAR_M = 0.25
"""Distance in metres up to which a pose is that of the path: a fast robot drives as far in a few samples."""
SLACK_S = 0.15
"""Seconds by which a recording or video may begin or end beside its run: control steps are that long at most."""
_HEADER_BYTES = 4
"""Bytes before the content of an encoded message, which say the order of its bytes."""
_STAMP_BYTES = 8


class Pose(NamedTuple):
    """Place of a robot on the ground at a simulated time."""

    time_s: float
    x: float
    y: float
    yaw_rad: float | None
    """Heading, from the x axis to the left; None: it is not recorded."""


class RecordedPoses(NamedTuple):
    """Poses of a run, or why there are none."""

    poses: Sequence[Pose]
    missing: str
    """Sentence with the reason why there are none; empty if there are some."""


def read_poses(recording: Path) -> RecordedPoses:
    """Reads the poses on `/odom` of a recording.

    Args:
        recording: Path of the MCAP file, which programs of the run may have written.
    """
    from ....tasks.runtime.judging.bags import Bag, RecordingFault  # imports rosbags, which other pages do without

    if os.stat(recording, follow_symlinks=False).st_size > _MOST_BYTES:  # noqa: PTH116 - links are not followed
        return RecordedPoses([], "The recording is too large to be read for a page.")
    try:
        bag = Bag(recording)
    except RecordingFault:
        return RecordedPoses([], "The recording cannot be read.")
    try:
        if not bag.has(ODOMETRY, ("nav_msgs/msg/Odometry",)) or not bag.counts[ODOMETRY]:
            return RecordedPoses([], f"The recording has no poses on {ODOMETRY}.")
        if bag.counts[ODOMETRY] > _MOST_MESSAGES:
            return RecordedPoses([], "The recording is too long to be read for a page.")
        poses = [_pose(time_ns, data) for time_ns, data in bag.raw(ODOMETRY)]
    except (RecordingFault, struct.error, IndexError):
        return RecordedPoses([], "The recording is damaged.")
    finally:
        bag.close()
    return RecordedPoses([each for each in poses if all(math.isfinite(number or 0.0) for number in each)], "")


def _pose(time_ns: int, data: bytes) -> Pose:
    """Reads the pose of an encoded `nav_msgs/msg/Odometry`: header, `child_frame_id`, position, quaternion.

    Raises:
        struct.error: The message is too short.
        IndexError: There is no message at all.
    """
    order = "<" if data[1] & 1 else ">"
    place = _HEADER_BYTES + _STAMP_BYTES
    for _ in range(2):  # `frame_id` and `child_frame_id`: a length, then the text with its final 0
        place += -place % 4
        place += 4 + struct.unpack_from(f"{order}I", data, place)[0]
    place += -(place - _HEADER_BYTES) % 8  # numbers of eight bytes are aligned behind the header
    x, y, _, turn_x, turn_y, turn_z, turn_w = struct.unpack_from(f"{order}7d", data, place)
    return Pose(time_ns / 1e9, x, y, yaw_rad((turn_w, turn_x, turn_y, turn_z)))


def fits(poses: Sequence[Pose], path: Sequence[tuple[float, float, float]], end_s: float) -> bool:
    """Whether poses are the places of a robot in its world, and their times simulated ones.

    Nodes may publish on the same topic: odometry that drifts, from another origin, or by another clock. A robot that
    stands is where any clock says it is, so that times have to be those of the run besides.

    Args:
        poses: Poses in the order of their times.
        path: (simulated time in s, x, y) of the robot, from the result; without one nothing says that they fit.
        end_s: Simulated time at the end of the run, in seconds.
    """
    times = [each.time_s for each in poses]
    if not path or not times or times[0] < -SLACK_S or times[-1] > end_s + SLACK_S:
        return False
    return all(
        math.dist((x, y), poses[max(0, bisect_left(times, time_s + 1e-6) - 1)][1:3]) <= _NEAR_M for time_s, x, y in path
    )


def thinned(poses: Sequence[Pose], moments_s: Iterable[float], most: int = MOST_POSES) -> list[Pose]:
    """Returns at most some thousand poses, those at marked moments among them.

    Args:
        poses: Poses in the order of their times.
        moments_s: Simulated times whose poses are kept: of each the last pose that is not after it.
        most: Limit of the poses between the marked ones.
    """
    if len(poses) <= most:
        return list(poses)
    times = [each.time_s for each in poses]
    # Times of moments are rounded, those of poses are not.
    marked = {max(0, bisect_left(times, moment + 1e-6) - 1) for moment in moments_s}
    step = math.ceil(len(poses) / most)
    kept = sorted({*range(0, len(poses), step), len(poses) - 1, *marked})
    return [poses[index] for index in kept]
