"""The trials of a batch are counted from what the catalog has of its jobs."""

from collections import Counter
from typing import Any

import pytest

from prefect_robomaker.schemas.runs.trials import TrialCounts
from prefect_robomaker.tasks.jobs.batch_workers import BatchTrials, EndedJobs
from prefect_robomaker.tasks.service.service import Service

BATCH = "arn:aws:robomaker:us-east-1:000000000000:simulation-job-batch/batch-1"


class Clock:
    """Seconds that a test sets."""

    now_s = 50.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def trials(service: Service, clock: Clock) -> BatchTrials:
    """Those of a batch of three requests: of 10 trials, of one episode, and of 20."""
    requests: list[dict[str, Any]] = [{"trials": {"seeds": 10}}, {}, {"trials": {"seeds": 20}}]
    return BatchTrials(BATCH, requests, service.catalog, clock)


def add(service: Service, index: int, status: str, finished: int | None, recorded: Any = None) -> str:
    document: dict[str, Any] = {"requestIndex": index, "request": {}, "seed": 0}
    if recorded is not None:
        document["trialsRecorded"] = recorded
    if finished is not None:
        document["trialsFinished"] = finished
    job = service.store_job("simulation-job", "sim", document, tags=None, token=None, parent=BATCH, status=status)
    return job.id


def test_requests_without_a_job_have_finished_none(trials: BatchTrials) -> None:
    assert not trials.look()
    assert trials.counts == TrialCounts(0, 30)


def test_a_job_that_completed_has_finished_all_its_trials_and_others_those_that_it_said(
    service: Service, trials: BatchTrials
) -> None:
    add(service, 0, "Completed", 7)  # it ended before it was asked again
    add(service, 1, "Completed", None)
    add(service, 2, "Failed", 4)

    assert trials.look()
    assert trials.counts == TrialCounts(14, 30)


def test_trials_that_are_recorded_again_are_counted_and_the_first_is_named(
    service: Service, trials: BatchTrials, clock: Clock
) -> None:
    add(service, 0, "Completed", 10, {"finished": 1, "total": 2, "trial": 4, "filmed": True})
    job = add(service, 2, "Running", 20, {"finished": 0, "total": 3, "trial": 6, "filmed": False})

    assert trials.look()
    assert trials.counts == TrialCounts(30, 30, 2, 5, f"records trial 6 of job {job}")


def test_the_catalog_is_asked_every_two_seconds_and_at_the_end(
    service: Service, trials: BatchTrials, clock: Clock
) -> None:
    assert not trials.look()
    add(service, 0, "Running", 3)
    clock.now_s += 1.0
    assert not trials.look()
    clock.now_s += 1.5
    assert trials.look()
    add(service, 2, "Running", 3)
    assert trials.look(now=True)
    assert not trials.look(now=True)
    assert trials.counts == TrialCounts(6, 30)


def test_without_trials_there_is_nothing_to_count_and_the_catalog_is_not_asked(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    trials = BatchTrials(BATCH, [{}, {}], service.catalog)
    monkeypatch.setattr(service.catalog, "list", pytest.fail)

    assert not trials.look(now=True)
    assert trials.counts is None


def test_ended_jobs_are_told_by_their_verdicts(service: Service) -> None:
    """A job whose end was not noted yet is told as one that stores."""

    def ended(status: str, verdict: str | None = None) -> Any:
        document = {"requestIndex": 0, "request": {}, "seed": 0, "verdict": verdict}
        return service.store_job("simulation-job", "sim", document, tags=None, token=None, parent=BATCH, status=status)

    jobs = [ended("Completed", "PASS"), ended("Completed", "FAIL"), ended("Completed"), ended("Failed")]
    seen = EndedJobs([*jobs, ended("Running"), ended("Canceled")])
    counts = Counter({"completed": 4, "failed": 1, "running": 1, "canceled": 1})
    seen.tell(counts)
    assert +counts == {
        "passed": 1, "failed": 1, "no verdict": 1, "broken": 1, "storing": 1, "running": 1, "canceled": 1,
    }  # fmt: skip

    before = Counter({"running": 4})
    seen.tell(before)
    assert +before == {"running": 4}, "the counts were taken before they ended"
