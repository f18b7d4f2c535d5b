"""Runs of a specification, reduced to the data for comparison, and matching of their jobs."""

from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...schemas.reports.changes import CellName
from ...schemas.reports.live_comparison import AgainstAnswer
from ...schemas.reports.run_record import JobRecord, RunRecord, RunState, SourceCommit
from ...schemas.reports.run_states import plain_reason
from ...schemas.runs.axis_kinds.kind import Value
from ..reporting import Outcome, classify
from ..results.table import RESULTS_FILE, ResultTable

JUDGED = (Outcome.PASSED, Outcome.FAILED)
TOLD = (*JUDGED, Outcome.BROKEN)
"""Outcomes that say whether a job is all right; a cancelled job's does not."""

HEALTH = "health"
"""Kind of requirements that are never requested: a result has them only if they were missed, such as `above_floor`."""

TRIALS = "trials"
"""Name of the requirement of a job with trials that counts instead of those of its trials."""

GroupKey = tuple[str, str, int | None, tuple[tuple[str, Value], ...]]


@dataclass(frozen=True)
class NightRun:
    """A run of a specification, reduced to the data by which it is compared with other runs."""

    run_id: str
    name: str
    started_at: datetime
    state: RunState
    jobs: Sequence[JobRecord]
    versions: dict[str, str] = field(default_factory=dict)
    source: SourceCommit | None = None
    parameters: dict[str, Any] = field(default_factory=dict)
    """Values of the specification's parameters."""
    report_path: Path | None = None
    results_path: Path | None = None
    """Path of the table of results; None: each job is one trial."""
    interruptions: int = 0
    """Number of the run's processes that died."""
    table: ResultTable | None = None
    """Table of results, if it has been read; else `results_path` is read."""
    refusal: str = ""
    """Reason why the run was refused before its first step; empty: it was not."""
    step_error: str = ""
    """Step at which the run broke, with its error, where no job tells why; empty: there is none."""
    against: AgainstAnswer | None = None
    """Answer of the comparison, if the run was compared with an earlier one while it ran."""

    @classmethod
    def of(cls, record: RunRecord) -> "NightRun":
        """Makes the comparison data of a run from its record."""
        return cls(
            run_id=record.run_id,
            name=record.name,
            started_at=record.started_at,
            state=record.state,
            jobs=record.jobs,
            versions=record.versions,
            source=record.source,
            parameters=record.parameters,
            report_path=record.report_path,
            results_path=record.run_dir / RESULTS_FILE,
            interruptions=len(record.interruptions),
            refusal=record.refusal or "",
            step_error=record.step_error,
            against=record.against,
        )

    @property
    def stopped_early(self) -> bool:
        """Whether trials are missing because the run ended early, once its comparison with another was decided."""
        return self.against is not None and self.against.stopped_early

    @property
    def results(self) -> ResultTable:
        """Table of the results of the run's trials; if it cannot be read, each job is one trial."""
        return self._read[0]

    @property
    def trouble(self) -> str:
        """Reason why the trial results cannot be read, with the command that repairs it; empty if they can."""
        return self._read[1]

    @cached_property
    def _read(self) -> tuple[ResultTable, str]:
        trouble = ""
        if self.table is not None:
            return self.table, ""
        if self.results_path is not None:
            try:
                found = ResultTable.read(self.results_path)
                return found, self._without_trials(found)
            except FileNotFoundError:
                if any(item.name == TRIALS for job in self.jobs for item in job.requirements):
                    trouble = f"{self.results_path} is not there"
            except (OSError, ValueError) as error:
                trouble = str(error)
        mend = f"{trouble}: each job of it counts as one trial; `robomaker report {self.run_id}` writes it again"
        return ResultTable.of(self.jobs), mend if trouble else ""

    def _without_trials(self, results: ResultTable) -> str:
        """Returns a sentence on jobs whose trials the table lacks, as they could not be read then; else empty."""
        has_number = ~np.isnan(results.numbers("trial"))
        lost = [
            job.label
            for job in self.jobs
            if job.status == "Completed"
            and any(item.name == TRIALS for item in job.requirements)
            and not has_number[results.rows_of(job)].any()
        ]
        return f"the trials of {', '.join(lost[:3])} are not in {self.results_path}: each counts as one" if lost else ""

    @property
    def has_inputs(self) -> bool:
        """Whether the inputs of the run's jobs are known, so that jobs can be matched with other runs."""
        return any(job.inputs is not None for job in self.jobs)


class CellTable:
    """Matches simulation jobs over several runs of a specification: the same job gets the same cell number.

    Jobs are the same when they are of the same step, drive in a world of the same content, have the same values of the
    step's axes, and the same seed where the request names one. Of several such jobs those with the same request are the
    same; what is left is taken in the order of the requests. Runs have to be placed in the order in which they ran.
    """

    def __init__(self) -> None:
        self._groups: dict[GroupKey, list[int]] = defaultdict(list)
        self._requests: list[str] = []

    def __len__(self) -> int:
        return len(self._requests)

    def place(self, jobs: Sequence[JobRecord]) -> list[int | None]:
        """Returns a number for each job, from 0, which it has in every run; jobs that no earlier run had get new ones.

        The number is None for jobs whose inputs are unknown.
        """
        places: list[int | None] = [None] * len(jobs)
        groups: dict[GroupKey, list[int]] = defaultdict(list)
        for index, job in enumerate(jobs):
            if (key := _group_of(job)) is not None:
                groups[key].append(index)
        for key, indexes in groups.items():
            self._place_group(self._groups[key], indexes, jobs, places)
        return places

    def _place_group(
        self, cells: list[int], indexes: list[int], jobs: Sequence[JobRecord], places: list[int | None]
    ) -> None:
        by_request: dict[str, deque[int]] = defaultdict(deque)
        for cell in cells:
            by_request[self._requests[cell]].append(cell)
        taken: set[int] = set()
        rest = []
        for index in indexes:
            if same := by_request.get(_request_of(jobs[index])):
                cell = places[index] = same.popleft()
                taken.add(cell)
            else:
                rest.append(index)
        free = iter([cell for cell in cells if cell not in taken])
        for index in rest:
            cell = next(free, None)
            if cell is None:
                cell = len(self._requests)
                self._requests.append("")
                cells.append(cell)
            self._requests[cell] = _request_of(jobs[index])
            places[index] = cell


def _group_of(job: JobRecord) -> GroupKey | None:
    if job.inputs is None:
        return None
    seed = job.inputs.seed if job.inputs.seed_given else None
    return job.step or "", job.inputs.world or "", seed, tuple(sorted(job.axes.items()))


def _request_of(job: JobRecord) -> str:
    return job.inputs.request_sha256 if job.inputs else ""


def outcome_of(job: JobRecord) -> Outcome:
    """Returns the outcome of a job from its record."""
    return classify(job.status, job.failure_code, job.verdict)


def reason_of(job: JobRecord) -> str:
    """Returns the reason why a job did not pass, in one line; empty if it passed."""
    if outcome_of(job) is Outcome.PASSED:
        return ""
    # What the job asks for itself comes before what its environment asks of all jobs.
    asked = sorted(job.requirements, key=lambda item: item.kind is None)
    missed = [f"{item.name}: {item.detail}" for item in asked if item.counts and not item.satisfied]
    words = job.failure_reason or plain_reason("; ".join(missed)) or job.verdict_reason or ""
    first = next(iter(words.strip().splitlines()), "")
    return ": ".join(part for part in (job.failure_code, first) if part)


def name_of(job: JobRecord) -> CellName:
    """Returns the name (step, world, robot, variables, seed) by which a job is matched over several runs."""
    seed = job.inputs.seed if job.inputs and job.inputs.seed_given else None
    return CellName(
        step=job.step or "",
        name=job.name,
        test=job.test or job.world or job.label,
        world=job.world,
        seed=seed,
        variant=job.variant,
    )
