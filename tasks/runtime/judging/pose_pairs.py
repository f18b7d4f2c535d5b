"""Pairs of a robot's estimated pose and its true pose at the same time, from a recording."""

import math
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any, NamedTuple, Protocol

from ....schemas.runs.requirement_kinds.kind import PlanarPose, PosePair, Rule, yaw_rad
from .bags import Message
from .frames import bare
from .poses import Pose, PoseTopic, TransformPoses

_MAX_APART_S = 10.0
"""Maximum difference in seconds between the delays of two topics with the same clock; localization takes tenths of a
second.
"""

Timed = Iterator[tuple[float, Message]]
"""Messages of a topic, each with its time in seconds since the run began."""


class StampedPose(NamedTuple):
    """A planar pose (m, m, rad) with the time at which it was received and the time on its stamp, in seconds."""

    time_s: float
    """Time at which the pose's message was received, in seconds since the run began."""
    stamp_s: float
    pose: PlanarPose


class Asked(Protocol):
    """Interface of a localization requirement: settings that decide how poses are paired."""

    max_m: float
    max_deg: float | None
    from_s: float


def poses_on(topic: PoseTopic, messages: Timed, path: object) -> Iterator[StampedPose]:
    """Yields the poses of a topic that has one in each message."""
    for time_s, message in messages:
        if topic.take(message, time_s, path):
            yield StampedPose(time_s, _stamp_s(message.content.header.stamp) or time_s, _planar(topic.pose))


def poses_in(transforms: TransformPoses, chain: Sequence[str], messages: Timed, path: object) -> Iterator[StampedPose]:
    """Yields the pose at the end of a chain of frames, at each new transform of the chain.

    The time of the pose is that of the innermost moving transform: localization nodes publish the transform to the
    odometry frame with a time in the future.
    """
    pose, stamp_s = transforms.pose(chain), math.nan
    innermost = [frame for frame in chain if not transforms.is_static(frame)][-1]
    for time_s, message in messages:
        transforms.take(message, time_s, path)
        moved = {bare(each.child_frame_id): each.header.stamp for each in message.content.transforms}
        if innermost in moved:
            stamp_s = _stamp_s(moved[innermost]) or time_s
        if moved.keys() & set(chain) and pose.is_known and math.isfinite(stamp_s):
            yield StampedPose(time_s, stamp_s, _planar(pose))


class PosePairs:
    """Pairs of an estimated pose and the true pose at its time, interpolated between two recorded ones."""

    def __init__(
        self, rule: Rule[Any], asked: Asked, names: tuple[str, str], max_gap_s: float, *, is_steady: bool
    ) -> None:
        """Prepares to compare the poses of two topics.

        Args:
            rule: Rule that compares the poses.
            asked: Requirement of the rule.
            names: Names of the topics with the estimated and the true pose.
            max_gap_s: Longest acceptable silence of a topic, in seconds.
            is_steady: Whether other code checks the silence of estimates; a topic of estimates may be silent while the
                robot stands still.
        """
        self._rule, self._asked, self._names = rule, asked, names
        self._max_gap_s, self._is_steady = max_gap_s, is_steady
        self._since: StampedPose | None = None
        """True pose at the last estimate, or at the beginning of the requirement."""

    def of(self, estimates: Iterator[StampedPose], truths: Iterator[StampedPose]) -> Iterator[PosePair]:
        """Yields pairs of an estimated and the true pose at its time, in the order of the estimates.

        The true pose is interpolated; an estimate without true poses on both sides in time is left out. The rule
        becomes an error if the two have no common clock, or the estimates pause too long.
        """
        first = next(estimates, None)
        ahead = [] if first is None else _until(first.time_s, truths)
        if first is not None and not self._has_one_clock(first, ahead):
            return
        truths = chain(ahead, truths)
        before = after = next(truths, None)
        for estimate in chain([] if first is None else [first], estimates):
            while after is not None and after.stamp_s < estimate.stamp_s:
                self._watch(after)
                before, after = after, next(truths, None)
            if before is None or after is None or before.stamp_s > estimate.stamp_s:
                continue  # there is no true pose on both sides of it
            truth = _between(before, after, estimate.stamp_s)
            self._since = StampedPose(estimate.time_s, estimate.stamp_s, truth)
            yield PosePair(estimate.time_s, estimate.pose, truth)
        for each in (after, *truths) if after is not None else ():
            self._watch(each)

    def _has_one_clock(self, estimate: StampedPose, truths: Sequence[StampedPose]) -> bool:
        """Returns whether the stamps of both topics have the same clock; records an error in the rule if not.

        The clock of a slow simulation falls behind the receive times, so that only poses with equal stamps can show it.
        """
        truth = min(truths, key=lambda each: abs(each.time_s - estimate.time_s), default=estimate)
        apart_s = (estimate.stamp_s - estimate.time_s) - (truth.stamp_s - truth.time_s)
        if abs(apart_s) <= _MAX_APART_S + abs(estimate.time_s - truth.time_s):
            return True
        first, second = self._names
        self._rule.fail(
            f"stamps on {first} and {second} are of two clocks, {abs(apart_s):.1f} s apart, so nothing says which "
            "poses belong together; stamp both by one clock"
        )
        return False

    def _watch(self, truth: StampedPose) -> None:
        """Records an error in the rule if the robot moved farther than the allowed error in a gap of estimates."""
        if truth.time_s < self._asked.from_s:
            return
        since = self._since = truth if self._since is None else self._since
        silent_s = truth.time_s - max(since.time_s, self._asked.from_s)
        away_m = math.dist(truth.pose[:2], since.pose[:2])
        turned_deg = abs(math.degrees(math.remainder(truth.pose[2] - since.pose[2], math.tau)))
        is_far = away_m > self._asked.max_m or turned_deg > (self._asked.max_deg or math.inf)
        if not self._is_steady and is_far and silent_s > self._max_gap_s and self._rule.violated_s is None:
            silence = f"no message on {self._names[0]} from {since.time_s:.2f} to {truth.time_s:.2f} s"
            self._rule.fail(
                f"{silence}, longer than max_gap_s ({self._max_gap_s:g} s), while the robot went {away_m:.2f} m, so an "
                "error could have been missed"
            )


def _until(time_s: float, poses: Iterator[StampedPose]) -> list[StampedPose]:
    """Reads the poses up to a time in seconds, and the first one at or after it, from an iterator."""
    found: list[StampedPose] = []
    for pose in poses:
        found.append(pose)
        if pose.time_s >= time_s:
            break
    return found


def _between(before: StampedPose, after: StampedPose, stamp_s: float) -> PlanarPose:
    """Interpolates a planar pose (m, m, rad) at a time in seconds between two others."""
    passed_s = after.stamp_s - before.stamp_s
    share = (stamp_s - before.stamp_s) / passed_s if passed_s > 0 else 0.0
    (x0, y0, yaw0), (x1, y1, yaw1) = before.pose, after.pose
    turned = math.remainder(yaw1 - yaw0, math.tau)
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0), yaw0 + share * turned


def _planar(pose: Pose) -> PlanarPose:
    return pose.position[0], pose.position[1], yaw_rad(pose.orientation)


def _stamp_s(stamp: Any) -> float:
    """Converts a ROS time stamp to seconds; 0 if it was never set."""
    return stamp.sec + stamp.nanosec / 1e9
