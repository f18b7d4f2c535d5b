"""Runs a deployment job: prepares files, gives robots orders wave by wave, and shows the progress in Prefect."""

import logging
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import cast

from ...schemas.documents.document_base import FailureChanges
from ...schemas.fleet.documents import DeploymentJobDocument, RobotDocument
from ...schemas.fleet.operations.deployment_jobs import DeploymentJobErrorCode
from ...schemas.fleet.rollouts.rollout import DeploymentReport, Rollout, Stopped
from ...schemas.lifecycles import is_terminal
from ...schemas.wire.arns import ResourceArn
from ...schemas.wire.common import counted, shorten
from ...schemas.wire.errors import (
    DeploymentError,
    ResourceNotFoundException,
    ServiceUnavailableException,
    StateConflictError,
    ThrottlingException,
)
from ..catalog import Resource
from ..execution.leases.job_leases import Lease
from ..execution.task_pool import directly, show_note, shown_as, step_runner
from ..service.service import Progress, Service
from ..simulations.planning.applications import find_application
from .catalog_rollouts import Rollouts
from .control.rollbacks import roll_back
from .fleet_records import DEPLOYMENT, fleet_held, is_meant, robots_of, settle
from .kept_rollouts import KeptRollout, stop
from .reporting.deployment_page import write_deployment
from .rollout.statuses import counts_of, in_words, waits_for
from .rollout.waves import waves_of
from .rollout_beginnings import Prepared, begin_rollout, delivery, plan_of
from .views.deployment_report import report_of, report_path
from .views.rollout_tables import MOST_ROWS, robot_rows

_logger = logging.getLogger(__name__)


def show_wave(job: Resource, rollout: Rollout, number: int, robots: Sequence[str]) -> None:
    """Shows the robots of a deployment's wave as a table in Prefect; does nothing outside a flow run."""
    if step_runner() is directly:
        return
    from ..execution.prefect_artifacts import artifact_key, show_table

    more = f", the first {MOST_ROWS} of {len(robots)}" if len(robots) > MOST_ROWS else ""
    show_table(artifact_key(job.id, f"wave-{number}"), robot_rows(rollout, robots), f"Robots of wave {number}{more}")


def report_end(job: Resource, service: Service) -> None:
    """Writes the HTML report of a finished deployment, and shows in Prefect where it is.

    It never raises an error: a report that could not be written is logged.
    """
    try:
        report = report_of(job, service)
        path = write_deployment(report, report_path(job, service))
    except Exception:  # the deployment has ended whatever is wrong with its report
        _logger.exception("the report of %s could not be written", job.arn)
        return
    if step_runner() is not directly:
        _show_end(job, report, str(path))


def _show_end(job: Resource, report: DeploymentReport, path: str) -> None:
    from ..execution.prefect_artifacts import artifact_key, show_table, show_text

    lines = [f"# {report.application} {report.version} to {report.fleet}: {report.status}", ""]
    lines += [f"{report.failure_code}: {report.failure_reason or ''}".rstrip(": "), ""] if report.failure_code else []
    rollout = report.rollout
    if rollout is not None:
        counts = ", ".join(f"{count} {word}" for word, count in counts_of(rollout).items())
        lines += [f"{counted(len(rollout.robots), 'robot')}: {counts}.", ""]
        bad = [robot for robot, state in rollout.robots.items() if state.outcome == "failed"]
        lines += [f"- **{ResourceArn.parse(robot).name}** {rollout.robots[robot].failure_code}" for robot in bad[:20]]
        show_table(artifact_key(job.id, "robots"), robot_rows(rollout, [*bad, *_others(rollout, bad)]), "Robots")
    lines += ["", f"Report: [{path}](file://{path})"]
    show_text(artifact_key(job.id, "summary"), "\n".join(lines), "How the run ended")


def _others(rollout: Rollout, bad: Sequence[str]) -> list[str]:
    left_out = frozenset(bad)
    return [robot for robot in rollout.plan.order if robot not in left_out]


POLL_S = 0.25
"""Interval between two polls for robots' reports, in seconds; a robot's place in the wave stays empty for as long."""

LOOK_AT_BATCH_S = 5.0
"""Seconds between two checks whether the required batch has passed."""

_LOOK_AT_APPLICATION_S = 5.0
_KEEP_ALIVE_S = 30.0


class DeploymentRun:
    """Runs a deployment job to completion.

    Args:
        lease: The right to change the job.
        service: The service, with its catalog and object store.
        sleep: Waits, in seconds.
    """

    def __init__(self, lease: Lease, service: Service, sleep: Callable[[float], None] = time.sleep) -> None:
        self._lease = lease
        self._service = service
        self._sleep = sleep
        self._step = step_runner()
        self._application_at_s = self._kept_alive_at_s = self._now_s()
        self._told: tuple[str, ...] = ()

    def run(self) -> None:
        """Prepares the deployment and rolls it out to robots, from its current state.

        Raises:
            ServiceUnavailableException: The catalog does not answer; run it again.
        """
        try:
            self._carry_on()
        except StateConflictError:
            if self._lease.lost:
                return  # another run goes on
            if not self._has_ended():
                raise
            stop(self._job.arn, "canceled", self._service)  # it was ended while it prepared
        self._settle()
        self._go_back()
        report_end(self._service.catalog.get(self._job.arn), self._service)

    def _carry_on(self) -> None:
        if self._job.status == "Pending" and not self._is_canceled():
            self._lease.transition("prepare")
        if self._job.status == "Preparing" and not self._is_canceled():
            self._prepare()
        if self._is_canceled() and not stop(self._job.arn, "canceled", self._service):
            self._lease.transition("cancel")
        if self._lease.refreshed().status == "InProgress":
            self._roll_out()

    def _prepare(self) -> None:
        try:
            if DeploymentJobDocument.of(self._job).required_batch is not None:
                self._step("wait-for-batch", self._wait_for_batch)
                if self._is_canceled():
                    return
            begun = self._step("prepare", self._begun)
        except (StateConflictError, ServiceUnavailableException):
            raise
        except Exception as error:  # the job has to end whatever breaks
            self._fail(*_failure(error, self._job))
            return
        self._lease.transition("start")
        if begun is None:
            self._lease.transition("succeed")

    def _wait_for_batch(self) -> None:
        """Waits until the simulation batch that the job requires has passed, and signs the attestation.

        Returns if canceled.

        Raises:
            DeploymentError: The batch has not passed, and cannot pass any more.
            StateConflictError: The lease was lost, or the job was ended.
        """
        from .attestations.required_batches import attest  # it needs the extra `fleet`

        service = self._service.patient(self._job.id, self._is_unwanted)
        told: set[str] = set()
        while (running := attest(self._job, _application(self._job, self._service), service)) is not None:
            if running.why not in told:
                self._service.report_note(f"{self._job.id} waits for simulations: {running.why}")
                told.add(running.why)
            self._sleep(LOOK_AT_BATCH_S)
            if self._is_canceled():
                return
            if self._lease.lost or self._has_ended():
                raise StateConflictError(f"{self._job.arn}: it is not this run's any more")
            self._lease.forget_lost_workers()

    def _begun(self) -> KeptRollout | None:
        """Starts the deployment to the robots, or finds it started; `None` if a repetition or rollback has no robots.

        Raises DeploymentError if each robot left the fleet before. Files and signatures are made before any robot is
        told.
        """
        from .attestations.required_batches import check_delivered  # it needs the extra `fleet`

        document = DeploymentJobDocument.of(self._job)
        members = robots_of(str(self._job.parent), self._service)
        robots = [robot for robot in reversed(members) if is_meant(robot, self._job)]
        if not members:
            raise DeploymentError("each robot left the fleet before the deployment began", "RobotDeploymentAborted")
        if not robots and (document.repeats or document.rolls_back):
            return None
        application = _application(self._job, self._service)
        patient = self._service.patient(self._job.id, self._is_unwanted)
        prepared = self._prepared(application, robots, patient)
        plan = plan_of(self._job, robots, prepared.has)
        gets = delivery(self._job, robots, prepared)
        check_delivered(self._job, gets, patient)
        return begin_rollout(self._job, plan, gets, self._service)

    def _prepared(self, application: Resource, robots: Sequence[Resource], patient: Service) -> Prepared:
        """Returns the robots' installation files; signed `.swu` files only for robots with a third-party updater."""
        from .artifacts import prepare  # they need the extra `fleet`
        from .attestations.required_batches import attestations_of
        from .trust.deployments import publish

        documents = [RobotDocument.of(robot) for robot in robots]
        has_condition = "downloadConditionFile" in DeploymentJobDocument.of(self._job).deployment_config
        agents = {document.architecture for document in documents if document.has_agent}
        others = {document.architecture for document in documents if not (document.has_agent or has_condition)}
        attested = attestations_of(self._job, patient)
        return Prepared(
            for_updaters=prepare(application, others, patient) if others else {},
            for_agents=publish(self._job, application, agents, patient, attested) if agents else {},
        )

    def _roll_out(self) -> None:
        if (
            Rollouts(self._service.catalog).rollout(self._job.arn) is None
        ):  # it had nothing to do, and its worker died then
            self._lease.transition("succeed")
            return
        self._settle()
        kept = KeptRollout(self._job, self._service)
        self._look(kept)
        plan = kept.rollout.plan
        waves = waves_of(plan)
        for number, robots in enumerate(waves, 1):
            if plan.requires_approval and not frozenset(robots) <= frozenset(plan.canaries):
                self._wait_for_approval(kept)
            if not _is_over(kept.rollout, robots):
                self._step(
                    f"wave-{number}-of-{len(waves)}", lambda wave=(number, robots): self._roll_out_wave(kept, *wave)
                )
        self._wait_for(kept, None)

    def _roll_out_wave(self, kept: KeptRollout, number: int, robots: Sequence[str]) -> None:
        self._wait_for(kept, robots)
        show_wave(self._job, kept.rollout, number, robots)

    def _wait_for(self, kept: KeptRollout, robots: Sequence[str] | None) -> None:
        """Continues the deployment until each of some robots is finished, or the whole deployment has ended."""
        while not _is_over(kept.rollout, robots):
            self._sleep(POLL_S)
            self._look(kept)

    def _wait_for_approval(self, kept: KeptRollout) -> None:
        """Waits until a person has approved the deployment or it has ended; Prefect shows that it needs approval."""
        if _is_decided(kept.rollout):
            return

        def wait() -> None:
            self._show(kept.rollout)
            while not _is_decided(kept.rollout):
                self._sleep(POLL_S)
                self._look(kept)

        with shown_as("AwaitingApproval", f"robomaker fleet approve {self._job.arn}"):
            self._step("approval", wait)

    def _look(self, kept: KeptRollout) -> None:
        """Polls once: applies robots' reports, time-outs, cancellation and people's decisions to the robots' state.

        Raises:
            StateConflictError: The lease was lost.
        """
        if self._lease.lost:
            raise StateConflictError(f"{self._job.arn}: another run goes on with it")
        now_s = self._now_s()
        events: list[Stopped] = []
        if self._is_canceled():
            events.append(Stopped(why="canceled"))
        elif now_s - self._application_at_s >= _LOOK_AT_APPLICATION_S:
            self._application_at_s = now_s
            if not self._has_application():
                events.append(Stopped(why="application_deleted"))
        if kept.fold(*events):
            self._show(kept.rollout)
        elif kept.is_outdated():  # a call has paused, resumed, approved or stopped the rollout, and stored that
            kept.refresh()
            self._show(kept.rollout)
        elif now_s - self._kept_alive_at_s < _KEEP_ALIVE_S:
            return
        else:
            kept.keep_alive()
        self._lease.forget_lost_workers()
        self._kept_alive_at_s = now_s

    def _show(self, rollout: Rollout) -> None:
        """Reports the counts of robots by state, and the reasons why the deployment waits, whenever these change."""
        self._service.report_progress(progress_of(rollout))
        waits = tuple(in_words(wait, self._job.arn) for wait in waits_for(rollout, self._now_s()))
        if waits != self._told and (waits or rollout.status == "InProgress"):
            self._tell("; ".join(waits) or "goes on")
        self._told = waits

    def _tell(self, text: str) -> None:
        _logger.warning("%s: %s", self._job.id, text)
        self._service.report_note(f"{self._job.id}: {text}")
        show_note(self._job.id.lower(), text)

    def _go_back(self) -> None:
        """Creates the rollback job if one is due; if the fleet is busy or gone, `robomaker serve` does it later."""
        document = DeploymentJobDocument.of(self._job)
        failed = document.rolls_back.job if document.rolls_back else self._job.arn
        with suppress(ResourceNotFoundException, ThrottlingException):
            roll_back(failed, self._service)

    def _fail(self, code: DeploymentJobErrorCode, reason: str) -> None:
        self._lease.transition("fail", FailureChanges(failure_code=code, failure_reason=shorten(reason)))

    def _settle(self) -> None:
        """Updates the status of the fleet's robots, also for a run that died before it could, if the fleet is free."""
        gone_or_busy = suppress(ResourceNotFoundException, ThrottlingException)
        with gone_or_busy, fleet_held(str(self._job.parent), self._service) as fleet:
            settle(fleet, self._service)

    def _has_application(self) -> bool:
        with suppress(ResourceNotFoundException):
            return bool(_application(self._job, self._service))
        return False

    def _is_unwanted(self) -> bool:
        return self._lease.lost or self._has_ended() or self._is_canceled()

    def _has_ended(self) -> bool:
        return is_terminal(DEPLOYMENT, self._service.catalog.standing(self._job.arn)[0])

    def _is_canceled(self) -> bool:
        return self._service.catalog.cancel_requested(self._job.arn)

    @property
    def _job(self) -> Resource:
        return self._lease.job

    def _now_s(self) -> float:
        return self._service.clock().timestamp()


def progress_of(rollout: Rollout) -> Progress:
    """Counts the robots of a deployment by state, as progress for Prefect."""
    return Progress(counts_of(rollout), len(rollout.robots))


def _is_decided(rollout: Rollout) -> bool:
    return rollout.status != "InProgress" or rollout.approved_s is not None


def _is_over(rollout: Rollout, robots: Sequence[str] | None) -> bool:
    if rollout.status != "InProgress":
        return True
    return robots is not None and all(rollout.robots[robot].has_ended for robot in robots)


def _application(job: Resource, service: Service) -> Resource:
    (config,) = DeploymentJobDocument.of(job).deployment_application_configs
    return find_application(config["application"], "robot", config["applicationVersion"], service)


def _failure(error: Exception, job: Resource) -> tuple[DeploymentJobErrorCode, str]:
    reason = str(error) or type(error).__name__
    if isinstance(error, DeploymentError):
        return cast("DeploymentJobErrorCode", error.failure_code), reason
    if isinstance(error, ResourceNotFoundException):
        return "RobotApplicationDoesNotExist", reason
    _logger.exception("deployment job %s broke", job.arn)
    return "InternalServerError", reason
