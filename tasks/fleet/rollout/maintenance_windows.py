"""Maintenance windows of a rollout: whether one is open, and when that changes; pure functions of them and the time.

Windows begin by the clocks of their time zone, and last as long as they say, also on days on which clocks are changed.
Several that overlap, or follow one another without a gap, are one.
"""

from collections.abc import Iterator, Sequence
from datetime import UTC, date, datetime, time, timedelta
from typing import get_args
from zoneinfo import ZoneInfo

from ....schemas.fleet.operations.deployment_jobs import MaintenanceWindow, Weekday

_DAYS: tuple[str, ...] = get_args(get_args(Weekday)[0])
_AHEAD_DAYS = 8


def is_open(windows: Sequence[MaintenanceWindow], now_s: float) -> bool:
    """Whether a time is inside a maintenance window, so that robots may be updated.

    Args:
        windows: The windows; without any, robots may be changed at all times.
        now_s: The time, in seconds since the epoch.
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
