"""The run of a world export job: its worlds are packed, and the archive is stored."""

import logging

from ...schemas.documents.world_export_jobs import WorldExportJobDocument, WorldExportProgress
from ...schemas.wire.common import shorten
from ...schemas.wire.errors import (
    BucketNotFoundError,
    LeaseLostError,
    ObjectNotFoundError,
    ResourceNotFoundException,
    StorageAccessDeniedError,
    StorageError,
    StorageUnavailableError,
)
from ..catalog import Resource
from ..execution.blocks.credential_blocks import read_credential_block
from ..execution.job_leases import Lease
from ..execution.task_runs import step_runner
from ..service.service import Progress, Service
from ..worlds.archive_places import archive_place
from .world_jobs import end_canceled, move_on

_INTERNAL = "InternalServiceError"
_logger = logging.getLogger(__name__)


def run_export(lease: Lease, service: Service) -> None:
    """Carries an export job to its end: packs its worlds and stores the archive."""
    if lease.job.status == "Pending" and not move_on(lease, "start", WorldExportProgress(started=True)):
        return
    if lease.job.status == "Canceling" or service.catalog.cancel_requested(lease.job.arn):
        _remove_archive(lease.job, service)
        end_canceled(lease)
        return
    total = len(WorldExportJobDocument.of(lease.job).request.worlds)
    try:
        stored = _stored_archive(lease, service)
    except LeaseLostError:
        raise  # the job is another's to end
    except Exception as error:  # the job has to end whatever breaks
        code = _failure_code(error)
        if code == _INTERNAL:
            _logger.exception("world export job %s broke", lease.job.arn)
        reason = shorten(str(error) or type(error).__name__)
        move_on(lease, "fail", WorldExportProgress(failure_code=code, failure_reason=reason))
        service.report_progress(Progress({"failed": total}, total))
        return
    if not stored:
        end_canceled(lease)
    elif move_on(lease, "complete"):
        service.report_progress(Progress({"exported": total}, total))
    else:  # cancelled at the very last moment
        _remove_archive(lease.job, service)


def _stored_archive(lease: Lease, service: Service) -> bool:
    """Whether the archive is stored; not if the job is cancelled, or performed by another."""
    from ..worlds.export import export_worlds

    stopped = lambda: lease.lost or service.catalog.cancel_requested(lease.job.arn)  # noqa: E731
    patient = service.patient(lease.job.id, stopped)
    try:
        return export_worlds(lease.job, patient, _acting(lease.job, patient), stopped, step_runner()) is not None
    except StorageUnavailableError:
        if stopped():
            return False
        raise


def _acting(job: Resource, service: Service) -> Service:
    """The service as the job's role has it.

    Raises:
        StorageError: there is no such role, or its credentials are no good.
    """
    return service.with_blocks(read_credential_block).acting_as(WorldExportJobDocument.of(job).request.iam_role)


def _remove_archive(job: Resource, service: Service) -> None:
    """Removes what a cancelled job has stored, also where its job worker died just after that."""
    if not WorldExportJobDocument.of(job).started:
        return
    try:
        _acting(job, service).store.delete(*archive_place(job))
    except BucketNotFoundError:
        return
    except StorageError as error:
        _logger.warning("the archive of the cancelled job %s is left: %s", job.arn, error)


def _failure_code(error: Exception) -> str:
    if isinstance(error, StorageAccessDeniedError):
        return "AccessDenied"
    if isinstance(error, ResourceNotFoundException | BucketNotFoundError | ObjectNotFoundError):
        return "ResourceNotFound"
    return _INTERNAL
