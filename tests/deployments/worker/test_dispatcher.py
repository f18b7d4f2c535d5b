"""The job worker behind the endpoint: jobs are handed to Prefect, tried again, and failed at the retry limit."""

import threading
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.deployments.worker.dispatcher import MOST_RUNS, Dispatcher
from prefect_robomaker.deployments.worker.jobs import MOST_TRIES, Jobs
from prefect_robomaker.deployments.worker.pools import JobPool, job_pools
from prefect_robomaker.deployments.worker.prefect_watch import PrefectWatch
from prefect_robomaker.deployments.worker.worker_process import in_words
from prefect_robomaker.flows.lookup import find_perform_flow
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError, ServiceUnavailableException
from prefect_robomaker.tasks.execution.held_leases import HeldLeases
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.service.timing import Timing

Order = Callable[..., dict[str, Any]]


def test_there_is_a_lane_for_everything_that_is_performed() -> None:
    performed = {entry.name for entry in registry().values() if entry.run_job}

    assert {pool.operation for pool in job_pools(3)} == performed
    assert {pool.kind: pool.at_once for pool in job_pools(3)}["simulation-job"] == 3


def test_interrupted_jobs_in_words() -> None:
    assert in_words({"simulation-job": 1, "simulation-job-batch": 2}) == "1 simulation job, 2 simulation job batches"


# Handing jobs to deployments


@pytest.fixture
def deployment() -> str:
    """The name of deployments that no other test uses."""
    return f"test-{uuid.uuid4().hex[:8]}"


@pytest.fixture
def deployments(prefect_server: str, deployment: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A Prefect client; the deployments that perform jobs exist, without a worker."""
    from prefect.client.orchestration import get_client

    monkeypatch.setenv("PREFECT_API_URL", prefect_server)
    with get_client(sync_client=True) as client:
        for pool in job_pools(1):
            client.create_deployment(flow_id=client.create_flow(find_perform_flow(pool.operation)), name=deployment)
        yield client


@pytest.fixture
def hand_over(service: Service, deployments: Any, deployment: str) -> Callable[..., Dispatcher]:
    """Makes a dispatcher that has looked once."""

    def make(timing: Timing = service.timing) -> Dispatcher:
        watch = PrefectWatch(service.settings)
        made = Dispatcher(replace(service, timing=timing), job_pools(1), watch, deployment=deployment, check_s=0.0)
        made.prepare()
        made.look()
        return made

    return make


def runs_of(client: Any, arn: str) -> list[Any]:
    from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterName

    wanted = FlowRunFilter(name=FlowRunFilterName(any_=[arn.rsplit("/", 1)[-1]]))
    return sorted(client.read_flow_runs(flow_run_filter=wanted), key=lambda run: run.created)


def test_missing_deployments_are_named(service: Service, prefect_server: str) -> None:
    dispatcher = Dispatcher(service, job_pools(1), PrefectWatch(service.settings), deployment="nowhere")

    with pytest.raises(
        ConfigurationError, match=r"no deployment PerformSimulationJob/nowhere, .*robomaker deploy --operations"
    ):
        dispatcher.prepare()


def test_several_dispatchers_hand_a_job_over_once(
    service: Service, order: Order, deployments: Any, hand_over: Callable[[], Dispatcher]
) -> None:
    job = call("CreateSimulationJob", order(), service)["arn"]
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [order()]}, service)["arn"]

    for made in (hand_over(), hand_over()):
        made.look()
        assert made.status()["handedOver"] == 2

    (run,) = runs_of(deployments, job)
    assert run.parameters == {"arn": job}
    assert run.state.is_scheduled()
    assert len(runs_of(deployments, batch)) == 1
    service.catalog.claim(job, "a worker", 60)
    made.look()
    assert made.status() == {"state": "ready", "prefect": made.status()["prefect"], "handedOver": 1}


def test_a_run_that_ends_before_its_job_is_followed_by_another_until_the_job_is_given_up(
    service: Service, order: Order, deployments: Any, hand_over: Callable[[], Dispatcher]
) -> None:
    from prefect.states import Crashed

    job = call("CreateSimulationJob", order(), service)["arn"]
    made = hand_over()
    for number in range(1, MOST_RUNS + 1):
        if number == 2:
            made = hand_over()  # one that has just started goes on where the last was
        made.look()
        runs = runs_of(deployments, job)
        assert len(runs) == number
        deployments.set_flow_run_state(runs[-1].id, Crashed(message="the worker is gone"), force=True)
    made.look()

    assert len(runs_of(deployments, job)) == MOST_RUNS
    described = call("DescribeSimulationJob", {"job": job}, service)
    assert (described["status"], described["failureCode"]) == ("Failed", "InternalServiceError")
    assert "Crashed: the worker is gone" in described["failureReason"]


def test_a_run_that_is_cancelled_in_prefect_cancels_its_job(
    service: Service, order: Order, deployments: Any, hand_over: Callable[[], Dispatcher]
) -> None:
    from prefect.states import Cancelled

    job = call("CreateSimulationJob", order(), service)["arn"]
    made = hand_over()
    deployments.set_flow_run_state(runs_of(deployments, job)[0].id, Cancelled(), force=True)
    made.look()

    assert service.catalog.cancel_requested(job)
    assert len(runs_of(deployments, job)) == 2


def test_a_run_without_a_sign_of_life_is_followed_by_another(
    service: Service,
    order: Order,
    deployments: Any,
    hand_over: Callable[..., Dispatcher],
) -> None:
    from prefect.states import Running

    job = call("CreateSimulationJob", order(), service)["arn"]
    made = hand_over(Timing(lease_s=0.1))
    deployments.set_flow_run_state(runs_of(deployments, job)[0].id, Running(), force=True)
    made.look()
    assert len(runs_of(deployments, job)) == 1
    time.sleep(0.3)
    made.look()

    assert len(runs_of(deployments, job)) == 2


# Performing jobs here


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
        assert ended.wait(10)
        time.sleep(0.02)

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
        go_on.wait(10)

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
