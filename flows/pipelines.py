"""Pipelines: run the steps of a specification one after the other, and write a report at the end.

`RunPipeline` is the flow that `prefect deployment run` and schedules start; `run_spec` does the same for a caller in
this process who watches its progress.
"""

import os
import signal
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from contextvars import ContextVar
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, cast

import httpx
from prefect import State
from prefect.logging import get_run_logger
from prefect.runtime import deployment, flow_run
from prefect.states import Cancelled

from ..schemas.reports.progress import Note, ProgressEvent, ProgressListener, StepEnded, StepProgress, StepStarted
from ..schemas.reports.run_record import CaseOutcome, Interruption, RunRecord, StepRecord, new_run_id
from ..schemas.reports.run_states import BAD_ENDS, FlowResult, count_outcomes, is_bad, result_of
from ..schemas.settings import Settings
from ..schemas.specs.batch_splitting import EarlierParts, Part, parts_of, step_of, with_client_token
from ..schemas.specs.check import load_spec
from ..schemas.specs.checking.impossible_goals import check_world_counts
from ..schemas.specs.parameter_values import param_options, set_options
from ..schemas.specs.resolving import resolve_input
from ..schemas.specs.specification import CheckedSpec
from ..schemas.wire.errors import (
    ConfigurationError,
    ResourceNotFoundException,
    RobomakerError,
    ServiceUnavailableException,
)
from ..tasks.execution.flow_ends import end_state, ends_as_cancelled
from ..tasks.execution.late_nights import skipped_night
from ..tasks.execution.leases.catalog_outages import CatalogWait, Result
from ..tasks.execution.orphans import wait_if_ending
from ..tasks.execution.run_watch import beginning_run, watched_run
from ..tasks.execution.schedule_overlaps import give_way_to_earlier
from ..tasks.inspection.challenges import SabotageNotes
from ..tasks.inspection.job_standings import simulation_standings, why_not_completed
from ..tasks.inspection.pipeline_parts import (
    RunInterrupted,
    error_in_words,
    permit_all,
    read_spec_file,
)
from ..tasks.inspection.preflight import await_store, check_disk, check_preconditions, with_all_found
from ..tasks.inspection.run_records import commit_of
from ..tasks.inspection.runs_beside import DRIVES
from ..tasks.jobs.job_owners import OwnOrder
from ..tasks.nights.cut_runs import remove_left
from ..tasks.nights.early_ends import EarlyEnd
from ..tasks.nights.ending import RunFacts, finish_run
from ..tasks.nights.kept_answers import KeptAnswers
from ..tasks.nights.open_runs import OpenRun
from ..tasks.nights.refused_runs import finish_refused, known_spec
from ..tasks.nights.run_orders import keep_order, ordered_run, taken_run, tell_of_left
from ..tasks.nights.taking_up import TakingUp
from ..tasks.nights.wanted_runs import WantedRun
from ..tasks.notifications.notices import LongWaits
from ..tasks.operations.step_operations import existing_resource, step_registry
from ..tasks.service.catalog_wait import once_catalog_answers
from ..tasks.service.service import Progress, Service
from ..tasks.service.world_names import with_worlds_found
from .lookup import perform, without_heartbeat
from .operation_flow import LightFlow

_NO_FILE = "specification"


def run_spec(wanted: WantedRun, settings: Settings, listener: ProgressListener) -> RunRecord:
    """Runs a checked specification as a Prefect flow in this process, and returns the run's record.

    Args:
        wanted: Specification, and everything that is asked of the run besides.
        settings: Settings of the service.
        listener: Called with every progress event.

    Returns:
        Record of the run, whose `exit_code` says how it ended; its report is written.

    Raises:
        RunInterrupted: Ctrl-C was pressed.
    """
    checked = wanted.checked
    service, listener = Service.open(settings), LongWaits(checked.name, settings, listener)
    await_store(service, lambda text: listener(Note(text)))
    remove_left(service)
    run = PipelineRun(wanted, service, listener)
    check_preconditions(checked, run.service)
    if not (wanted.reuse or wanted.rerun_of or wanted.is_probe or run.interruptions):
        check_disk(checked, run.service)
    token = _current.set(run)
    try:
        with without_heartbeat():
            continues = run.run_id if run.interruptions else None
            state = cast("State[Any]", RunPipeline(spec=wanted.spec_path, continues=continues, return_state=True))
        if isinstance(state.data, KeyboardInterrupt):
            raise state.data
    except KeyboardInterrupt as interruption:
        if run.has_ended:
            raise RunInterrupted(run.record(), getattr(interruption, "signal_number", signal.SIGINT)) from None
        raise
    except httpx.TransportError as error:
        if not run.has_ended:
            raise
        listener(Note(f"the Prefect server does not answer any more, and will not show how the run ended: {error}"))
    finally:
        _current.reset(token)
        service.catalog.close()
    return run.record()


def run_name() -> str:
    """Returns the name of a pipeline's flow run: the name of its specification's file."""
    given = flow_run.parameters
    if continued := given.get("continues"):
        return f"{continued}, continued"
    return str(given.get("spec") or given.get("origin") or _NO_FILE)


@partial(LightFlow, name="RunPipeline", flow_run_name=run_name)
def RunPipeline(
    spec: str | None = None,
    text: str | None = None,
    origin: str = _NO_FILE,
    reuse: bool = False,
    continues: str | None = None,
    parameters: dict[str, Any] | None = None,
) -> Any:
    """Runs a specification (pipeline of world and simulation steps): a file, or the text that a deployment stores.

    Args:
        spec: Path of a YAML file on the machine of the flow; it takes precedence over `text`.
        text: Text of the specification, as `robomaker deploy` stores it.
        origin: Name of the text's file.
        reuse: Whether existing worlds and results of the same inputs are reused.
        continues: Id of a run whose process died; it is completed, and nothing else is run.
        parameters: Values of the specification's parameters by name; the others have their defaults.
    """
    pipeline, taking_up = _current.get(), None
    if pipeline is None:
        settings = Settings.from_environment(os.environ)
        if (skipped := skipped_night(settings)) is not None:
            return skipped
        give_way_to_earlier(continues)
        taken = None if continues is None else taken_run(settings, continues)
        if isinstance(taken, str):
            return Cancelled(name="Skipped", message=taken)
        with beginning_run():
            if taken is not None:
                pipeline = PipelineRun.of_order(taken)
            else:
                taking_up = TakingUp(settings, tell=tell_of_left)
                taking_up.start()
                try:
                    pipeline = PipelineRun.of_parameters(spec, text, origin, reuse=reuse, parameters=parameters)
                except Exception as error:
                    wait_if_ending()
                    wanted = _refused(spec, text, origin, reuse=reuse, parameters=parameters)
                    ids = {"flow_run": flow_run.id, "deployment": deployment.id}
                    finish_refused(wanted, error, settings, _log, **ids)
                    raise
    service = pipeline.service
    with ends_as_cancelled(), watched_run(service.catalog, pipeline.cancel):
        pipeline.run()
        if taking_up is not None:
            taking_up.wait_in_container()
    return end_state(pipeline.result(), None, verdict_fails_run=service.settings.verdict_fails_run)


class PipelineRun:
    """One run of a specification: runs its steps and writes its report.

    Args:
        wanted: Specification, and everything that is asked of the run besides.
        service: Service that runs the operations.
        listener: Called with every progress event.
    """

    def __init__(self, wanted: WantedRun, service: Service, listener: ProgressListener) -> None:
        self._checked = checked = with_worlds_found(wanted.checked, service)
        self._wanted = wanted = replace(wanted, checked=checked)
        self._listener = listener
        self._open = open_run = wanted.open_run
        order = open_run.order if open_run is not None else None
        started_at = (order.started_at if order else None) or service.clock()
        self.run_id = order.run_id if order else new_run_id(checked.name, started_at)
        self._service = service.ordered_by(self.run_id, reuse=wanted.reuse)
        self._facts = RunFacts(
            wanted=wanted,
            run_id=self.run_id,
            started_at=started_at,
            # When it begins: later the folder may have moved on to another commit.
            source=order.source if order and order.interruptions else commit_of(Path(wanted.spec_path)),
            folder=service.settings.home / "runs" / self.run_id,
        )
        against = wanted.against
        self._early = EarlyEnd(against, checked, service, listener, open_run) if against is not None else None
        self._sabotages = (
            SabotageNotes(service.catalog, lambda text: listener(Note(text))) if wanted.challenge is not None else None
        )
        self._answers = KeptAnswers(self._facts.folder, wanted.permit or permit_all)
        self._steps: list[StepRecord] = []
        self._outputs: dict[str, dict[str, Any]] = {}
        self._record: RunRecord | None = None
        self._is_canceled = open_run is not None and open_run.is_cancelled

    @classmethod
    def of_order(cls, run: OpenRun) -> "PipelineRun":
        """Creates the run that continues an interrupted run, whose process died."""
        return cls(ordered_run(run), once_catalog_answers(Service.current), _log)

    @classmethod
    def of_parameters(
        cls,
        spec: str | None,
        text: str | None,
        origin: str,
        *,
        reuse: bool = False,
        parameters: Mapping[str, Any] | None = None,
    ) -> "PipelineRun":
        """Creates the run from the Prefect flow's parameters.

        Raises:
            ConfigurationError: The file does not exist, or neither file nor text is given.
            SpecError: The specification has problems.
        """
        if spec is not None:
            text, origin = read_spec_file(Path(spec)), spec
        if text is None:
            raise ConfigurationError("there is nothing to run: give `spec`, the path of a file, or `text`")
        checked = load_spec(text, origin, parameters)
        patience_s = 60.0 * Settings.from_environment(os.environ).store_patience_min
        service = once_catalog_answers(Service.current, patience_s=patience_s)
        checked = with_all_found(checked, service)
        remove_left(service)
        check_world_counts(checked, service.settings.max_worlds_per_job)
        check_preconditions(checked, service.patient(checked.name, lambda: False))
        if not reuse:
            check_disk(checked, service)
        return cls(_wanted(checked, origin, reuse=reuse), service, _log)

    def run(self) -> RunRecord:
        """Runs all steps of a specification and returns the run's record; steps after a failed one are skipped.

        The report and the record are written in any case, also if the run is interrupted, whose exception is raised
        again.
        """
        failed = False
        self._facts.folder.mkdir(parents=True, exist_ok=True)  # not before: a run that is refused leaves none
        self._keep_order()
        try:
            for name in self._checked.order:
                # Of a run that is cancelled what another process had begun is ended, and told.
                if failed or (self._ends and not self._answers.has(name)):
                    self._steps.append(self._skipped(name))
                else:
                    failed = not self._run_step(name)
        except BaseException:
            wait_if_ending()
            self._listener(Note("interrupted: the report is written from what has ended, which may take a minute"))
            self._is_canceled = True  # so that nothing waits for the catalog any more
            self._note_cancelled()
            raise
        finally:
            self._record = self._finish()
            if self._open is not None:
                self._open.end()
        return self._record

    @property
    def _ends(self) -> bool:
        """Returns whether no further step starts: the run is cancelled, or its comparison is decided."""
        return self._is_canceled or (self._early is not None and self._early.is_decided)

    @property
    def interruptions(self) -> Sequence[Interruption]:
        """Times at which processes of the run died and others resumed it."""
        return self._open.order.interruptions if self._open is not None else ()

    def _keep_order(self) -> None:
        """Stores what another process needs to complete the run if this one dies; nothing for a probe.

        A run that was cancelled meanwhile is marked so.
        """
        if self._wanted.is_probe:
            return
        self._open = keep_order(
            self._facts,
            self._service,
            self._open,
            flow_run=flow_run.id,
            deployment=deployment.id,
            outlasting=self._outlasting,
            listener=self._listener,
        )
        self._is_canceled = self._is_canceled or (self._open is not None and self._open.is_cancelled)

    def _note_cancelled(self) -> None:
        """Stores that the run was cancelled, so that a process that continues it after a crash ends it instead."""
        if self._open is not None:
            self._open.cancel()

    @property
    def service(self) -> Service:
        """Service (catalog and object store) in which the run's operations run."""
        return self._service

    @property
    def has_ended(self) -> bool:
        """Whether the run of the specification has ended and has a record."""
        return self._record is not None

    def record(self) -> RunRecord:
        """Returns the record of the ended run.

        Raises:
            RobomakerError: The flow ended before the run did.
        """
        if self._record is None:
            raise RobomakerError("the flow ended before the pipeline did; see the Prefect server's log")
        return self._record

    def cancel(self) -> None:
        """Cancels the run: the current step's job is cancelled, and no other step starts.

        Raises:
            ServiceUnavailableException: The catalog does not answer, so that the caller has to try again.
        """
        self._is_canceled = True
        self._note_cancelled()
        for output in list(self._outputs.values()):
            if arn := output.get("arn"):
                with suppress(ResourceNotFoundException):  # it was removed meanwhile
                    self._service.catalog.request_cancel(arn)

    def result(self) -> FlowResult:
        """Returns the result that the Prefect flow of the run returns."""
        return result_of(self.record())

    def _run_step(self, name: str) -> bool:
        """Runs a step, and tells the listener of its start and end; returns whether the next one may start.

        An error of the step is recorded, not raised.
        """
        step, began = self._checked.steps[name], self._service.clock()
        self._listener(StepStarted(name, step.operation))
        try:
            request = resolve_input(step, self._outputs)
            cut = self._wanted.cut
            parts = parts_of(step.operation, cut(step.operation, request) if cut else request)
        except Exception as error:
            last = self._note_end(name, Part({}), began, "Failed", {}, error_in_words(error))
        else:
            last = self._run_parts(name, parts)
        duration_s = (self._service.clock() - began).total_seconds()
        outcomes, known = self._outcomes(name), bool(self._checked.known)
        self._listener(StepEnded(name, last.status, duration_s, last.error or last.arn or "", outcomes, known))
        return last.status not in BAD_ENDS

    def _outcomes(self, name: str) -> Mapping[CaseOutcome, int]:
        """Counts a step's simulation jobs by outcome, for the progress display; empty if the catalog cannot say it."""
        if self._checked.steps[name].operation not in DRIVES or self._wanted.challenge is not None:
            return {}
        arns = [step.arn for step in self._steps if step.arn and name in (step.name, step_of(step.name))]
        with suppress(RobomakerError):
            return count_outcomes(job for arn in arns for job in simulation_standings(arn, self._service))
        return {}

    def _run_parts(self, name: str, parts: Sequence[Part]) -> StepRecord:
        """Runs the parts of a step until one fails, and skips the rest; returns the record of the last that ran."""
        earlier, progress = EarlierParts(), Progress({}, 0)

        def watch(told: Progress) -> None:
            nonlocal progress
            progress = told
            counts, trials = earlier.with_counts(told.counts), earlier.with_trials(told.trials, parts[0].trials)
            total = parts[0].total or told.total
            self._listener(StepProgress(name, counts, total, waits_for=told.waits_for, trials=trials))
            if self._sabotages is not None:
                self._sabotages.look(self._outputs[name]["arn"])

        ended = [self._run_part(name, parts[0], watch)]
        for part in parts[1:]:
            earlier = earlier.followed_by(ended[-1].output, progress.counts, progress.trials)
            if ended[-1].status in BAD_ENDS or self._ends:
                skipped = StepRecord(name=part.name(name), operation=ended[-1].operation, status="Skipped")
                self._steps.append(skipped)
            else:
                ended.append(self._run_part(name, part, watch))
        if len(ended) > 1:
            self._outputs[name] = earlier.followed_by(ended[-1].output, {}).output
        return ended[-1]

    def _run_part(self, name: str, part: Part, watch: Callable[[Progress], None]) -> StepRecord:
        """Runs one part of a step (most steps have one), and returns its record, also if it failed.

        An interruption is recorded, too, and raised again.
        """
        started_at = self._service.clock()
        self._outputs.pop(name, None)  # of the part before
        try:
            output = self._call(name, part, watch)
        except Exception as error:  # the report and the later steps' records are written all the same
            left = self._outputs.get(name, {})
            return self._note_end(name, part, started_at, "Failed", left, error_in_words(error))
        except BaseException:
            ended = self._note_end(name, part, started_at, "Canceled", self._cancelled(name), "interrupted")
            duration_s = (self._service.clock() - started_at).total_seconds()
            self._listener(StepEnded(name, ended.status, duration_s, "interrupted"))
            raise
        status = output.get("status", "Completed")
        error = why_not_completed(output) if is_bad(status) else None
        return self._note_end(name, part, started_at, status, output, error)

    def _note_end(
        self, name: str, part: Part, started_at: datetime, status: str, output: dict[str, Any], error: str | None
    ) -> StepRecord:
        """Records the end of a step, or of a part of it, and keeps its output for later steps; returns the record."""
        self._outputs[name] = output
        record = StepRecord(
            name=part.name(name),
            operation=self._checked.steps[name].operation,
            status=status,
            started_at=started_at,
            ended_at=self._service.clock(),
            arn=output.get("arn"),
            output=output,
            error=error,
        )
        self._steps.append(record)
        return record

    def _cancelled(self, name: str) -> dict[str, Any]:
        """Returns the state of an interrupted step's job, or what the step has returned so far."""
        entry, output = step_registry()[self._checked.steps[name].operation], self._outputs.get(name, {})
        with suppress(ServiceUnavailableException):  # what made it is known all the same
            return entry.described(output["arn"], self._service) if entry.run_job and output else output
        return output

    def _call(self, name: str, part: Part, watch: Callable[[Progress], None]) -> dict[str, Any]:
        """Calls a step's operation for a part of its request; if it creates a job, runs the job to completion.

        Returns the answer of the operation, or the final description of the job.
        """
        step = self._checked.steps[name]
        entry = step_registry()[step.operation]
        service = self._service.ordered_by(
            self.run_id, reuse=self._service.reuses, in_campaign=part.of > 1, mixed=self._early is not None
        )
        request = with_client_token(step.operation, part.request, f"{self.run_id}/{part.name(name)}")
        if entry.run_job is None:
            answer = lambda: existing_resource(step, request, service) or entry.answer(request, service)  # noqa: E731
            return self._answers(step, part.request, lambda: self._outlasting(answer))
        with OwnOrder(service) as own:
            output = self._answers(
                step, part.request, lambda: self._outlasting(lambda: entry.ordered(request, own.through, service))
            )
            own.keep(output["arn"])
            self._outputs[name] = output
            if self._is_canceled:  # while the job was made
                self.cancel()
            begun = StepRecord(name=part.name(name), operation=step.operation, status="Pending", arn=output["arn"])
            watched = self._early.watching(self._steps, begun, self._open) if self._early else nullcontext()
            with watched, self._service.watched_by(watch, lambda text: self._listener(Note(text))).activated():
                answer, _ = perform(step.operation, output["arn"])
                return answer

    def _outlasting(self, call: Callable[[], Result]) -> Result:
        """Returns the result of a call that is repeated until the catalog answers, or the run has to end."""
        pause_s = self._service.timing.after_outage_s
        wait = CatalogWait(self.run_id, self._service.catalog.count, lambda: self._is_canceled, pause_s)
        return wait.outlasting(call)

    def _skipped(self, name: str) -> StepRecord:
        operation = self._checked.steps[name].operation
        decided = "it was decided before" if self._ends else "an earlier step failed"
        why = "the run was cancelled" if self._is_canceled else decided
        self._listener(StepEnded(name, "Skipped", 0.0, why))
        return StepRecord(name=name, operation=operation, status="Skipped")

    def _finish(self) -> RunRecord:
        """Writes the run's report and record, and returns the record; writes nothing if this process was orphaned."""
        wait_if_ending()
        early = self._early
        return finish_run(
            self._facts,
            self._steps,
            self._service.settings,
            self._service,
            self._listener,
            is_canceled=self._is_canceled,
            against=self._outlasting(lambda: early.answer(self._steps)) if early is not None else None,
            ended_at=self._service.clock(),
            interruptions=self.interruptions,
            flow_run=flow_run.id,
            outlasting=self._outlasting,
        )


_current: ContextVar[PipelineRun | None] = ContextVar("robomaker_pipeline", default=None)


def _wanted(checked: CheckedSpec, origin: str, *, reuse: bool) -> WantedRun:
    """Makes the order of a Prefect flow run, with the command that repeats it: that of its deployment if it has one."""
    command = ["robomaker", "run", origin, *set_options(checked.parameters), *(["--reuse"] if reuse else [])]
    if name := deployment.name:
        command = ["prefect", "deployment", "run", f"RunPipeline/{name}"]
        command += [*param_options(checked.parameters), *(["--param=reuse=true"] if reuse else [])]
    return WantedRun(checked, origin, command, reuse=reuse)


def _refused(
    spec: str | None, text: str | None, origin: str, *, reuse: bool, parameters: Mapping[str, Any] | None
) -> WantedRun:
    """Makes the order of a flow run that was refused, as far as its specification can be read."""
    if spec is not None:
        text, origin = None, spec
        with suppress(ConfigurationError, ValueError):  # a ValueError: it is no UTF-8
            text = read_spec_file(Path(spec))
    return _wanted(known_spec(text, origin, parameters, deployment.name), origin, reuse=reuse)


def _log(event: ProgressEvent) -> None:
    """Writes the progress of a pipeline to the log of its flow run."""
    if isinstance(event, StepEnded):
        get_run_logger().info("step %s: %s", event.step, event.in_log)
    elif isinstance(event, Note):
        get_run_logger().info("%s", event.text)
