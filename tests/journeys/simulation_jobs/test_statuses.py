"""The statuses that real jobs go through, one after the other, for every way to end."""

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.jobs import job_runs
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]
LONG = {"DURATION_S": "60"}
RAN = ["Pending", "Preparing", "Running"]


@pytest.fixture
def seen(service: Service, monkeypatch: pytest.MonkeyPatch) -> list[Resource]:
    """Every state of every job, as soon as it is in the catalog."""
    states: list[Resource] = []
    transition = service.catalog.transition

    def noted(*arguments: Any, **options: Any) -> Resource:
        states.append(transition(*arguments, **options))
        return states[-1]

    monkeypatch.setattr(service.catalog, "transition", noted)
    return states


@pytest.fixture
def statuses(service: Service, seen: list[Resource]) -> Callable[..., list[str]]:
    """Performs a job to its end, calling an operation each time it gets a status; returns all it went through."""

    def has_come(status: str, since: int) -> bool:
        return status in [state.status for state in seen[since:]]

    def run(request: dict[str, Any], *operations: tuple[str, str]) -> list[str]:
        job = call("CreateSimulationJob", request, service)
        worker = threading.Thread(target=perform_job, args=(job["arn"], service))
        worker.start()
        begin = 0
        for status, operation in operations:
            wait_for(partial(has_come, status, begin), status)
            begin = len(seen)
            call(operation, {"job": job["arn"]}, service)
        worker.join(200)
        assert not worker.is_alive()
        return [job["status"], *(state.status for state in seen)]

    return run


def test_completed(order: Order, statuses: Callable[..., list[str]]) -> None:
    assert statuses(order()) == [*RAN, "Terminating", "Completed"]


def test_the_duration_limit_is_a_normal_end(order: Order, statuses: Callable[..., list[str]]) -> None:
    assert statuses(order(LONG, maxJobDurationInSeconds=1)) == [*RAN, "Terminating", "Completed"]


def test_a_crash_has_its_code_before_the_uploads_begin(
    order: Order, statuses: Callable[..., list[str]], seen: list[Resource]
) -> None:
    assert statuses(order({"FAIL_AT_STEP": "2"})) == [*RAN, "Terminating", "Failed"]
    assert seen[-2].document["failureCode"] == "SimulationApplicationCrash"


def test_what_cannot_be_prepared_never_runs(service: Service, order: Order, statuses: Callable[..., list[str]]) -> None:
    request = order()
    service.store.put_bytes("applications", "sleeper.tar.gz", b"no archive any more")
    assert statuses(request) == ["Pending", "Preparing", "Terminating", "Failed"]


def test_cancelled_while_it_runs(order: Order, statuses: Callable[..., list[str]]) -> None:
    assert statuses(order(LONG), ("Running", "CancelSimulationJob")) == [*RAN, "Terminating", "Canceled"]


def test_restarted_and_then_cancelled(order: Order, statuses: Callable[..., list[str]]) -> None:
    found = statuses(order(LONG), ("Running", "RestartSimulationJob"), ("Running", "CancelSimulationJob"))
    # Ordered, then prepared again.
    assert found == [*RAN, "Restarting", "Restarting", "Running", "Terminating", "Canceled"]


@pytest.fixture
def limit_after_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    """Has the clock of a run's duration jump by a day as soon as something has crashed in it."""
    real = job_runs.launcher()

    class Hasty:
        def run(self, plan: Any, stop: Any, *, on_crash: Callable[[str, str], None], **options: Any) -> Any:
            gone_by = [0.0]

            def crashed(code: str, reason: str) -> None:
                on_crash(code, reason)
                gone_by[0] = 86400.0

            return real.run(plan, stop, on_crash=crashed, clock=lambda: time.monotonic() + gone_by[0], **options)

    monkeypatch.setattr(job_runs, "launcher", Hasty)


@pytest.mark.usefixtures("limit_after_crash")
def test_a_crash_that_ends_nothing(order: Order, statuses: Callable[..., list[str]]) -> None:
    request = order({"FAIL_AT_STEP": "2"}, failureBehavior="Continue", maxJobDurationInSeconds=3600)
    assert statuses(request) == [*RAN, "RunningFailed", "Terminating", "Failed"]


def test_a_crash_that_ends_nothing_then_cancelled(order: Order, statuses: Callable[..., list[str]]) -> None:
    request = order({"FAIL_AT_STEP": "2"}, failureBehavior="Continue")
    found = statuses(request, ("RunningFailed", "CancelSimulationJob"))
    assert found == [*RAN, "RunningFailed", "Terminating", "Canceled"]
