"""Running one simulation job: prepare, run its process, publish its outputs, settle its end."""

import logging
import shutil
import subprocess
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from prefect import task
from prefect.cache_policies import NO_CACHE

from ..schemas.common import shorten
from ..schemas.errors import (
    BucketNotFoundError,
    LaunchError,
    ServiceUnavailableException,
    StorageAccessDeniedError,
    StorageError,
)
from ..schemas.simulation_run import RunOutcome
from .catalog import Resource
from .performing import Lease, perform_once
from .run_plans import run_plan
from .runtime.launcher import Launcher
from .service import Service
from .slots import Slots
from .storage import publish, read_manifest, store_unfinished
from .uploads import output_place, prepare_bucket

KIND = "simulation-job"

Stop = Callable[[], str | None]
"""Asked while a job runs; answers the failure code it should stop with, or `None`."""

_END_EVENTS = {"Completed": "complete", "Failed": "fail", "Canceled": "cancel"}
_CANCELED = "Canceled"

_logger = logging.getLogger(__name__)


class Batch(Protocol):
    """What a batch's performer offers to the tasks that run its requests."""

    def why_stop(self) -> str | None:
        """The failure code with which the batch's jobs have to stop, if they have to."""
        ...

    def create_job(self, index: int) -> Resource | None:
        """Turns a request into a job, once; `None` when it is refused for good."""
        ...

    def report(self) -> None:
        """Tells whoever watches how many requests are in which state."""
        ...


@task(name="simulate", cache_policy=NO_CACHE)
def simulate(arn: str) -> None:
    """Carries one simulation job to its end."""
    perform_job(arn, Service.current())


@task(name="simulate-request", task_run_name="request-{index}", cache_policy=NO_CACHE)
def simulate_request(batch: Batch, index: int, slots: Slots) -> None:
    """Turns one request of a batch into a job, while holding a slot of the batch, and runs it."""
    with slots.hold(lambda: batch.why_stop() is not None) as held:
        if held and (job := batch.create_job(index)) is not None:
            batch.report()
            perform_job(job.arn, Service.current(), batch.why_stop)
    batch.report()


def perform_job(arn: str, service: Service, stop: Stop = lambda: None) -> None:
    """Carries a simulation job from wherever it stands to its end.

    A job that a dead performer left half-way is run again from the start, as a new run with a
    folder of its own; nothing of the dead run has a manifest.

    Args:
      arn: the job.
      service: where it is stored.
      stop: asked several times a second; see `Stop`.
    """
    perform_once(arn, KIND, service, lambda lease: JobRun(lease, service, stop).run())


@cache
def launcher() -> Launcher:
    """The launcher of this process: one warm parent for all its simulation processes."""
    return Launcher()


class JobRun:
    """One performer's work on one simulation job.

    Args:
      lease: the right to change the job.
      service: where it is stored.
      stop: see `Stop`.
    """

    def __init__(self, lease: Lease, service: Service, stop: Stop) -> None:
        self._lease = lease
        self._service = service
        self._stop = stop

    def run(self) -> None:
        """Runs the job and settles its end; what breaks on the way fails the job."""
        if self._lease.job.status == "Terminating":
            self._settle(self._published_after_all())
            if run_id := self._lease.job.document.get("runId"):
                self._clean_up(run_id)
            return
        if reason := self._why_stop():
            self._terminate(_stopped(reason, "the job was stopped before it ran"))
            return
        run_id = self._service.clock().strftime("%Y-%m-%dT%H-%M-%S-%fZ")
        try:
            self._prepare_and_run(run_id)
        except LaunchError as error:
            self._terminate(_failed(error.failure_code, str(error)))
        except Exception as error:  # the job has to end whatever breaks
            _logger.exception("simulation job %s broke", self._lease.job.arn)
            self._terminate(_failed("InternalServiceError", f"{type(error).__name__}: {error}"))
        finally:
            self._clean_up(run_id)

    def _folder(self, run_id: str) -> Path:
        return self._service.settings.home / "jobs" / self._lease.job.id / run_id

    def _clean_up(self, run_id: str) -> None:
        """Removes what is not needed any more; outputs that could not be stored stay."""
        folder = self._folder(run_id)
        if "outputs" in self._lease.job.document:
            _remove(folder.parent)  # with what performers left that died
        elif any(Path(folder, "output").glob("*")):
            _remove(folder / "work")
            _remove(folder / "data")
        else:
            _remove(folder)
            with suppress(OSError):
                folder.parent.rmdir()

    def _why_stop(self) -> str | None:
        if self._lease.lost:
            return _CANCELED  # whoever took over runs the job again
        try:
            return _CANCELED if self._service.catalog.cancel_requested(self._lease.job.arn) else self._stop()
        except ServiceUnavailableException as error:  # nothing to end a run for; it is asked again at once
            _logger.warning("whether %s is to be stopped is not known: %s", self._lease.job.arn, error)
            return None

    def _prepare_and_run(self, run_id: str) -> None:
        folder = self._service.folder("jobs", self._lease.job.id, run_id)
        self._lease.transition("prepare", runId=run_id)
        self._prepare_bucket(run_id)
        plan = run_plan(self._lease.job, run_id, folder, self._service)
        self._lease.transition(
            "start",
            lastStartedAt=self._service.clock().isoformat(),
            networkInterface={
                "networkInterfaceId": f"eni-{self._lease.job.id.removeprefix('sim-')}",
                "privateIpAddress": "127.0.0.1",
            },
        )
        outcome = launcher().run(plan, lambda: "canceled" if self._why_stop() else None)
        ending = _ending(outcome, self._why_stop())
        self._lease.transition("terminate", ending=ending, finished=outcome.finished, **_without_status(ending))
        self._settle(self._published(run_id, ending))

    def _prepare_bucket(self, run_id: str) -> None:
        """Finds out before a long run that its outputs have nowhere to go."""
        bucket, _ = output_place(self._lease.job, run_id, self._service)
        try:
            prepare_bucket(self._service, bucket)
        except BucketNotFoundError as error:
            raise LaunchError(f"outputLocation.s3Bucket: {error}", "BadPermissionsS3Output") from error

    def _published(self, run_id: str, ending: dict[str, Any]) -> dict[str, Any]:
        """Publishes the outputs; returns the ending, which is a failure when that does not work.

        What a crashed or killed run left is stored too, but without a manifest: it is not whole.
        """
        job, output_dir = self._lease.job, self._folder(run_id) / "output"
        bucket, prefix = output_place(job, run_id, self._service)
        about = {"job": job.arn, "run": run_id, "seed": job.document["seed"], **ending}
        try:
            prepare_bucket(self._service, bucket)
            if job.document["finished"]:
                publish(self._service.store, bucket, prefix, output_dir, about=about, created_at=self._service.clock())
            else:
                store_unfinished(self._service.store, bucket, prefix, output_dir)
        except (StorageError, OSError) as error:
            refused = isinstance(error, StorageAccessDeniedError | BucketNotFoundError)
            code = "BadPermissionsS3Output" if refused else "InternalServiceError"
            reason = f"outputs could not be stored in s3://{bucket}/{prefix}: {error}; they are in {output_dir}"
            return _without_outputs(ending, code, reason)
        return {**ending, "outputs": {"bucket": bucket, "prefix": prefix}}

    def _published_after_all(self) -> dict[str, Any]:
        """The ending of a job whose performer died in the midst of publishing; its outputs may be here or stored."""
        document = self._lease.job.document
        ending, run_id = document["ending"], document.get("runId")
        if run_id is None or "finished" not in document:
            return ending  # it ended before it ran
        if self._folder(run_id).is_dir():
            return self._published(run_id, ending)
        bucket, prefix = output_place(self._lease.job, run_id, self._service)
        try:
            if document["finished"]:
                read_manifest(self._service.store, bucket, prefix)
        except StorageError as error:
            reason = f"the machine it ran on died before its outputs were stored in s3://{bucket}/{prefix}: {error}"
            return _without_outputs(ending, "InternalServiceError", reason)
        return {**ending, "outputs": {"bucket": bucket, "prefix": prefix}}

    def _terminate(self, ending: dict[str, Any]) -> None:
        if self._lease.job.status != "Terminating":
            self._lease.transition("terminate", ending=ending, **_without_status(ending))
        self._settle(ending)

    def _settle(self, ending: dict[str, Any]) -> None:
        self._lease.transition(_END_EVENTS[ending["status"]], **_without_status(ending))


def _remove(folder: Path) -> None:
    """Removes a run's folder as far as that is possible."""
    try:
        shutil.rmtree(folder, ignore_errors=True)
    except RecursionError:  # an application made folders a thousand levels deep, and rm does not mind
        subprocess.run(["rm", "-rf", "--", str(folder)], check=False)


def _without_outputs(ending: dict[str, Any], code: str, reason: str) -> dict[str, Any]:
    """An ending that lost its outputs: a crash that came before keeps its code, a cancelled job stays cancelled."""
    reasons = [reason, ending["failureReason"]] if "failureReason" in ending else [reason]
    failure = _failed(code, "\n".join(reasons))
    if ending["status"] != "Completed":
        failure |= {"status": ending["status"], "failureCode": ending.get("failureCode", code)}
    return ending | failure


def _ending(outcome: RunOutcome, stopped_because: str | None) -> dict[str, Any]:
    """What the catalog keeps of an outcome."""
    ending: dict[str, Any] = {"status": outcome.status}
    if outcome.failure_code:
        ending |= _failed(outcome.failure_code, outcome.failure_reason or "") | {"status": outcome.status}
    elif outcome.status == _CANCELED:
        ending = _stopped(stopped_because or _CANCELED, "the job was stopped while it ran")
    duration = outcome.ended_at - outcome.started_at
    return ending | {"simulationTimeMillis": round(duration.total_seconds() * 1000)}


def _stopped(reason: str, words: str) -> dict[str, Any]:
    if reason == _CANCELED:
        return {"status": _CANCELED}
    return {"status": _CANCELED, "failureCode": reason, "failureReason": words}


def _failed(code: str, reason: str) -> dict[str, Any]:
    return {"status": "Failed", "failureCode": code, "failureReason": shorten(reason)}


def _without_status(ending: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in ending.items() if key != "status"}
