"""Comparison of a running run with an earlier one, job by job: ends the run once the comparison is decided."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...schemas.documents.simulation_jobs import SimulationJobBatchDocument, SimulationJobDocument
from ...schemas.lifecycles import is_terminal
from ...schemas.reports.live_comparison import Against, AgainstAnswer
from ...schemas.reports.report import ReportedJob
from ...schemas.reports.run_record import JobRecord, RunRecord, StepRecord
from ...schemas.runs.programs import STOP_EVENTS
from ...schemas.specs.batch_splitting import parts_of, step_of
from ...schemas.specs.resolving import resolve_input
from ...schemas.specs.specification import CheckedSpec
from ...schemas.wire.errors import ConfigurationError, ResourceNotFoundException, SpecError
from ..catalog import Resource
from ..comparison.compared_runs import NightRun
from ..comparison.early_stops import Outcomes, PairedTrials, States, decide, told_decision
from ..comparison.pairing import STOPPED, Pair, outcomes_of, pair_jobs, pair_trials
from ..comparison.statistics.e_processes import fewest_pairs
from ..jobs.request_order import mixed_order
from ..service.service import Service
from ..simulations.planning.run_plans import world_arn
from .job_outputs import axes_of, inputs_of_request, with_inputs
from .reports import records_of_ended
from .run_records import RECORD_NAME, read_record

DRIVES = ("CreateSimulationJob", "StartSimulationJobBatch")
"""Operations that run simulation jobs."""

_OPEN_STATES = ("canceled", "timed out")


def earlier_run(asked: Against, runs: Path, spec: CheckedSpec) -> NightRun:
    """Reads the earlier run with which a new run of a specification is to be compared.

    Args:
        asked: Settings of the comparison.
        runs: Folder of all runs.
        spec: Specification of the new run.

    Raises:
        ConfigurationError: The earlier run does not exist, is incomplete, or cannot decide anything.
    """
    try:
        record = read_record(runs / asked.run_id / RECORD_NAME)
    except OSError as error:
        raise ConfigurationError(f"--against is {asked.run_id}, whose record cannot be read: {error}") from error
    if why := _why_unfit(record, spec):
        raise ConfigurationError(f"--against is {asked.run_id}, {why}")
    before = NightRun.of(record)
    earlier = _EarlierTrials(before)
    found = decide([earlier.of(job) for job in before.jobs if step_of(job.step or "") in spec.steps], asked)
    if found.is_hopeless:
        raise ConfigurationError(
            f"--against is {asked.run_id}, whose {found.planned} {'trial' if found.planned == 1 else 'trials'} cannot "
            f"decide anything at --alpha {asked.alpha:g}, however the others end; it takes "
            f"{fewest_pairs(asked.alpha)} trials at least, more where not all of them change"
        )
    if _has_no_pairs(before, spec):
        raise ConfigurationError(
            f"--against is {asked.run_id}, of which no job has the step, seed and axes of a job of {spec.name}, so "
            "that there are no pairs; a run of the same specification would do"
        )
    return before


def _has_no_pairs(before: NightRun, spec: CheckedSpec) -> bool:
    """Whether no job of a specification can have a pair in an earlier run, as far as that is known before it runs.

    It is not known where requests refer to what earlier steps make, or name worlds.
    """
    asked: list[JobRecord] = []
    for step in spec.steps.values():
        if step.operation in DRIVES:
            try:
                parts = parts_of(step.operation, resolve_input(step, {}))
            except (SpecError, KeyError):
                return False
            for part in parts:
                requests = part.request.get("createSimulationJobRequests", [part.request])
                asked += [_requested(part.name(step.name), request) for request in requests]
                if any(world_arn(request) for request in requests):
                    return False
    return spec.seed is None and not pair_jobs(before.jobs, asked).pairs


def _requested(step: str, request: Mapping[str, Any]) -> JobRecord:
    inputs = inputs_of_request(request, None)
    axes = axes_of(ReportedJob(label="", status="Pending", request=dict(request)), inputs)
    return JobRecord(label="", status="Pending", step=step, inputs=inputs, axes=axes)


def _why_unfit(record: RunRecord, spec: CheckedSpec) -> str:
    if record.state in _OPEN_STATES:
        return f"which was not finished ({record.state}); a run that came to its end would do"
    if record.against is not None and record.against.stopped_early:
        return f"which itself stopped early against {record.against.run_id}; a run that came to its end would do"
    if record.challenge is not None:
        return "which is a challenge, with robots that were sabotaged; a whole run would do"
    if record.probe:
        return "which is a probe of a forecast, with smaller requests; a whole run would do"
    driving = {name for name, step in spec.steps.items() if step.operation in DRIVES}
    if not any(step_of(job.step or "") in driving and job.inputs for job in record.jobs):
        steps = ", ".join(sorted(driving)) or "none"
        return (
            f"a run of {record.name} that has no simulation jobs of this specification's steps ({steps}) to pair with; "
            "a run of the same specification would do"
        )
    return ""


@dataclass(frozen=True)
class _Asked:
    """The requests of a step, or of a part of it, whose jobs have not begun."""

    step: str
    requests: list[JobRecord]
    order: list[int]


class RunBeside:
    """Pairs of equal jobs of a running run and an earlier run, and the comparison of their results.

    Args:
        asked: Settings of the comparison.
        before: Record of the earlier run.
        steps: Names of the specification's steps.
        service: Service that stores the run.
    """

    def __init__(self, asked: Against, before: NightRun, steps: Sequence[str], service: Service) -> None:
        self._question, self._before, self._service = asked, before, service
        self._earlier = _EarlierTrials(before)
        self._steps = list(steps)
        self._requests: dict[str, _Asked] = {}
        self._ended: dict[tuple[str, int], tuple[JobRecord, Outcomes, States]] = {}

    def answer(self, steps: Sequence[StepRecord], *, is_over: bool = False) -> AgainstAnswer | None:
        """Compares the pairs that have ended, and returns the answer once it is decided.

        Args:
            steps: Steps that have begun, in order; simulation steps have the ARN of their job or batch.
            is_over: Whether no further step begins.

        Returns:
            The answer; None: it is undecided, and the remaining pairs can decide it.
        """
        begun = _begun(steps)
        asked = [self._asked(step) for step in begun]
        pairs = pair_jobs(self._before.jobs, [request for each in asked for request in each.requests])
        earlier = {id(pair.after): pair.before for pair in pairs.pairs}
        for step, each in zip(begun, asked, strict=True):
            self._look(step, each, earlier)
        trials = [
            self._paired(step.arn or "", each, place, earlier)
            for step, each in zip(begun, asked, strict=True)
            for place in each.order
            if id(each.requests[place]) in earlier
        ]
        expected, lost = [], []
        for job in pairs.only_before:
            may_come = not is_over and self._may_come(job.step or "", begun)
            (expected if may_come else lost).append(self._earlier.of(job))
        found = decide([*trials, *expected], self._question, lost)
        if found.answer is None and not found.is_hopeless and not is_over:
            return None
        return told_decision(self._question, found, is_over=is_over)

    def with_saved(self, answer: AgainstAnswer, steps: Sequence[StepRecord]) -> AgainstAnswer:
        """Adds the saved time and the skipped jobs to the answer for which the jobs of a run were cancelled.

        Args:
            answer: Answer of the comparison.
            steps: All steps of the run, which have ended or were skipped.
        """
        self.answer(steps)  # jobs may have ended after the decision
        ran = [outcomes for job, outcomes, _ in self._ended.values() if job.status != "Canceled"]
        counts = {
            "saved": max(0, answer.planned - sum(map(len, ran))),
            "unpaired": self._unpaired(_begun(steps)),
        }
        return with_skipped(answer, steps).model_copy(update=counts)

    def _unpaired(self, begun: Sequence[StepRecord]) -> int:
        """Counts requests of begun steps without a partner in the other run whose jobs did not run to their end."""
        asked = [self._asked(step) for step in begun]
        pairs = pair_jobs(self._before.jobs, [request for each in asked for request in each.requests])
        paired = {id(pair.after) for pair in pairs.pairs}
        return sum(
            id(request) not in paired and place not in ran
            for step, each in zip(begun, asked, strict=True)
            for ran in [self._places_that_ran(step)]
            for place, request in enumerate(each.requests)
        )

    def _places_that_ran(self, step: StepRecord) -> set[int]:
        ran = {place for place, job in self._jobs(step).items() if _has_ended(job) and job.status != "Canceled"}
        if step.operation == "StartSimulationJobBatch":
            ran.update(self._broken_requests(step.arn or ""))
        return ran

    def _broken_requests(self, arn: str) -> list[int]:
        """Lists the requests of a batch for which no job was created, although the batch was not stopped."""
        document = SimulationJobBatchDocument.of(self._service.catalog.get(arn))
        return [int(place) for place, failure in document.failed.items() if failure.failure_code not in STOP_EVENTS]

    def ended_count(self, steps: Sequence[StepRecord]) -> int:
        """Counts the ended simulation jobs of steps, without reading the jobs."""
        return sum(
            count
            for step in steps
            if step.arn and step.operation in DRIVES
            for status, count in self._statuses(step).items()
            if is_terminal("simulation-job", status)
        )

    def _statuses(self, step: StepRecord) -> Mapping[str, int]:
        arn = step.arn or ""
        if step.operation == "CreateSimulationJob":
            return {self._service.catalog.get(arn).status: 1}
        return self._service.catalog.count_children(arn, kind="simulation-job")

    def _may_come(self, step: str, begun: Sequence[StepRecord]) -> bool:
        """Returns whether further requests of a step, or of a part of it, may still be submitted."""
        if step_of(step) not in self._steps or any(each.name == step for each in begun):
            return False
        places = [self._steps.index(step_of(each.name)) for each in begun]
        return self._steps.index(step_of(step)) >= max(places, default=0)

    def _asked(self, step: StepRecord) -> _Asked:
        arn = step.arn or ""
        if arn not in self._requests:
            job = self._service.catalog.get(arn)
            if job.kind == "simulation-job-batch":
                document = SimulationJobBatchDocument.of(job)
                requests = [dict(each) for each in document.requests]
                order = mixed_order(requests) if document.mixed else list(range(len(requests)))
            else:
                requests, order = [dict(SimulationJobDocument.of(job).request)], [0]
            reported = [
                ReportedJob(
                    label=f"request {place + 1}",
                    status="Pending",
                    step=step.name,
                    request=request,
                    world_arn=world_arn(request),
                    inputs=inputs_of_request(request, None),
                )
                for place, request in enumerate(requests)
            ]
            records = [
                JobRecord(label=each.label, status=each.status, step=each.step, inputs=each.inputs, axes=each.axes)
                for each in with_inputs(reported, self._service)
            ]
            self._requests[arn] = _Asked(step.name, records, order)
        return self._requests[arn]

    def _look(self, step: StepRecord, asked: _Asked, earlier: Mapping[int, JobRecord]) -> None:
        """Reads results of a step's jobs that have ended since the last call; adds their pairs to the comparison."""
        arn = step.arn or ""
        new = {
            place: job
            for place, job in self._jobs(step).items()
            if (arn, place) not in self._ended and id(asked.requests[place]) in earlier and _has_ended(job)
        }
        if new:
            places, jobs = list(new), list(new.values())
            records, table = records_of_ended(step.name, jobs, self._service)
            after = replace(self._before, jobs=records, table=table)
            pairs = [Pair(earlier[id(asked.requests[place])], job) for place, job in zip(places, records, strict=True)]
            self._note(arn, places, pairs, after)
        if step.operation == "StartSimulationJobBatch":
            self._note_unmade(arn, asked, earlier)

    def _note(self, arn: str, places: Sequence[int], pairs: Sequence[Pair], after: NightRun) -> None:
        found = pair_trials(pairs, self._before, after)
        outcomes, states = found.outcomes[1], after.results.texts("state_digest")
        for number, (place, pair) in enumerate(zip(places, pairs, strict=True)):
            rows = self._before.results.rows_of(pair.before)
            own = np.full(len(rows), STOPPED, dtype=np.int8)
            mine = found.jobs == number
            places_of_rows = found.before_rows[mine] - rows.start
            own[places_of_rows] = outcomes[mine]
            after_rows = dict(zip(places_of_rows.tolist(), found.after_rows[mine].tolist(), strict=True))
            digests = [states[after_rows[row]] if row in after_rows else None for row in range(len(rows))]
            self._ended[arn, place] = pair.after, own, digests

    def _note_unmade(self, arn: str, asked: _Asked, earlier: Mapping[int, JobRecord]) -> None:
        """Records requests for which no job was created; they count as not passed."""
        for place in self._broken_requests(arn):
            request = asked.requests[place]
            if id(request) in earlier and (arn, place) not in self._ended:
                rows = self._before.results.rows_of(earlier[id(request)])
                self._ended[arn, place] = request, np.full(len(rows), STOPPED, dtype=np.int8), ()

    def _jobs(self, step: StepRecord) -> dict[int, Resource]:
        arn, catalog = step.arn or "", self._service.catalog
        try:
            if step.operation == "CreateSimulationJob":
                return {0: catalog.get(arn)}
            jobs = catalog.children(arn, kind="simulation-job")
        except ResourceNotFoundException:
            return {}
        return {SimulationJobDocument.of(job).request_index or 0: job for job in jobs}

    def _paired(self, arn: str, asked: _Asked, place: int, earlier: Mapping[int, JobRecord]) -> PairedTrials:
        request = asked.requests[place]
        before = earlier[id(request)]
        expected = self._earlier.of(before)
        if (arn, place) not in self._ended:
            return expected
        job, outcomes, states = self._ended[arn, place]
        is_fair = Pair(before, job).has_same_requirements
        return replace(expected, after=outcomes, is_fair=is_fair, after_states=states)


def with_skipped(answer: AgainstAnswer, steps: Sequence[StepRecord]) -> AgainstAnswer:
    """Adds the skipped steps, and whether simulations were cut short, to the answer that ended a run.

    Args:
        answer: Answer of the comparison.
        steps: All steps of the run, which have ended or were skipped.
    """
    return answer.model_copy(
        update={
            "skipped": [step.name for step in steps if step.status == "Skipped"],
            # Not by what was saved: the later run may have more jobs than there are pairs.
            "stopped_early": any(step.operation in DRIVES and step.status in ("Canceled", "Skipped") for step in steps),
        }
    )


class _EarlierTrials:
    """Trials of the earlier run, as pairs whose second half (the later run's trials) has not ended yet."""

    def __init__(self, run: NightRun) -> None:
        self._results, self._outcomes = run.results, outcomes_of(run.results)
        self._states = run.results.texts("state_digest")

    def of(self, job: JobRecord) -> PairedTrials:
        rows = self._results.rows_of(job)
        world = (job.inputs and job.inputs.world) or ""
        return PairedTrials(
            world, self._outcomes[rows.start : rows.stop], before_states=self._states[rows.start : rows.stop]
        )


def _begun(steps: Sequence[StepRecord]) -> list[StepRecord]:
    """Returns the simulation steps that have created a job or batch."""
    return [step for step in steps if step.operation in DRIVES and step.arn]


def _has_ended(job: Resource) -> bool:
    """Returns whether a job has ended, but not because its batch was stopped, which says nothing about the robot."""
    if not is_terminal(job.kind, job.status):
        return False
    return job.status == "Completed" or SimulationJobDocument.of(job).failure_code not in STOP_EVENTS
