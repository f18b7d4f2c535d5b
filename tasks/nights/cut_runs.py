"""Cleanup after probes and challenges, runs with reduced or changed requests: deletes what only they created."""

from contextlib import suppress
from datetime import datetime

from ...schemas.reports.run_record import RunRecord
from ...schemas.wire.errors import ResourceNotFoundException
from ..operations.registry import call
from ..service.service import Service

_DELETED_AFTERWARDS = {
    "CreateRobotApplication": ("DeleteRobotApplication", "application"),
    "CreateSimulationApplication": ("DeleteSimulationApplication", "application"),
    "CreateWorldTemplate": ("DeleteWorldTemplate", "template"),
}


def delete_made(record: RunRecord, since: datetime, service: Service) -> None:
    """Deletes the applications and templates that a probe or a challenge has created.

    Args:
        record: record of the probe's or challenge's run.
        since: time before which resources were not created by it.
        service: the service, with its catalog and object store.
    """
    for step in reversed(record.steps):
        arn = step.arn or step.output.get("arn")
        if arn is None or step.operation not in _DELETED_AFTERWARDS:
            continue
        delete, member = _DELETED_AFTERWARDS[step.operation]
        with suppress(ResourceNotFoundException):
            if service.catalog.get(arn).created_at >= since:
                call(delete, {member: arn}, service)
