"""Flakiness of the jobs of a run: runs each again within its number of reruns, and says what decides."""

from collections import Counter
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.reports.report import ReportedJob
from ...schemas.reports.run_record import RunRecord
from ...schemas.runs.verification import FACTORS, Flakiness, Side, TriedHold
from ...schemas.wire.errors import RobomakerError
from ..catalog import Resource
from ..inspection.found_runs import FoundRun, found_run, scratch_folder
from ..inspection.reports import jobs_of
from ..inspection.reruns import Selection, chosen_jobs
from ..service.service import Service
from ..simulations.planning.job_contents import contents_of_request
from ..simulations.ros.ros_domains import own_domain
from .evidence import Observation
from .search import MOST_RERUNS, search
from .sides import REPLAYS, side_of
from .trials import NotRerunError, Trials, has_all_commands

FEWEST_RERUNS = 8
"""With fewer, neither can a job be said to repeat, nor a factor be found."""


def all_jobs(record: RunRecord, service: Service) -> list[ReportedJob]:
    """Returns the jobs of a run that were created; requests without a job are left out."""
    return [each for each in jobs_of(record.steps, service, record.rerun_of) if each.arn]


def jobs_to_examine(record: RunRecord, names: Sequence[str], jobs: Sequence[ReportedJob]) -> list[ReportedJob]:
    """Returns the jobs of a run that are asked for, or those that failed.

    Args:
        record: Record of the run.
        names: Names, ids or ARNs of jobs; empty: those that failed.
        jobs: All jobs of the run.

    Raises:
        ConfigurationError: The run has no such job.
    """
    return chosen_jobs(Selection(failed=not names, jobs=tuple(names)), jobs, record.run_id)


def examine(
    job: ReportedJob,
    beside: Sequence[ReportedJob],
    service: Service,
    most: int = MOST_RERUNS,
    on_rerun: Callable[[int], None] = lambda _: None,
) -> Flakiness:
    """Runs a job again until it is clear what decides how it ends.

    Args:
        job: Job of a run, which has ended.
        beside: All jobs of that run.
        service: Service with the catalog and the object store.
        most: Number of reruns at most, replays of commands among them.
        on_rerun: Called with the number of finished reruns.
    """
    assert job.arn is not None
    blank = Flakiness(job=job.arn, name=job.title, answer="not rerun")
    try:
        with found_run(job.arn, service) as run, scratch_folder(service) as scratch, own_domain(job.arn) as domain:
            if run.outputs.provenance.plan.trials is not None:
                why = f"it has trials; `robomaker verify {job.label}` repeats the first one that did not pass"
                return blank.model_copy(update={"why": why})
            neighbours = _has_neighbours(job, beside, service)
            trials = Trials(run, service, scratch, domain, neighbours, on_rerun)
            notes = [*_notes(run, service), *_of_error(trials.first_end), *_of_commands(run)]
            try:
                return _examined(blank.model_copy(update={"notes": notes}), trials, most)
            except NotRerunError as error:
                why = f"{error}, so that reruns would say nothing about the run"
                return blank.model_copy(update={"why": why, "reruns": len(trials.made)})
    except RobomakerError as error:
        return blank.model_copy(update={"why": str(error)})


def _examined(blank: Flakiness, trials: Trials, most: int) -> Flakiness:
    first = trials.first_observation()
    found = search(trials.try_out, trials.weights, most - REPLAYS, first)
    side, where, notes = ("unknown", None, []) if found.repeats else _side(trials, most)
    free = (each for each in found.observations if not each.held)
    is_end_seen = trials.first_end in {None, *(each.verdict for each in free)}
    answer = "decided" if found.decision else "repeats" if found.repeats and is_end_seen else "not decided"
    reran = [each for each in found.observations if each is not first]
    why = found.why_not
    if answer == "not decided" and len({each.observation.bits for each in trials.made}) == 1:
        why = "all reruns are alike, but the run was not: what decided is not there any more"
    return blank.model_copy(
        update={
            "answer": answer,
            "decides": found.decision.factor if found.decision else None,
            "probability": round(found.decision.probability, 4) if found.decision else None,
            "side": side,
            "notes": [*blank.notes, *notes],
            "verdict": trials.first_end,
            "has_states": trials.have_states,
            "reruns": len(trials.made) + trials.replays,
            "tried": _tried(reran),
            "first_difference": where,
            "why": why,
        }
    )


def _side(trials: Trials, most: int) -> tuple[Side, str | None, list[str]]:
    """Finds the side; what reruns have decided stays, if the simulation cannot be run again without its robot."""
    try:
        return *side_of(trials, most - len(trials.made)), []
    except NotRerunError as error:
        return "unknown", None, [f"The simulation could not be run again with recorded commands: {error}."]


def _tried(observations: Sequence[Observation]) -> list[TriedHold]:
    """Returns reruns by what they held, those that held least first."""
    holds = sorted({each.hold for each in observations}, key=lambda hold: (len(hold.held), *map(sorted, hold)))
    tried: list[TriedHold] = []
    for hold in holds:
        same = [each for each in observations if each.hold == hold]
        tried.append(
            TriedHold(
                held=[each for each in FACTORS if each in hold.held],
                values=dict(sorted(hold.values)),
                ends=dict(Counter(each.verdict for each in same)),
                ways=len({each.bits for each in same}),
            )
        )
    return tried


def _notes(run: FoundRun, service: Service) -> list[str]:
    """Returns a sentence for each application that has changed since the run; the reruns have the one that it ran with.

    It is empty if the run has no job in the catalog, or the present applications cannot be read.
    """
    if run.job is None:
        return []
    document = SimulationJobDocument.of(run.job)
    had = document.made_of.etags if document.made_of else {}
    try:
        now = contents_of_request(document.request, service).etags
    except RobomakerError:
        return []
    changed = [role for role, etag in had.items() if role in now and now[role] != etag]
    return [
        f"The {role} application has changed since the run; the reruns have the archive that it ran with."
        for role in changed
    ]


def _of_error(end: str | None) -> list[str]:
    if end in (None, "PASS", "FAIL"):
        return []
    return [f"The run ended with {end}, which says nothing of how the robot did; it counts as an end here."]


def _of_commands(run: FoundRun) -> list[str]:
    if has_all_commands(run.outputs):
        return []
    return ["The run's own commands are not kept any more, so that only reruns are compared with each other."]


def _has_neighbours(job: ReportedJob, beside: Sequence[ReportedJob], service: Service) -> bool:
    """Returns whether another job of the run ran at the same time as a job."""
    stored = service.catalog.get_many([each.arn for each in beside if each.arn])
    own = _span(stored[job.arn or ""])
    others = [_span(resource) for arn, resource in stored.items() if arn != job.arn]
    return own is not None and any(other and own[0] < other[1] and other[0] < own[1] for other in others)


def _span(job: Resource) -> tuple[datetime, datetime] | None:
    document = SimulationJobDocument.of(job)
    if document.started_at is None or document.simulation_time_millis is None:
        return None
    return document.started_at, document.started_at + timedelta(milliseconds=document.simulation_time_millis)
