"""How the jobs of a batch went, counted in words: what Prefect shows of a batch that has one task run for all jobs."""

from collections import Counter
from collections.abc import Iterable

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.reports.run_states import case_outcome
from ..catalog import Resource


def outcomes_in_words(jobs: Iterable[Resource], not_created: int) -> str:
    """Counts jobs by outcome: `1000 jobs: 990 passed, 8 failed, 2 broken`.

    Args:
        jobs: of a batch, ended or not.
        not_created: how many of its requests never became jobs; they count as broken ones.
    """
    outcomes = Counter(_outcome_of(job) for job in jobs) + Counter({"broken": not_created})
    counts = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
    return f"{outcomes.total()} jobs: {counts}"


def _outcome_of(job: Resource) -> str:
    document = SimulationJobDocument.of(job)
    return case_outcome(job.status, document.verdict, document.failure_code)
