"""Deletes recordings that `robomaker judge` stored and that no job and no unfinished run refers to any more."""

import re
from collections.abc import Iterator, Set
from datetime import timedelta
from itertools import groupby

from ...schemas.reports.retention import GcItem
from ...schemas.wire.errors import BucketNotFoundError
from ..inspection.judged_recordings import FOLDER, STORED_AGAIN
from ..inspection.run_records import ORDER_NAME
from ..service.service import Service
from ..storage.object_store import ObjectInfo
from .inventory import texts_of_jobs
from .removal import problem_of_removal

_LEAST = 2 * STORED_AGAIN
"""Least age of deleted recordings: a run that is about to refer to one has stored or found it recently."""
_KEY = re.compile(rf"{FOLDER}/[^\s\"'\\,\]}}]*")
"""Pattern of a recording's object-store key (or its beginning) in a specification, which is YAML or JSON."""


def collect_recordings(
    older_than: timedelta, besides: Set[str], service: Service, deployed: Set[str] = frozenset(), *, act: bool
) -> list[GcItem]:
    """Deletes stored recordings that no job and no open run names, once all of their objects are old enough.

    Args:
        older_than: The time; less than two days count as these.
        besides: ARNs of jobs, and ids of runs, that do not count, since they go.
        service: The service, with its catalog and object store.
        deployed: Texts of the specifications of deployments, whose runs begin later.
        act: Whether they are removed; otherwise it is only said what would be.

    Returns:
        One item for each recording.
    """
    before = service.clock() - max(older_than, _LEAST)
    named: set[str] | None = None
    items: list[GcItem] = []
    for folder, objects in _stored(service):
        if any(each.modified_at is None or each.modified_at >= before for each in objects):
            continue
        if named is None:
            named = {text for text in texts_of_jobs(service, besides) if text.startswith(FOLDER)}
            named |= _ordered(service, besides) | {key for text in deployed for key in _KEY.findall(text)}
        # A data source names a file of a recording, its folder, or the beginning of that.
        if not any(folder.startswith(text) or text.startswith(folder) for text in named):
            items.append(_collected(folder, objects, service, act=act))
    return items


def _ordered(service: Service, besides: Set[str]) -> set[str]:
    """Returns the recordings' keys in the orders of unfinished runs.

    An interrupted run may have no job yet, and is resumed later. If an order cannot be read, the key is that of the
    folder of all recordings.
    """
    named: set[str] = set()
    for path in (service.settings.home / "runs").glob(f"*/{ORDER_NAME}"):
        if path.parent.name in besides:
            continue
        try:
            named.update(_KEY.findall(path.read_text(encoding="utf-8")))
        except FileNotFoundError:  # it has just ended
            continue
        except (OSError, UnicodeDecodeError):
            named.add(FOLDER)  # it may name any
    return named


def _stored(service: Service) -> Iterator[tuple[str, list[ObjectInfo]]]:
    """Yields the recordings in the service's bucket: the key prefix of each, and its objects; none without a bucket."""
    try:
        found = list(service.store.list(service.settings.bucket, f"{FOLDER}/"))
    except BucketNotFoundError:
        return

    def folder_of(info: ObjectInfo) -> str:
        return "/".join(info.key.split("/")[:2]) + "/"

    for folder, objects in groupby(found, folder_of):
        yield folder, list(objects)


def _collected(folder: str, objects: list[ObjectInfo], service: Service, *, act: bool) -> GcItem:
    item = GcItem(
        kind="recording",
        id=folder.rstrip("/"),
        ended_at=max(each.modified_at for each in objects if each.modified_at is not None),
        state="unused",
        action="remove",
        objects=len(objects),
        size_bytes=sum(each.size_bytes for each in objects),
    )
    return item.model_copy(update={"problem": problem_of_removal(objects, service)}) if act else item
