"""Times of a rollout: maintenance windows, pauses and deadlines of robots; pure functions.

Windows begin by the clocks of their time zone, and last as long as they say, also on days on which clocks are changed.
Several that overlap, or follow one another without a gap, are one.
"""

import heapq
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, date, datetime, time, timedelta
from typing import get_args
from zoneinfo import ZoneInfo

from ....schemas.fleet.operations.deployment_jobs import MaintenanceWindow, Weekday
from ....schemas.fleet.rollouts.rollout import Pause, Paused, Resumed, RobotDeploymentState

_DAYS: tuple[str, ...] = get_args(get_args(Weekday)[0])
_AHEAD_DAYS = 8


def is_open(windows: Sequence[MaintenanceWindow], now_s: float) -> bool:
    """Whether a time is inside a maintenance window, so that robots may be updated.

    Args:
        windows: the windows; without any, robots may be changed at all times.
        now_s: the time, in seconds since the epoch.
    """
    return not windows or _is_in(_spans(windows, now_s), now_s)


def next_change_s(windows: Sequence[MaintenanceWindow], now_s: float) -> float | None:
    """Returns until when `is_open` keeps its value, in seconds since the epoch; `None` means forever.

    Usually the value changes then; if it does not for a week, it is only a time to ask again.
    """
    if not windows:
        return None
    spans = list(_spans(windows, now_s))
    is_open_now = _is_in(spans, now_s)
    moments = sorted({moment for span in spans for moment in span if moment > now_s})
    horizon_s = now_s + (_AHEAD_DAYS - 2) * 86400.0
    changes = (moment for moment in moments if moment <= horizon_s and _is_in(spans, moment) != is_open_now)
    return next(changes, horizon_s)


def opens_s(windows: Sequence[MaintenanceWindow], now_s: float) -> float:
    """Returns when a maintenance window is open next, in seconds since the epoch; now, if one is open."""
    moment: float | None = now_s
    while moment is not None and not is_open(windows, moment):
        moment = next_change_s(windows, moment)
    return now_s if moment is None else moment


def closed_spans(windows: Sequence[MaintenanceWindow], from_s: float, until_s: float) -> Iterator[tuple[float, float]]:
    """Yields the time spans without an open maintenance window, in seconds since the epoch."""
    moment: float | None = from_s
    since_s: float | None = None
    while moment is not None and moment < until_s:
        if not is_open(windows, moment):
            since_s = moment if since_s is None else since_s
        elif since_s is not None:
            yield since_s, moment
            since_s = None
        moment = next_change_s(windows, moment)
    if since_s is not None:
        yield since_s, until_s


def _is_in(spans: Iterator[tuple[float, float]] | Sequence[tuple[float, float]], moment_s: float) -> bool:
    return any(start_s <= moment_s < end_s for start_s, end_s in spans)


def _spans(windows: Sequence[MaintenanceWindow], now_s: float) -> Iterator[tuple[float, float]]:
    """Yields the beginnings and ends of the maintenance windows around a time, in seconds since the epoch."""
    for window in windows:
        zone = ZoneInfo(window.timeZone or "UTC")
        today = datetime.fromtimestamp(now_s, UTC).astimezone(zone).date()
        for offset in range(-2, _AHEAD_DAYS + 1):
            day = today + timedelta(days=offset)
            if window.days is None or _DAYS[day.weekday()] in window.days:
                start_s = _start_s(window, day, zone)
                yield start_s, start_s + window.durationInSeconds


def _start_s(window: MaintenanceWindow, day: date, zone: ZoneInfo) -> float:
    return datetime.combine(day, time.fromisoformat(window.startTime), zone).timestamp()


MOST_PAUSES = 100
"""Limit of the stored pauses of a rollout; earlier ones are deleted."""


def with_pause(pauses: tuple[Pause, ...], event: Paused | Resumed, now_s: float) -> tuple[Pause, ...]:
    """Returns a rollout's pauses after one begins or ends; a repetition changes nothing.

    Args:
        pauses: earlier pauses, oldest first.
        event: a person's decision.
        now_s: the time, in seconds since the epoch.
    """
    last = pauses[-1] if pauses else None
    is_paused = last is not None and last.until_s is None
    if isinstance(event, Paused):
        return pauses if is_paused else (*pauses, Pause(from_s=now_s))[-MOST_PAUSES:]
    return (*pauses[:-1], last.model_copy(update={"until_s": now_s})) if last is not None and is_paused else pauses


class Deadlines:
    """Queue of the times at which robots' open orders time out."""

    def __init__(self, robots: Mapping[str, RobotDeploymentState]) -> None:
        """Reads the deadlines of robots.

        Args:
            robots: state of each robot, in the plan's order; read whenever deadlines are needed.
        """
        self._robots = robots
        self._place = {robot: place for place, robot in enumerate(robots)}
        self._heap: list[tuple[float, int, str]] = []
        for robot, state in robots.items():
            self.add(robot, state)

    def add(self, robot: str, state: RobotDeploymentState) -> None:
        """Adds a robot's deadline, if it has one; its earlier deadlines are void."""
        if state.deadline_s is not None:
            heapq.heappush(self._heap, (state.deadline_s, self._place[robot], robot))

    def next(self) -> tuple[float, str] | None:
        """Returns the earliest valid deadline (seconds since the epoch) and its robot; `None` if there is none."""
        while self._heap:
            deadline_s, _, robot = self._heap[0]
            if self._robots[robot].deadline_s == deadline_s:
                return deadline_s, robot
            heapq.heappop(self._heap)
        return None
