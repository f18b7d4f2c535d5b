"""The job worker behind the endpoint: jobs are tried again, and failed at the retry limit."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.deployments.worker.job_pools import JobPool, job_pools
from prefect_robomaker.deployments.worker.prefect_watch import PrefectWatch
from prefect_robomaker.deployments.worker.running_jobs import MOST_TRIES, Jobs
from prefect_robomaker.deployments.worker.worker_process import in_words
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException
from prefect_robomaker.tasks.execution.leases.held_leases import HeldLeases
from prefect_robomaker.tasks.jobs.job_owners import OwnOrder
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service, Timing

Order = Callable[..., dict[str, Any]]


def test_there_is_a_lane_for_everything_that_is_performed() -> None:
    performed = {entry.perform_name for entry in registry().values() if entry.run_job}

    assert {registry()[pool.operation].perform_name for pool in job_pools(3)} == performed
    assert {pool.kind: pool.at_once for pool in job_pools(3)}["simulation-job"] == 3


def test_interrupted_jobs_in_words() -> None:
    assert in_words({"simulation-job": 1, "simulation-job-batch": 2}) == "1 simulation job, 2 simulation job batches"


class Watch(PrefectWatch):
    """Says what it is told to say."""

    def __init__(self, settings: Settings, answers: bool) -> None:
        super().__init__(settings)
        self.says = answers

    def looked_at_now(self) -> bool:
        return self.says


@pytest.mark.parametrize(
    ("error", "prefect_answers", "given_up"),
    [
        (RuntimeError("a defect"), True, True),
        (RuntimeError("Failed to reach API"), False, False),
        (ServiceUnavailableException("the catalog is locked"), True, False),
    ],
    ids=["a defect", "no Prefect", "no catalog"],
)
def test_a_job_whose_performing_breaks_is_given_up_unless_something_does_not_answer(
    service: Service,
    order: Order,
    error: Exception,
    prefect_answers: bool,
    given_up: bool,
) -> None:
    job = call("CreateSimulationJob", order(), service)["arn"]
    called: list[str] = []

    def flow(arn: str) -> None:
        called.append(arn)
        raise error

    ended = threading.Event()
    mine = Jobs(
        replace(service, timing=Timing(longest_retry_pause_s=0.01)),
        changed=ended.set,
        prefect=Watch(service.settings, prefect_answers),
        held=HeldLeases(),
        find_flow=lambda _: flow,
    )
    (pool, *_) = job_pools(1)
    for _ in range(MOST_TRIES + 2):
        ended.clear()
        mine.begin_some(pool)
        if not mine.counts() and not ended.is_set():
            break
        assert ended.wait(200)
        time.sleep(0.02)  # the pause before it is tried again

    described = call("DescribeSimulationJob", {"job": job}, service)
    if given_up:
        assert len(called) == MOST_TRIES
        assert (described["status"], described["failureCode"]) == ("Failed", "InternalServiceError")
        assert "running it failed 3 times: RuntimeError: a defect" in described["failureReason"]
    else:
        assert len(called) == MOST_TRIES + 2
        assert described["status"] == "Pending"
        assert [each.arn for each in service.catalog.unfinished(["simulation-job"])] == [job]


def test_the_oldest_jobs_begin_first_and_not_more_than_may(service: Service, order: Order) -> None:
    arns = [call("CreateSimulationJob", order(), service)["arn"] for _ in range(4)]
    go_on = threading.Event()
    begun: list[str] = []

    def flow(arn: str) -> None:
        begun.append(arn)
        go_on.wait(120)

    watch = Watch(service.settings, True)
    mine = Jobs(service, changed=lambda: None, prefect=watch, held=HeldLeases(), find_flow=lambda _: flow)
    pool = JobPool("simulation-job", "CreateSimulationJob", 2)
    for _ in range(3):
        mine.begin_some(pool)
    wait_for(lambda: len(begun) == 2, "two jobs")

    assert set(begun) == set(arns[:2])
    # Somebody else, with another two, takes the next ones.
    assert [job.arn for job in service.catalog.unfinished(["simulation-job"])] == arns[2:]
    go_on.set()
    wait_for(lambda: not mine.counts(), "their end")


def test_what_needs_another_environment_is_left_and_takes_nobodys_place(
    service: Service, order: Order, caplog: pytest.LogCaptureFixture
) -> None:
    nicer = replace(service, settings=service.settings.model_copy(update={"nice": 7}))
    arns: list[str] = []
    for _ in range(2):
        with OwnOrder(nicer, HeldLeases()) as own:
            arns.append(registry()["CreateSimulationJob"].ordered(order(), own.through, nicer)["arn"])
            own.keep(arns[-1])
    theirs = call("CreateSimulationJob", order(), service)["arn"]
    begun: list[str] = []
    mine = Jobs(service, lambda: None, Watch(service.settings, True), HeldLeases(), find_flow=lambda _: begun.append)
    pool = JobPool("simulation-job", "CreateSimulationJob", 1)

    mine.begin_some(pool)
    mine.begin_some(pool)
    wait_for(lambda: begun and not mine.counts(), "the job that a client ordered")

    assert begun[:1] == [theirs]
    assert set(begun) == {theirs}
    assert list(mine.left) == arns
    assert f"ROBOMAKER_NICE=7 robomaker perform {arns[0]}" in mine.left[arns[0]]
    [told, _] = [each for each in caplog.messages if "another environment" in each]
    assert "ROBOMAKER_NICE is 0, not 7" in told

    nice = Jobs(nicer, lambda: None, Watch(service.settings, True), HeldLeases(), find_flow=lambda _: begun.append)
    nice.begin_some(pool)
    wait_for(lambda: not nice.counts(), "the job that is as it was ordered")
    assert begun[-1] == arns[0]
    assert nice.left == {}


def test_jobs_that_were_left_are_looked_at_again(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = Jobs(service, lambda: None, Watch(service.settings, True), HeldLeases())
    mine.left["arn"] = "on another machine"
    mine.look_again()
    assert mine.left
    now_s = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now_s + 61)
    mine.look_again()
    assert not mine.left
