"""Finds the run since which a job fails, and which inputs changed then."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from ...schemas.reports.changes import ChangedInput, FailureStart
from ...schemas.reports.run_record import JobRecord
from ...schemas.specs.parameter_values import value_in_words
from ..reporting import Outcome
from .compared_runs import JUDGED, TOLD, CellTable, NightRun, outcome_of
from .pairing import Pair, pair_jobs

_STEADY_CHANGES = 3
"""Number of changes of a job's result from which it counts as flaky, whatever its inputs were."""


@dataclass(frozen=True)
class Appearance:
    """A simulation job in one run of its specification: its record and outcome."""

    night: int
    """Number of the run, from 0 for the oldest."""
    run: NightRun
    job: JobRecord
    outcome: Outcome
    """End of the job."""


def appearances_of(runs: Sequence[NightRun]) -> list[list[Appearance]]:
    """Groups the jobs of several runs: for each job of the specification, its records, oldest run first."""
    table = CellTable()
    cells: dict[int, list[Appearance]] = defaultdict(list)
    for night, run in enumerate(runs):
        for cell, job in zip(table.place(run.jobs), run.jobs, strict=True):
            if cell is not None:
                cells[cell].append(Appearance(night, run, job, outcome_of(job)))
    return list(cells.values())


def failure_start(appearances: Sequence[Appearance]) -> FailureStart | None:
    """Finds the run in which a job's present series of failures began.

    Runs in which the job was cancelled or had no verdict are skipped.

    Args:
        appearances: Job in each run that has it, oldest first.

    Returns:
        The first run of the present failures; None if the job does not fail.
    """
    told = [each for each in appearances if each.outcome in TOLD]
    first = len(told)
    while first and told[first - 1].outcome.is_failure:
        first -= 1
    if first == len(told):
        return None
    start, passed = told[first], told[first - 1] if first else None
    return FailureStart(
        run_id=start.run.run_id,
        started_at=start.run.started_at,
        nights=len(told) - first,
        broke=sum(each.outcome is Outcome.BROKEN for each in told[first:]),
        last_passed_run_id=passed.run.run_id if passed else None,
        changed=changed_inputs(passed, start) if passed else [],
    )


def changed_inputs(before: Appearance, after: Appearance) -> list[ChangedInput]:
    """Returns the inputs of a job that differ between two runs, as far as both are known."""
    return changed_runs(before.run, after.run) + changed_jobs(Pair(before.job, after.job))


def changed_jobs(pair: Pair) -> list[ChangedInput]:
    """Returns the applications of a job that differ between two runs, and its request if that differs.

    Nothing is returned where the inputs of a side are not known.
    """
    old, new = pair.before.inputs, pair.after.inputs
    if old is None or new is None:
        return []
    ours, theirs = ({used.name: used.digest for used in inputs.applications} for inputs in (old, new))
    both = ours and theirs  # those of a job that broke early are not known
    return (_differences("application", ours, theirs) if both else []) + changed_requests([pair])


def changed_requests(pairs: Sequence[Pair]) -> list[ChangedInput]:
    """Returns a changed input if some jobs had other requirements, or else another request, in the second run."""
    if not all(pair.has_same_requirements for pair in pairs):
        return [ChangedInput(what="requirements")]
    return [] if all(pair.has_same_request for pair in pairs) else [ChangedInput(what="request")]


def changed_runs(before: NightRun, after: NightRun) -> list[ChangedInput]:
    """Returns the differences between two whole runs: commit of the specification, parameters, package versions."""
    changed = []
    if before.source and after.source and before.source.commit != after.source.commit:
        changed.append(ChangedInput(what="commit", before=before.source.commit, after=after.source.commit))
    return changed + changed_parameters(before, after) + changed_versions(before, after)


def changed_versions(before: NightRun, after: NightRun) -> list[ChangedInput]:
    """Returns the packages whose versions differ between two runs, and those that one lacks."""
    return _differences("version", before.versions, after.versions)


def changed_parameters(before: NightRun, after: NightRun) -> list[ChangedInput]:
    """Returns the parameters of the specification whose values differ between two runs, and those that one lacks."""
    ours, theirs = ({name: value_in_words(value) for name, value in run.parameters.items()} for run in (before, after))
    return _differences("parameter", ours, theirs)


def applications_of(run: NightRun) -> dict[str, str]:
    """Returns the applications of a run's jobs by name, each with the digests of its archives."""
    digests: dict[str, set[str]] = {}
    for job in run.jobs:
        for each in job.inputs.applications if job.inputs else ():
            digests.setdefault(each.name, set()).add(each.digest)
    return {name: ", ".join(sorted(found)) for name, found in digests.items()}


def changed_nights(before: NightRun, after: NightRun) -> list[ChangedInput]:
    """Returns all input differences between two runs: commit, packages, applications and requests."""
    ours, theirs = applications_of(before), applications_of(after)
    both = ours.keys() & theirs.keys()
    applications = _differences(
        "application", {name: ours[name] for name in both}, {name: theirs[name] for name in both}
    )
    return changed_runs(before, after) + applications + changed_requests(pair_jobs(before.jobs, after.jobs).pairs)


def results_changed(appearances: Sequence[Appearance]) -> int:
    """Counts how often a job's verdict changed between passed and failed from one run to the next."""
    passed = [each.outcome is Outcome.PASSED for each in appearances if each.outcome in TOLD]
    return sum(old != new for old, new in pairwise(passed))


def differs_with_same_inputs(appearances: Sequence[Appearance]) -> bool:
    """Whether a job both passed and failed with the same applications, versions, request, trials, data and seed.

    Jobs whose applications are not known do not count.
    """
    if not {each.outcome for each in appearances}.issuperset(JUDGED):
        return False
    verdicts: dict[tuple[object, ...], set[Outcome]] = {}
    for each in appearances:
        inputs = each.job.inputs
        if inputs is not None and inputs.applications and each.outcome in JUDGED:
            digests = tuple(sorted((used.role, used.name, used.digest) for used in inputs.applications))
            asked = (inputs.request_sha256, inputs.trials_and_data_sha256 or _parameters_of(each.run))
            key = (digests, asked, inputs.seed, tuple(sorted(each.run.versions.items())))
            verdicts.setdefault(key, set()).add(each.outcome)
    return any(len(found) > 1 for found in verdicts.values())


def _parameters_of(run: NightRun) -> str:
    """Returns the run's parameters as text, which may be in trials or data that its records do not tell apart."""
    return str(sorted((name, value_in_words(value)) for name, value in run.parameters.items()))


def is_unsteady(changes: int, same_inputs: bool) -> bool:
    """Returns whether a job is flaky, so that its results cannot be relied on."""
    return same_inputs or changes >= _STEADY_CHANGES


def _differences(
    what: str, before: Mapping[str, str], after: Mapping[str, str]
) -> list[ChangedInput]:  # fmt: skip
    """Returns the names whose values differ, and names that only one of the mappings has."""
    return [
        ChangedInput.model_validate({"what": what, "name": name, "before": before.get(name), "after": after.get(name)})
        for name in sorted(before.keys() | after.keys())
        if before.get(name) != after.get(name)
    ]
