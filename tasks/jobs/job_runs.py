"""Runs one simulation job: prepares it, runs its processes, stores its outputs, records its end.

An interrupted job is resumed.
"""

import logging
import time
from collections.abc import Callable, Mapping
from enum import Enum, auto
from functools import cache, partial
from pathlib import Path
from secrets import token_urlsafe

from ...schemas.documents.reuse_inputs import REUSE_LABEL, ReuseInputs
from ...schemas.documents.simulation_jobs import (
    MadeOf,
    Outcome,
    SimulationJobDocument,
    SimulationJobProgress,
    StoredNetworkInterface,
)
from ...schemas.runs.plan import RunOutcome, RunPlan
from ...schemas.runs.programs import RunStop, Scarce, StopReason, noticed
from ...schemas.runs.trials import TrialCounts, TrialRecordings, trial_counts
from ...schemas.wire.common import shorten
from ...schemas.wire.errors import (
    LaunchError,
    LaunchInterruptedError,
    ServiceUnavailableException,
    StateConflictError,
    StorageError,
    StorageUnavailableError,
    TransferStoppedError,
)
from ..execution.credential_blocks import read_credential_block
from ..execution.leases.catalog_outages import CatalogWait
from ..execution.leases.giving_up import MAX_LOST_WORKERS
from ..execution.leases.job_leases import Lease
from ..execution.leases.leased_runs import run_if_unclaimed, run_under_lease
from ..execution.task_pool import RunStep, directly
from ..runtime.supervision.finished_outputs import remove_verdict
from ..runtime.supervision.launcher import Launcher
from ..service.service import Service
from ..simulations.containers.cleanup import remove_containers_of_job, settle_containers
from ..simulations.environment.role_access import fresh_keys
from ..simulations.outputs.run_outputs import RunOutputs, failure_code_of
from ..simulations.outputs.upload_cancellation import UploadEnd
from ..simulations.planning.job_contents import contents_of_plan
from ..simulations.planning.run_plans import plan_to_resume, reached_s, run_plan
from ..simulations.ros.job_services import answering
from ..simulations.ros.ros_domains import DOMAIN_VARIABLE, own_domain
from .job_folders import KIND, clean_up_job, remove_abandoned_containers
from .simulation_outcomes import (
    DIED,
    END_EVENTS,
    KILLED,
    EarlierRuns,
    failed,
    is_overtaken,
    not_stored_by_dead,
    outcome_of,
    overtaken,
    stopped,
    without_outputs,
)
from .simulation_places import Place

Stop = Callable[[], StopReason | None]
"""Function that is called while a job runs, and returns why it should stop, or `None`."""

OnTrials = Callable[[TrialCounts], None]
"""Function that is called now and then with the numbers of a job's trials."""

_BEFORE_IT_RAN = "the job was stopped before it ran"
_WORKER_DIED = "the job was stopped after its job worker had died"

_logger = logging.getLogger(__name__)


def perform_job(
    arn: str,
    service: Service,
    stop: Stop = lambda: None,
    run_step: RunStep = directly,
    on_trials: OnTrials | None = None,
    waited_s: Mapping[Scarce, float] | None = None,
    place: Place | None = None,
    waits: bool = True,
) -> None:
    """Runs a simulation job to completion from its current state.

    A job that a dead job worker left half-way continues from the last checkpoint, when the run's folder is on this
    machine and has one; else it is run again from the start, as a new run with a folder of its own, and what the dead
    run left here is stored as that of an earlier run, without a manifest. So is one that had come to a good end, whose
    outputs were lost with the machine that it ran on.

    Args:
        arn: The job.
        service: The service, with its catalog and object store.
        stop: Returns why the job should stop, or `None`; called several times a second.
        run_step: Runs its steps `prepare`, `simulate` and `upload`, directly or as Prefect tasks.
        on_trials: Called with the numbers of its trials; absent: trials are not reported.
        waited_s: Time that it has waited for this machine, in seconds, by scarce resource.
        place: Slot of the job among the simulating jobs; absent: it needs none.
        waits: Whether the end of a job that another process has taken over is waited for.
    """
    remove_abandoned_containers(service)

    run, waited_s = run_under_lease if waits else run_if_unclaimed, waited_s or {}
    run(arn, KIND, service, lambda lease: JobRun(lease, service, stop, run_step, on_trials, waited_s, place).run())


def stop_idle_job(arn: str, service: Service, reason: StopReason = StopReason.CANCELED) -> bool:
    """Ends a job that has to stop, if no job worker holds it; outputs left on this machine are uploaded.

    Args:
        arn: The job.
        service: The service, with its catalog and object store.
        reason: Why it has to stop.

    Returns:
        Whether the job has ended; false if another performs it, who sees to its end.
    """
    return run_if_unclaimed(arn, KIND, service, lambda lease: JobRun(lease, service).end(reason))


class _Next(Enum):
    """Next step of a job after one of its runs."""

    NONE = auto()
    RESTART = auto()
    """Next step of a job: start a new run, because a restart was requested."""

    GO_ON = auto()
    """Next step of a job: continue a killed run from its last checkpoint, else from the start."""


@cache
def launcher() -> Launcher:
    """Returns this process's launcher, the warm parent process of all its simulations."""
    return Launcher()


class JobRun:
    """Runs one simulation job, holding its lease (lock).

    Args:
        lease: The right to change the job.
        service: The service, with its catalog and object store.
        stop: Returns why the job should stop, or `None`.
        run_step: Runs its steps, directly or as Prefect tasks.
        on_trials: Called with the numbers of its trials; absent: trials are not reported.
        waited_s: Time that it has waited for this machine, in seconds, by scarce resource.
        place: Slot of the job among the simulating jobs; absent: it needs none.
    """

    def __init__(
        self,
        lease: Lease,
        service: Service,
        stop: Stop = lambda: None,
        run_step: RunStep = directly,
        on_trials: OnTrials | None = None,
        waited_s: Mapping[Scarce, float] | None = None,
        place: Place | None = None,
    ) -> None:
        self._place = place or Place()
        self._finishes = False
        self._on_trials = on_trials
        self._waited_s = noticed(waited_s or {})
        self._run_step = run_step
        self._lease = lease
        self._service = service.with_blocks(read_credential_block)
        self._stop = stop
        self._earlier = EarlierRuns(lease, self._outputs, self._stop_reason)
        self._begin: Callable[[], None] | None = None
        """Function that sets the job's status to running; `None` once it has been called."""
        self._answers = False
        """Whether the job's applications listen on forwarded ports, or have had their time to."""
        self._kills = 0  # of runs, from outside, since one came further than those before

    def run(self) -> None:
        """Runs the job to its end, with a new run after each restart, and records its final status in the catalog.

        An interrupted run of a dead job worker is continued where that is possible. A job that has to stop is ended
        without a further run. Errors fail the job and are not raised, unless its lease is lost or the catalog stays
        away.
        """
        next_run = _Next.GO_ON  # with what a dead job worker may have left
        while next_run is not _Next.NONE:
            left, self._finishes = None, False
            if next_run is _Next.GO_ON and not self._stop_reason():
                left = self._left_by_a_dead_worker()
                if left is None:
                    self._earlier.keep_dead(KILLED if self._kills else DIED)
            reason = self._stop_reason()  # perhaps by now
            if reason or (self._lease.job.status == "Terminating" and not self._earlier.note_lost()):
                self.end(reason or StopReason.CANCELED)
                return
            if not self._place.simulate():  # it was left for the videos of a run that was then restarted
                continue
            with own_domain(self._lease.job.arn) as ros_domain:
                next_run = self._run_once(left, ros_domain)

    def end(self, reason: StopReason) -> None:
        """Ends a job that is not running; outputs that a dead run left on this machine are uploaded first.

        Args:
            reason: Why it has to stop; one that is `Terminating` keeps the outcome that it has already.
        """
        run_id = self._document.run_id
        if self._lease.job.status == "Terminating":
            self._settle(self._published_after_all())
        elif run_id is None or not Path(self._folder(run_id), "output").is_dir():
            self._terminate(stopped(reason, _BEFORE_IT_RAN if run_id is None else _WORKER_DIED))
        else:
            outcome = stopped(reason, _WORKER_DIED)
            self._lease.transition("terminate", outcome.announced(finished=False))
            self._settle(self._published(run_id, outcome))
        if run_id is not None:
            self._clean_up(run_id)

    @property
    def _document(self) -> SimulationJobDocument:
        """Returns the job's current document."""
        return SimulationJobDocument.of(self._lease.job)

    def _left_by_a_dead_worker(self) -> RunPlan | None:
        """Returns the plan of an interrupted run on this machine that can be continued, if there is one."""
        run_id = self._document.run_id
        return plan_to_resume(self._lease.job, self._folder(run_id)) if run_id else None

    def _run_once(self, left: RunPlan | None, ros_domain: int) -> "_Next":
        """Carries out one run, or the rest of an interrupted one, and returns the job's next step.

        Errors of the run fail the job and are not raised, unless another process has taken the job over. Deletes the
        run's local files, except outputs that could not be stored, unless the run is to be continued.

        Args:
            left: Plan of the interrupted run; `None` begins a new run.
            ros_domain: The ROS domain number that the job's programs use.
        """
        run_id = left.run_id if left else self._service.clock().strftime("%Y-%m-%dT%H-%M-%S-%fZ")
        next_run = _Next.NONE
        self._begin, self._answers = None, False
        try:
            if left is None:
                plan = self._run_step("prepare", lambda: self._prepared(run_id, ros_domain))
            else:
                self._note_attempt(run_id)
                variables = {**left.environment, DOMAIN_VARIABLE: str(ros_domain)}  # another job may have the former
                plan = left.model_copy(update={"environment": variables})
            next_run = self._carry_out(plan)
        except LaunchError as error:
            if isinstance(error, LaunchInterruptedError) and self._may_try_again(run_id):
                next_run = self._after_kill(str(error))
                return next_run
            reason = self._stop_reason()  # a stop may be what made preparing fail
            outcome = stopped(reason, _BEFORE_IT_RAN) if reason else failed(error.failure_code, str(error))
            self._terminate(outcome, of_run=run_id)
        except ServiceUnavailableException as error:
            CatalogWait.of(self._lease, self._service).outlast(error)
            next_run = _Next.GO_ON
        except Exception as error:  # the job has to end whatever breaks
            if self._lease.lost:
                raise  # it is another's to end
            _logger.exception("simulation job %s broke", self._lease.job.arn)
            self._terminate(failed("InternalServiceError", f"{type(error).__name__}: {error}"))
        finally:
            if next_run is not _Next.GO_ON:
                self._clean_up(run_id)
        return next_run

    def _note_attempt(self, run_id: str) -> None:
        """Records in the job a further attempt of its run.

        Resets the count of dead job workers if the last attempt made progress.
        """
        before, reached = self._document, reached_s(self._folder(run_id))
        self._lease.update(SimulationJobProgress(attempts=before.attempts + 1, reached_s=reached, simulated_at=None))
        if reached > before.reached_s:
            self._lease.forget_lost_workers()

    def _may_try_again(self, run_id: str) -> bool:
        """Counts a run's death from outside, and returns whether to repeat the run.

        It is repeated only while each attempt reaches a later simulated time.
        """
        self._kills = 1 if reached_s(self._folder(run_id)) > self._document.reached_s else self._kills + 1
        return self._kills < MAX_LOST_WORKERS and self._stop_reason() is None

    def _after_kill(self, why: str) -> "_Next":
        """Logs that a run was killed, waits for a moment, and returns the job's next step: to go on with the run."""
        _logger.warning("%s is tried again: %s", self._lease.job.arn, why.partition("\n")[0])
        time.sleep(self._service.timing.after_kill_s)
        return _Next.GO_ON

    def _prepared(self, run_id: str, ros_domain: int) -> RunPlan:
        """Makes the plan of a new run, after downloading all that the run needs into its folder.

        Sets the job's status to the preparing one, and to running if no forwarded port is awaited. Raises `LaunchError`
        if the job cannot be launched or the object store is away.
        """
        folder = self._service.folder("jobs", self._lease.job.id, run_id)
        begun = SimulationJobProgress.begun(run_id, self._waited_s, token_urlsafe())
        self._lease.transition("prepare", begun)
        service = self._service.patient(self._lease.job.id, self._is_stopped)
        try:
            RunOutputs(self._lease.job, run_id, folder, service).prepare()
            remove_containers_of_job(folder.parent)  # of job workers that died together with all that they had started
            plan = run_plan(self._lease.job, run_id, folder, service, ros_domain, self._is_stopped)
        except StorageUnavailableError as error:
            raise LaunchError(str(error), "InternalServiceError") from error
        self._begin = partial(self._note_begin, contents_of_plan(plan, self._document.request))
        if not plan.ports:
            self._note_running()
        return plan

    def _note_running(self) -> None:
        """Sets the job's status to `Running`, unless it is already."""
        if self._begin is not None:
            self._begin()
            self._begin = None

    def _note_begin(self, made_of: MadeOf) -> None:
        self._lease.transition(
            "start",
            SimulationJobProgress(
                last_started_at=self._now(),
                network_interface=StoredNetworkInterface(
                    network_interface_id=f"eni-{self._lease.job.id.removeprefix('sim-')}",
                    # Clients index either address without looking; all ports are those of this machine.
                    private_ip_address="127.0.0.1",
                    public_ip_address="127.0.0.1",
                ),
                made_of=made_of,
            ),
            labels={REUSE_LABEL: [ReuseInputs.of(self._document, made_of).key]},
        )

    def _carry_out(self, plan: RunPlan) -> "_Next":
        """Runs the programs of a run plan, records the outcome, uploads the outputs, and returns the job's next step.

        The next step is another attempt after a run that was killed, a new run after a requested restart, and else
        none. Raises `StateConflictError` if the job's end cannot be recorded for another reason than a restart.
        """
        run_id = plan.run_id
        service, folder = self._service, self._folder(run_id)
        with fresh_keys(self._document.request, service, folder), self._outputs(run_id).rolling():
            ended = self._run_step("simulate", lambda: self._simulated(plan))
        if ended.was_killed:
            self._note_running()
            return self._after_kill(ended.failure_reason or "it was killed")
        why_stop = self._stop_reason()
        outcome = outcome_of(ended, why_stop)
        if outcome.status == "Canceled" and ended.status == "Completed":
            remove_verdict(plan.output_dir)
        if self._kills >= MAX_LOST_WORKERS and outcome.failure_reason:
            tried = f"each of {self._kills} attempts was killed"
            outcome = outcome.model_copy(update={"failure_reason": shorten(f"{tried}. {outcome.failure_reason}")})
        try:
            announced = outcome.announced(finished=ended.finished)
            if why_stop is None:
                self._note_running()  # its ports have not answered yet
            simulated = self._document.simulated_at or self._now()
            progress = announced.model_copy(update={"simulated_at": simulated})
            self._lease.transition("terminate" if why_stop else "finish", progress)
        except StateConflictError:
            if self._lease.lost or self._lease.refreshed().status != "Restarting":
                raise
            self._earlier.keep_restarted(run_id, ended)
            return _Next.RESTART
        began_s = time.monotonic()
        published = self._run_step("upload", lambda: self._published(run_id, outcome))
        self._settle(published.model_copy(update={"upload_s": round(time.monotonic() - began_s, 3)}))
        return _Next.NONE

    def _simulated(self, plan: RunPlan) -> RunOutcome:
        """Starts the programs of a run plan, waits until they have ended or are stopped, and returns the run's end."""
        with answering(plan.root_dir, plan.job_arn, self._service):
            return launcher().run(
                plan,
                self._interruption,
                on_crash=self._note_crash,
                on_trials=lambda finished, recordings: self._note_trials(finished, recordings, plan),
                on_answering=self._note_answers,
                on_stopped=lambda: settle_containers(self._folder(plan.run_id), plan.output_dir),
                on_simulated=self._note_simulated,
                try_again=lambda: self._may_try_again(plan.run_id),
            )

    def _note_simulated(self, is_drawn: bool) -> None:
        """Frees the job's machine slot, because the simulation has ended and only videos and outputs remain.

        From here on the batch's timeout no longer ends the job; its own timeout and cancellation still do. Does nothing
        if the job has to end or restart; an error is logged, and the job keeps its slot.
        """
        status, reason = self._asked()
        self._finishes = reason is None and not self._is_to_restart(status)
        if not self._finishes:
            return
        try:
            if is_drawn:  # else the end of the run, which follows at once, says so
                self._lease.update(SimulationJobProgress(simulated_at=self._now()))
            self._place.finish()
        except Exception:  # a run that was judged is not lost for that
            _logger.exception("%s keeps its slots until it has ended", self._lease.job.arn)

    def _note_crash(self, code: str, reason: str) -> None:
        """Records in a job that an application crashed, after which the job goes on; a failure to do so is logged."""
        try:
            self._note_running()
            self._lease.transition("crash", SimulationJobProgress(failure_code=code, failure_reason=shorten(reason)))
        except StateConflictError:  # it is to be restarted, or another job worker has it
            _logger.debug("%s crashed while it was ended: %s", self._lease.job.arn, reason)
        except ServiceUnavailableException as error:
            _logger.warning("that %s crashed cannot be noted: %s", self._lease.job.arn, error)

    def _note_trials(self, finished: int, recordings: TrialRecordings | None, plan: RunPlan) -> None:
        """Stores and reports the numbers of the job's finished and recorded trials; nothing for a job without trials.

        A catalog that refuses the change or is away is ignored, as a later number may be stored.
        """
        if plan.trials is None:
            return
        if self._on_trials is not None:
            job = self._lease.job.id
            self._on_trials(trial_counts(finished, plan.trials.count, {job: recordings} if recordings else {}))
        try:
            self._lease.update(SimulationJobProgress(trials_finished=finished, trials_recorded=recordings))
        except (StateConflictError, ServiceUnavailableException) as error:  # the next one may be noted
            _logger.debug("that %s trials of %s have finished cannot be noted: %s", finished, plan.job_id, error)

    def _now(self) -> str:
        return self._service.clock().isoformat()

    # Stopping

    def _is_stopped(self) -> bool:
        """Whether the running simulation job has to end."""
        return self._stop_reason() is not None

    def _stop_reason(self) -> StopReason | None:
        """Returns the reason why the running simulation job has to end, or `None`."""
        return self._asked()[1]

    def _note_answers(self) -> None:
        self._answers = True

    def _interruption(self) -> RunStop | None:
        """Returns why the run has to end, or `None`; also sets the job to running once its forwarded ports answer."""
        try:
            if self._answers:
                self._note_running()
        except (StateConflictError, ServiceUnavailableException) as error:  # it is said at the next look
            _logger.debug("that %s runs cannot be noted: %s", self._lease.job.arn, error)
        return RunStop.CANCELED if self._is_interrupted() else None

    def _is_interrupted(self) -> bool:
        """Whether the current simulation run has to end, because the job ends or restarts."""
        status, reason = self._asked()
        return reason is not None or self._is_to_restart(status)

    def _is_to_restart(self, status: str) -> bool:
        """Whether a restart of this run is requested; a restarted job keeps the status until its new run is begun."""
        return status == "Restarting" and self._begin is None

    def _asked(self) -> tuple[str, StopReason | None]:
        """Returns the job's status, and the reason why its run has to end: `None` if it does not have to.

        The status is `Restarting` if a restart of the job is requested. If the job's lease is lost, the reason is a
        cancellation. If the catalog does not answer, that is logged, and there is no reason.
        """
        if self._lease.lost:
            return self._lease.job.status, StopReason.CANCELED  # the worker that took over runs the job again
        try:
            status, canceled = self._service.catalog.standing(self._lease.job.arn)
            reason = StopReason.CANCELED if canceled else self._stop()
            return status, None if self._finishes and reason is StopReason.BATCH_TIMED_OUT else reason
        except ServiceUnavailableException as error:  # nothing to end a run for; it is asked again at once
            _logger.warning("whether %s is to be stopped is not known: %s", self._lease.job.arn, error)
            return self._lease.job.status, None

    def _terminate(self, outcome: Outcome, of_run: str | None = None) -> None:
        """Ends the job; files of a run that could not be started are uploaded without a manifest.

        Such files are its log, and the files of earlier attempts if the run was to continue from a checkpoint.
        """
        output = self._folder(of_run) / "output" if of_run else None
        has_left = output is not None and output.is_dir() and any(output.iterdir())
        if self._lease.job.status != "Terminating":
            self._lease.transition("terminate", outcome.announced(finished=False if has_left else None))
        self._settle(self._published(of_run, outcome) if of_run and has_left else outcome)

    def _settle(self, outcome: Outcome) -> None:
        try:
            self._lease.transition(END_EVENTS[outcome.status], outcome.changes())
        except StateConflictError:
            if self._lease.lost or not self._is_overtaken(outcome):
                raise
            # Cancelled after its manifest was written: the run's outputs are whole, and stay as they are.
            self._lease.transition("cancel", overtaken(outcome).changes())

    # Outputs

    def _folder(self, run_id: str) -> Path:
        return self._service.settings.home / "jobs" / self._lease.job.id / run_id

    def _outputs(self, run_id: str) -> RunOutputs:
        return RunOutputs(self._lease.job, run_id, self._folder(run_id), self._service)

    def _published(self, run_id: str, outcome: Outcome, *, resumes: bool = False) -> Outcome:
        """Uploads a run's outputs; returns the outcome, which is a failure if the upload fails.

        Args:
            run_id: The run.
            outcome: Outcome of the run.
            resumes: Whether a job worker that died may have stored a part of them.
        """
        outputs = self._outputs(run_id)
        settle_containers(self._folder(run_id), outputs.output_dir)
        outcome = self._overtaken(outcome, outputs) if self._is_overtaken(outcome) else outcome
        finished = bool(self._document.finished)
        try:
            place = outputs.store(
                outcome.about_run(),
                finished=finished,
                stopped=self._is_stopped,
                resumes=resumes,
                outdated=lambda: self._is_overtaken(outcome),
                ended=UploadEnd(self._lease.job.arn, self._lease.job.parent, self._service.catalog, self._stop_reason),
            )
        except TransferStoppedError:
            return self._concluded(outcome, outputs, finished=finished)
        except (StorageError, OSError) as error:
            if self._is_overtaken(outcome):
                return self._published(run_id, outcome, resumes=True)
            return without_outputs(outcome, failure_code_of(error), outputs.not_stored(error))
        return outcome.model_copy(update={"outputs": place})

    def _concluded(self, outcome: Outcome, outputs: RunOutputs, *, finished: bool) -> Outcome:
        """Publishes the stored outputs of a run by writing their manifest, and returns the job's final outcome.

        If the job was cancelled while its outputs were being stored, the outcome says so. If the outputs cannot be
        published, the outcome has the failure's code and no outputs.
        """
        # A catalog that is away now cannot say why; only cancelling ends an upload.
        if is_overtaken(outcome.status, self._stop_reason() or StopReason.CANCELED, is_whole=False):
            outcome = self._overtaken(outcome, outputs)
        self._lease.update(SimulationJobProgress(outcome=outcome))  # raises if the lease is another's by now
        try:
            place, part = outputs.conclude(outcome.about_run(), finished=finished)
        except (StorageError, OSError) as error:
            return without_outputs(outcome, failure_code_of(error), outputs.not_stored(error))
        reason = "\n".join(filter(None, (part, outcome.failure_reason)))
        return outcome.model_copy(update={"outputs": place, "failure_reason": shorten(reason) or None})

    def _is_overtaken(self, outcome: Outcome) -> bool:
        """Whether the job was cancelled while the outputs of its completed run were stored."""
        return is_overtaken(outcome.status, self._stop_reason())

    def _overtaken(self, outcome: Outcome, outputs: RunOutputs) -> Outcome:
        """Returns the outcome of a job that was cancelled while its outputs were stored.

        Its result then has no verdict.
        """
        outcome = overtaken(outcome, self._stop_reason())
        self._lease.update(SimulationJobProgress(outcome=outcome, verdict=None, verdict_reason=None))
        remove_verdict(outputs.output_dir)
        return outcome

    def _published_after_all(self) -> Outcome:
        """Returns the outcome of a job whose worker died while it stored the outputs; stores those that are still here.

        If the run's folder is not on this machine, the outputs must be in the object store; else the outcome says that
        they are lost. A job without a recorded outcome counts as failed.
        """
        document = self._document
        outcome, run_id = document.outcome, document.run_id
        if outcome is None:
            return failed("InternalServiceError", "the catalog does not say how the job finished")
        if run_id is None or document.finished is None:
            return outcome  # it ended before it ran
        if self._folder(run_id).is_dir():
            return self._published(run_id, outcome, resumes=True)
        outputs = self._outputs(run_id)
        try:
            if document.finished:
                outputs.were_stored(self._is_stopped)
        except StorageError as error:
            return without_outputs(outcome, "InternalServiceError", not_stored_by_dead(outputs, error))
        return outcome.model_copy(update={"outputs": outputs.place})

    def _clean_up(self, run_id: str) -> None:
        """Deletes the run's local files, except outputs not stored; does nothing if another job worker has the job."""
        if self._lease.lost:
            return  # the worker that took over may continue the same run
        clean_up_job(self._folder(run_id).parent, self._document, run_id)
