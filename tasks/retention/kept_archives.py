"""Kept archives of applications that no job names any more: no rerun of a job would ask for them."""

from collections.abc import Set
from datetime import timedelta

from ...schemas.documents.simulation_jobs import ARCHIVE
from ...schemas.reports.retention import GcItem
from ..service.service import Service
from ..simulations.inputs.kept_archives import FOLDER, kept_archives
from .inventory import texts_of_jobs
from .removal import problem_of_removal

_LEAST = timedelta(days=1)
"""Least age of deleted archives: a job that is being prepared has kept its archive, and does not name it yet."""


def collect_archives(older_than: timedelta | None, besides: Set[str], service: Service, *, act: bool) -> list[GcItem]:
    """Deletes kept archives of applications with which no remaining job was run.

    Args:
        older_than: The time; less than a day, or none, counts as a day.
        besides: ARNs of jobs that do not count, since they go.
        service: The service, with its catalog and object store.
        act: Whether they are removed; otherwise it is only said what would be.

    Returns:
        What goes, as one item.
    """
    before = service.clock() - max(older_than or _LEAST, _LEAST)
    found = [each for each in kept_archives(service) if each.modified_at is not None and each.modified_at < before]
    if not found:
        return []
    named = {text.removeprefix(ARCHIVE) for text in texts_of_jobs(service, besides) if text.startswith(ARCHIVE)}
    unused = [each for each in found if each.key.rpartition("/")[2] not in named]
    if not unused:
        return []
    item = GcItem(
        kind="copies",
        id=FOLDER,
        ended_at=max(each.modified_at for each in unused if each.modified_at is not None),
        state="unused",
        action="remove",
        reason=f"{len(unused)} {'archive' if len(unused) == 1 else 'archives'} that no job names",
        objects=len(unused),
        size_bytes=sum(each.size_bytes for each in unused),
    )
    return [item.model_copy(update={"problem": problem_of_removal(unused, service)}) if act else item]
