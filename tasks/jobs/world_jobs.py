"""Runs world generation jobs and world export jobs."""

import logging
import os
import threading
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress

from ...schemas.documents.worlds import (
    WorldDocument,
    WorldExportJobDocument,
    WorldExportProgress,
    WorldFailureCount,
    WorldFailures,
    WorldGenerationJobDocument,
    WorldGenerationProgress,
)
from ...schemas.lifecycles import is_terminal
from ...schemas.operations.world_generation_jobs import too_many_worlds
from ...schemas.wire.arns import world_id
from ...schemas.wire.common import shorten
from ...schemas.wire.errors import (
    BucketNotFoundError,
    LeaseLostError,
    ObjectNotFoundError,
    ResourceNotFoundException,
    StateConflictError,
    StorageAccessDeniedError,
    StorageError,
    StorageUnavailableError,
)
from ..catalog import Resource
from ..execution.credential_blocks import read_credential_block
from ..execution.leases.job_leases import Lease
from ..execution.leases.leased_runs import run_if_unclaimed
from ..execution.task_pool import run_tasks, step_runner
from ..service.service import Progress, Service
from ..simulations.outputs.output_places import prepare_bucket
from ..worlds.archive_places import archive_place
from ..worlds.builders import WorldBuilders
from ..worlds.generation import WorldFailure, generate_world
from ..worlds.reuse import reuse_world

WorldJobProgress = WorldGenerationProgress | WorldExportProgress


def cancel_world_job(arn: str, kind: str, service: Service, work: Callable[[Lease], None]) -> None:
    """Cancels a world generation or export job: at once if idle, else as soon as its worker notices.

    Cancelling a job that has ended, or is being cancelled, changes nothing and succeeds.

    Args:
        arn: The job.
        kind: The resource kind it has to be.
        service: The service, with its catalog and object store.
        work: Ends a job that is being cancelled, holding its lease.

    Raises:
        ResourceNotFoundException: The catalog has no such job.
    """
    service.catalog.get(arn, kind=kind)
    if is_terminal(kind, service.catalog.request_cancel(arn).status):
        return
    with suppress(StateConflictError):  # it has just ended, or is being cancelled already
        service.catalog.transition(arn, "cancel")
    run_if_unclaimed(arn, kind, service, work)


def move_on(lease: Lease, event: str, changes: WorldJobProgress | None = None) -> bool:
    """Applies an event to a job, unless the job is being cancelled: then it ends as cancelled.

    Args:
        lease: The right to change the job.
        event: The event to apply.
        changes: Members of the document that are set with it, without those of failures if it is cancelled.

    Returns:
        Whether the event happened; false: the job is `Canceled` now.

    Raises:
        StateConflictError: The event cannot happen, or the lease was lost.
    """
    try:
        lease.transition(event, changes)
    except StateConflictError:
        if lease.refreshed().status != "Canceling":
            raise
        lease.transition("canceled", changes and changes.without("failure_code", "failure_reason"))
        return False
    return True


def end_canceled(lease: Lease, changes: WorldJobProgress | None = None) -> None:
    """Sets the status of a world generation or export job to canceled, and adds changes, if any, to its document.

    Raises:
        StateConflictError: The job has ended, or its lease was lost.
    """
    with suppress(StateConflictError):
        lease.transition("cancel")
    lease.transition("canceled", changes)


NO_FAILURES = WorldFailures()
"""Failure summary of a job in which no world failed."""


def run_generation(lease: Lease, service: Service) -> None:
    """Runs a world generation job to its end; a job that asks for too many worlds fails.

    AWS RoboMaker did the same: the call accepted any number, and the job then failed.
    """
    count = WorldGenerationJobDocument.of(lease.job).request.world_count
    most = service.settings.max_worlds_per_job
    reason = too_many_worlds(count.floorplan_count, count.interior_count_per_floorplan, most)
    if reason and lease.job.status == "Pending":
        move_on(
            lease,
            "fail",
            WorldGenerationProgress(
                failures=NO_FAILURES,
                succeeded_worlds=[],
                failure_code="AllWorldGenerationFailed",
                failure_reason=reason,
            ),
        )
    elif reason and lease.job.status == "Canceling":
        worlds = service.catalog.children(lease.job.arn, kind="world")
        made = in_order(world.arn for world in worlds)
        end_canceled(lease, WorldGenerationProgress(failures=NO_FAILURES, succeeded_worlds=made))
    else:
        GenerationRun(lease, service).run()


class GenerationRun:
    """Runs one world generation job, holding its lease (lock).

    Args:
        lease: The right to change the job.
        service: The service, with its catalog and object store.
    """

    def __init__(self, lease: Lease, service: Service) -> None:
        self._lease = lease
        self._job = job = lease.job
        self._service = service.patient(job.id, self._stopped)
        self._total = WorldGenerationJobDocument.of(job).request.world_count.total
        self._lock = threading.Lock()
        self._made: set[str] = set()
        self._taken_over = 0
        self._failures: list[WorldFailure] = []

    def run(self) -> None:
        """Generates every missing world of a world generation job, and sets the job's final status.

        Worlds that exist are kept, and those of earlier jobs are reused if the job allows it. Worlds that cannot be
        made are recorded as failures. Does nothing if the job cannot be started, as when it was cancelled.
        """
        if self._job.status == "Pending" and not move_on(self._lease, "start"):
            return
        self._made = {world.arn for world in self._service.catalog.children(self._job.arn, kind="world")}
        if len(self._made) > WorldGenerationJobDocument.of(self._job).made_when_taken:
            # It has come further since: dead job workers count anew.
            self._lease.update(WorldGenerationProgress(made_when_taken=len(self._made)))
            self._lease.forget_lost_workers()
        arns = [self._service.arn("world", world_id(self._job.id, number)) for number in range(1, self._total + 1)]
        missing = [(index, arn) for index, arn in enumerate(arns) if arn not in self._made]
        if WorldGenerationJobDocument.of(self._job).reuse:
            missing = [(index, arn) for index, arn in missing if not self._reused(index, arn)]
        if missing and not self._stopped():
            self._record_failures()  # those of a job worker that died are tried again
            with suppress(StorageError):  # worlds that cannot be stored now are not worth building; they say so
                prepare_bucket(self._service, self._service.settings.bucket)
            self._generate(missing)
        self._settle()

    def _reused(self, index: int, world_arn: str) -> bool:
        """Whether an equal world was found and is recorded in place of generating one; false if the job has to stop."""
        if self._stopped() or not reuse_world(self._service, self._job, index, world_arn):
            return False
        self._taken_over += 1
        self._note_end(world_arn, None)
        return True

    def _make_world(self, index: int, world_arn: str, builders: WorldBuilders) -> None:
        """Generates and stores one world, and records it or its failure; several threads call it.

        Does nothing if the job has to stop.
        """
        if self._stopped():
            return
        failure = generate_world(self._service, self._job, index, world_arn, builders, step_runner())
        if failure is None or not self._stopped():  # a stopped builder is no failed world
            self._note_end(world_arn, failure)

    def _stopped(self) -> bool:
        """Whether no more worlds should be generated, because the job was cancelled or its lease lost."""
        return self._lease.lost or self._service.catalog.cancel_requested(self._job.arn)

    def _note_end(self, world_arn: str, failure: WorldFailure | None) -> None:
        """Records a generated world (no failure) or a failure, and reports progress; several threads may call it."""
        with self._lock:
            if failure:
                self._failures.append(failure)
                self._record_failures()
            else:
                self._made.add(world_arn)
            done, failed = len(self._made), len(self._failures)
            taken_over = self._taken_over
        pending = self._total - done - failed
        counts = {"taken over": taken_over, "succeeded": done - taken_over, "failed": failed, "pending": pending}
        self._service.report_progress(Progress(counts, self._total))

    def _generate(self, missing: list[tuple[int, str]]) -> None:
        workers = min(len(missing), os.cpu_count() or 1)
        with WorldBuilders(workers, self._service.folder("logs") / "world-builders.log") as builders:

            def look() -> bool:
                if stopped := self._stopped():
                    builders.stop()
                return stopped

            def make_world(index: int, world_arn: str) -> None:
                self._make_world(index, world_arn, builders)

            run_tasks(
                "generate-world",
                make_world,
                [{"index": index, "world_arn": arn} for index, arn in missing],
                run_name="{world_arn}",
                workers=workers,
                job_arn=self._job.arn,
                service=self._service,
                look=look,
            )

    def _record_failures(self) -> None:
        """Stores the failures so far in the job, if they changed, so that descriptions of the running job have them."""
        summary = _failure_summary(self._failures)
        if summary != (WorldGenerationJobDocument.of(self._lease.job).failures or NO_FAILURES):
            with suppress(StateConflictError):  # another job worker has taken over
                self._lease.update(WorldGenerationProgress(failures=summary))

    def _settle(self) -> None:
        """Sets the world generation job's final status, and records the worlds that it generated.

        The status is canceled if worlds are missing without a failure, completed without failures, partially failed
        with some, and failed if every world failed. The record remains when worlds are deleted later.
        """
        failures, worlds = _failure_summary(self._failures), in_order(self._made)
        plans = plan_count(self._service.catalog.children(self._job.arn, kind="world"))
        made = WorldGenerationProgress(failures=failures, succeeded_worlds=worlds, plan_count=plans)
        if len(self._made) + len(self._failures) < self._total:
            end_canceled(self._lease, made)
        elif not self._failures:
            move_on(self._lease, "complete", made)
        elif len(self._failures) < self._total:
            move_on(self._lease, "partially_fail", made)
        else:
            failed = WorldGenerationProgress(
                failures=failures,
                succeeded_worlds=worlds,
                failure_code="AllWorldGenerationFailed",
                failure_reason=shorten(self._failures[0].reason),
            )
            move_on(self._lease, "fail", failed)


def _failure_summary(failures: list[WorldFailure]) -> WorldFailures:
    """Counts failures of worlds by failure code, most frequent first, with the reason of each code's first failure."""
    counts = Counter(failure.code for failure in failures)
    samples = {failure.code: failure.reason for failure in reversed(failures)}
    return WorldFailures(
        total_failure_count=len(failures),
        failures=[
            WorldFailureCount(failure_code=code, sample_failure_reason=shorten(samples[code]), failure_count=count)
            for code, count in counts.most_common()
        ],
    )


def plan_count(worlds: Iterable[Resource]) -> int | None:
    """Counts the different plans of worlds; `None` if worlds of early releases are among them."""
    plans = {WorldDocument.of(world).plan for world in worlds}
    return None if None in plans else len(plans)


def in_order(arns: Iterable[str]) -> list[str]:
    """Returns worlds (ARNs) sorted by number, so that later steps do not depend on which one finished first."""
    return sorted(arns, key=lambda arn: int(arn.rpartition("-")[2]))


_INTERNAL = "InternalServiceError"
_logger = logging.getLogger(__name__)


def run_export(lease: Lease, service: Service) -> None:
    """Runs a world export job: packs its worlds, stores the archive, and sets the job's final status.

    A cancelled job has its archive deleted. An error fails the job and is not raised, except `LeaseLostError`: then
    another process ends the job.
    """
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
    """Packs the worlds of an export job and uploads the archive.

    Returns false if the job was cancelled, or another job worker took it over, before the archive was stored. Raises
    `StorageUnavailableError` if the object store stays away while the job goes on.
    """
    from ..worlds.export_packing import export_worlds

    stopped = lambda: lease.lost or service.catalog.cancel_requested(lease.job.arn)  # noqa: E731
    patient = service.patient(lease.job.id, stopped)
    try:
        return export_worlds(lease.job, patient, _acting(lease.job, patient), stopped, step_runner()) is not None
    except StorageUnavailableError:
        if stopped():
            return False
        raise


def _acting(job: Resource, service: Service) -> Service:
    """Returns the service with the object store access of the job's role.

    Raises:
        StorageError: The job's role does not exist, or its credentials are refused.
    """
    return service.with_blocks(read_credential_block).acting_as(WorldExportJobDocument.of(job).request.iam_role)


def _remove_archive(job: Resource, service: Service) -> None:
    """Deletes the stored archive of a cancelled export job, also if its job worker died just after storing it.

    Does nothing if the job was never started or its bucket is gone; a failed deletion is logged and not raised.
    """
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
