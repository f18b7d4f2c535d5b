"""Concurrency limits of batches that have ended, on a Prefect server that was away when they did."""

import logging
from collections.abc import Collection

from prefect.client.orchestration import SyncPrefectClient
from prefect.exceptions import ObjectNotFound

from ..schemas.lifecycles import is_terminal
from ..schemas.settings import Settings
from ..tasks.execution.batch_slots import batches_with_limits, limit_name
from ..tasks.service.service import Service

_KIND = "simulation-job-batch"

_logger = logging.getLogger(__name__)


def leftover_limits(batches: Collection[str], service: Service) -> list[str]:
    """Lists the limits of batches that have ended, by the catalog; batches of other homes are not known there.

    Args:
        batches: their ids.
        service: where the catalog is.

    Returns:
        The names of their limits.
    """
    found = service.catalog.get_many([service.arn(_KIND, batch) for batch in batches])
    return [limit_name(batch.id) for batch in found.values() if is_terminal(batch.kind, batch.status)]


def remove_leftover_limits(client: SyncPrefectClient, settings: Settings) -> list[str]:
    """Deletes the limits of batches that have ended; returns their names."""
    if not (batches := batches_with_limits(client)):
        return []
    with Service.opened(settings) as service:
        names = leftover_limits(batches, service)
    removed: list[str] = []
    for name in names:
        try:
            client.delete_global_concurrency_limit_by_name(name)
        except ObjectNotFound:
            continue  # somebody else was faster
        removed.append(name)
    if removed:
        _logger.info("removed the concurrency limits of batches that have ended: %s", ", ".join(removed))
    return removed
