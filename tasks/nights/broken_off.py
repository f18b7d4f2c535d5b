"""Interrupted runs, whose process died before they had ended: lists them, and says whether each is resumed."""

import os
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from ...schemas.reports.history import MissedNight
from ...schemas.reports.names import began
from ...schemas.reports.run_record import Order
from ...schemas.settings import Settings
from ..inspection.run_records import RECORD_NAME
from ..jobs.job_owners import environment_here
from .open_runs import LOCK, has_broken_off, read_order

MOST_INTERRUPTIONS = 10
"""Limit of the processes that a run may lose; above it a person decides, as the run may be the cause."""

MOST_QUICK_DEATHS = 3
"""Limit of consecutive processes that die soon after they have resumed a run; above it a person decides.

Restarts of services are not so many, nor so soon.
"""

_SOON_S = 600.0
_NEXT = "the next process that may run jobs finishes it"

_REMOTE_SILENCE_S = 120.0
"""Time without a sign of life after which a process on another machine counts as dead, in seconds.

A network file system may not show its lock.
"""


@dataclass(frozen=True)
class BrokenOff:
    """An interrupted run: its process has died before the run ended."""

    order: Order
    folder: Path
    died_at: datetime
    """Time of the last sign of life of an interrupted run's process."""
    limits: tuple[str, ...]
    """Reason why no process resumes the interrupted run automatically, in words; empty: one does."""
    differences: tuple[str, ...]
    """Differences between this process's environment and the one that the run needs; empty: none."""
    command: str
    """Command that resumes an interrupted run as it was ordered."""

    @property
    def why_left(self) -> str:
        """Reason why this process cannot finish the interrupted run; empty if it will."""
        needs = f"it needs another environment than this process has: {'; '.join(self.differences)}"
        return "; ".join([*self.limits, *([needs] if self.differences else [])])

    @property
    def run_id(self) -> str:
        """Id of the interrupted run."""
        return self.order.run_id

    @property
    def place(self) -> str:
        """Machine on which a command has to be typed, as text: `on vm: `; empty if any machine will do."""
        return f"on {self.order.needed.machine}: " if self.order.needed else ""

    def in_words(self) -> str:
        """Describes the interrupted run in a sentence or two: whose death interrupted it, and what resumes it.

        It begins `RUN: OWNER died at about 2026-11-27 02:10 UTC, before the run had ended; `.
        """
        owner = self.order.owner or "its process"
        died = f"{self.run_id}: {owner} died at about {self.died_at:%Y-%m-%d %H:%M} UTC, before the run had ended"
        return f"{died}; {self.why_left or _NEXT}"


def broken_off_runs(settings: Settings, now: datetime | None = None) -> list[BrokenOff]:
    """Lists the interrupted runs of a data home, oldest first.

    Args:
        settings: Settings of this process, with which each run's needs are compared.
        now: The time; `None`: that of the clock.
    """
    folders = (path.parent for path in (settings.home / "runs").glob(f"*/{LOCK}"))
    found = [run for folder in folders if (run := broken_off(folder, settings, now)) is not None]
    return sorted(found, key=lambda run: began(run.run_id))


def unfinished_nights(settings: Settings, name: str) -> list[MissedNight]:
    """Lists the interrupted runs of a specification, in the form in which its history shows them.

    Args:
        settings: Settings of this process.
        name: Name of the specification.
    """
    return [
        MissedNight(
            due_at=run.order.started_at,
            reason=f"its process died; {f'{run.place}{run.command}' if run.why_left else _NEXT}",
            has_begun=True,
        )
        for run in broken_off_runs(settings)
        if run.order.name == name and run.order.started_at is not None
    ]


def broken_off(folder: Path, settings: Settings, now: datetime | None = None) -> BrokenOff | None:
    """Returns the interrupted run in a folder; `None` if the run was not interrupted, has ended, or goes on.

    A run of another machine counts as interrupted only after some silence.
    """
    if not has_broken_off(folder) or (order := read_order(folder)) is None:
        return None
    if (folder / RECORD_NAME).is_file():
        return None  # it had ended, and was killed while it cleaned up
    try:
        died_at = datetime.fromtimestamp((folder / LOCK).stat().st_mtime, UTC)
    except OSError:
        return None  # it was taken up and has ended meanwhile
    now = now or datetime.now(UTC)
    is_elsewhere = order.owner is not None and order.owner.machine != socket.gethostname()
    if is_elsewhere and (now - died_at).total_seconds() < _REMOTE_SILENCE_S:
        return None
    here = environment_here(order.needed, settings, os.environ) if order.needed else None
    return BrokenOff(
        order=order,
        folder=folder,
        died_at=died_at,
        limits=tuple(_limits(order, died_at, settings, now)),
        differences=tuple(order.needed.differences(here)) if order.needed and here else (),
        command=order.needed.command(order.run_id, here) if order.needed else f"robomaker perform {order.run_id}",
    )


def _limits(order: Order, died_at: datetime, settings: Settings, now: datetime) -> Iterator[str]:
    if not settings.finish_within_hours:
        yield "runs are not finished by themselves (ROBOMAKER_FINISH_WITHIN_HOURS is 0)"
    elif now - died_at > timedelta(hours=settings.finish_within_hours):
        hours = (now - died_at).total_seconds() / 3600
        limit = f"runs are finished within {settings.finish_within_hours} h (ROBOMAKER_FINISH_WITHIN_HOURS)"
        yield f"that is {hours:.0f} h ago, and {limit}"
    if _quick_deaths(order, died_at) >= MOST_QUICK_DEATHS or len(order.interruptions) >= MOST_INTERRUPTIONS:
        yield f"it has lost {len(order.interruptions) + 1} processes, so that it may be what kills them"


def _quick_deaths(order: Order, died_at: datetime) -> int:
    """Returns how many of the last processes died soon after they had resumed the run."""
    deaths = [*(each.lost_at for each in order.interruptions[1:]), died_at]
    lives = [
        (death - each.continued_at).total_seconds() for each, death in zip(order.interruptions, deaths, strict=False)
    ]
    return next((count for count, life_s in enumerate(reversed(lives)) if life_s > _SOON_S), len(lives))
