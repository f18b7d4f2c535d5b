"""Deletes local copies of worlds and unpacked applications that were not used for long.

They are downloaded again when they are needed, so nothing is lost.
"""

from collections.abc import Set
from datetime import UTC, datetime, timedelta
from pathlib import Path

from ...schemas.reports.retention import GcItem
from ..service.service import Service
from ..simulations.inputs.bundles import last_used, remove_unless_used
from .removal import Amount, on_disk

_CACHES = ("applications", "worlds", "world-packages")
_LEAST = timedelta(days=14)
"""Least age of deleted copies: as long as a job may run, which reads the files it began with."""


def collect_copies(older_than: timedelta, besides: Set[str], service: Service, *, act: bool) -> list[GcItem]:
    """Deletes cached local copies (of worlds, bundles, ...) that were not used recently.

    Args:
        older_than: Least time without use; less than 14 days count as 14 days.
        besides: Names of folders that are deleted with a world.
        service: The service, whose data home has the copies.
        act: Whether copies are deleted; otherwise the result only says which would be.

    Returns:
        The deleted copies, as one item for each cache.
    """
    before = service.clock() - max(older_than, _LEAST)
    items = (_collected(service.settings.home / "cache" / name, before, besides, act=act) for name in _CACHES)
    return [item for item in items if item is not None]


def _collected(cache: Path, before: datetime, besides: Set[str], *, act: bool) -> GcItem | None:
    total, gone, newest = Amount(), 0, datetime.min.replace(tzinfo=UTC)
    for copy in sorted(path for path in cache.glob("*") if path.is_dir() and path.name not in besides):
        used, amount = last_used(copy), on_disk(copy)
        if used < before and (not act or remove_unless_used(copy, before)):
            total, gone, newest = total + amount, gone + 1, max(newest, used)
    if not gone:
        return None
    return GcItem(
        kind="copies", id=f"cache/{cache.name}", ended_at=newest, state="unused", action="remove",
        reason=f"{gone} {'copy' if gone == 1 else 'copies'}, made again when needed",
        objects=total.objects, size_bytes=total.size_bytes,
    )  # fmt: skip
