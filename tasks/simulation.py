"""Running one simulation job: prepare, run its process, publish its outputs, settle its end."""

import logging
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from prefect import task
from prefect.cache_policies import NO_CACHE

from ..schemas.errors import LaunchError, StorageAccessDeniedError, StorageError
from ..schemas.simulation_run import RunOutcome, RunPlan
from .catalog import Resource
from .performing import Lease, perform_once
from .run_plans import run_plan
from .runtime.launcher import Launcher
from .service import Service
from .slots import Slots
from .storage import publish, store_unfinished
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
            # Whoever ran it died while publishing: how it ended is known, its outputs are not whole.
            self._settle(self._lease.job.document["ending"])
            return
        if reason := self._why_stop():
            self._terminate(_stopped(reason, "the job was stopped before it ran"))
            return
        run_id = self._service.clock().strftime("%Y-%m-%dT%H-%M-%S-%fZ")
        folder = self._service.folder("jobs", self._lease.job.id, run_id)
        try:
            self._prepare_and_run(run_id, folder)
        except LaunchError as error:
            self._terminate(_failed(error.failure_code, str(error)))
        except Exception as error:  # the job has to end whatever breaks
            _logger.exception("simulation job %s broke", self._lease.job.arn)
            self._terminate(_failed("InternalServiceError", f"{type(error).__name__}: {error}"))
        finally:
            if "outputs" in self._lease.job.document or not any(Path(folder, "output").glob("*")):
                _remove(folder)

    def _why_stop(self) -> str | None:
        if self._lease.lost:
            return _CANCELED  # whoever took over runs the job again
        return _CANCELED if self._service.catalog.cancel_requested(self._lease.job.arn) else self._stop()

    def _prepare_and_run(self, run_id: str, folder: Path) -> None:
        self._lease.transition("prepare", runId=run_id)
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
        self._lease.transition("terminate", ending=ending, **_without_status(ending))
        self._settle(self._published(plan, outcome, ending))

    def _published(self, plan: RunPlan, outcome: RunOutcome, ending: dict[str, Any]) -> dict[str, Any]:
        """Publishes the outputs; returns the ending, which is a failure when that does not work.

        What a crashed or killed run left is stored too, but without a manifest: it is not whole.
        """
        bucket, prefix = output_place(self._lease.job, plan.run_id, self._service)
        about = {"job": self._lease.job.arn, "run": plan.run_id, "seed": plan.seed, **ending}
        try:
            prepare_bucket(self._service, bucket)
            if outcome.finished:
                publish(self._service.store, bucket, prefix, plan.output_dir, about=about, created_at=outcome.ended_at)
            else:
                store_unfinished(self._service.store, bucket, prefix, plan.output_dir)
        except (StorageError, OSError) as error:
            code = "BadPermissionsS3Output" if isinstance(error, StorageAccessDeniedError) else "InternalServiceError"
            reason = f"outputs could not be stored in s3://{bucket}/{prefix}: {error}; they are in {plan.output_dir}"
            failure = _failed(code, reason)
            # A crash that came before keeps its code, a cancelled job stays cancelled.
            kept = {"status": failure["status"]} if ending["status"] == "Completed" else {}
            return {**failure, **ending, **kept}
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
    except RecursionError:  # an application made folders a thousand levels deep
        _logger.warning("%s could not be removed: it is nested too deeply", folder)


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
    return {"status": "Failed", "failureCode": code, "failureReason": reason[:1024]}


def _without_status(ending: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in ending.items() if key != "status"}
