"""Batches on a Prefect work pool: real Prefect workers with homes of their own, killed, added and cancelled."""

import contextvars
import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.endpoint_process import Serve
from helpers.pool_machines import Pool, cancel_in_prefect, deployed_pool
from helpers.postgres_server import PROGRAMS
from helpers.processes import alive, wait_for, working_below

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.backends import pool_runs
from prefect_robomaker.tasks.backends.backend import open_backend
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]
pytestmark = pytest.mark.timeout(900)


@pytest.fixture
def settings(tmp_path: Path, request: pytest.FixtureRequest) -> Settings:
    """Of a service whose catalog is on PostgreSQL, as that of several machines has to be."""
    variables = {"ROBOMAKER_HOME": str(tmp_path / "home"), "ROBOMAKER_MAX_JOBS": "2"}
    if PROGRAMS is not None:
        variables["ROBOMAKER_CATALOG_URL"] = request.getfixturevalue("postgres_database")
    return Settings.from_environment(variables)


@pytest.fixture
def pool(service: Service, prefect_server: str, tmp_path: Path) -> Iterator[Pool]:
    """A pool without machines; those that a test starts have one slot each."""
    yield deployed_pool(service.settings, prefect_server, tmp_path)
    service.catalog.close()


class Batch:
    """A batch that is carried out in a thread of the test, with a pool's job workers."""

    def __init__(self, service: Service, pool: Pool, requests: list[dict[str, Any]], concurrency: int = 2) -> None:
        request = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": concurrency}}
        self.service = service
        self.arn: str = call("StartSimulationJobBatch", request, service)["arn"]
        self._answer: dict[str, Any] = {}
        self._error: BaseException | None = None
        there = replace(service, backend=open_backend(f"workers:{pool.name}"))
        work = contextvars.copy_context()
        self._thread = threading.Thread(target=work.run, args=(self._carry_out, there))
        self._thread.start()

    def _carry_out(self, service: Service) -> None:
        try:
            self._answer = registry()["StartSimulationJobBatch"].perform(self.arn, service)
        except BaseException as error:
            self._error = error

    def result(self, timeout_s: float = 400.0) -> dict[str, Any]:
        """Waits for its end; returns its description."""
        self._thread.join(timeout_s)
        assert not self._thread.is_alive(), "the batch has not ended"
        if self._error is not None:
            raise self._error
        return self._answer


def ran(runs: list[Any]) -> list[int]:
    """How many jobs each job worker that came to its end says it ran."""
    return [int(re.match(r"ran (\d+) jobs?", run.state.message)[1]) for run in runs if run.state.is_completed()]  # type: ignore[index]


@pytest.mark.endurance
def test_jobs_of_a_batch_run_on_both_machines_and_nothing_stays_behind(
    service: Service, order: Order, pool: Pool
) -> None:
    with pool.machine("first"), pool.machine("second"):
        batch = Batch(service, pool, [order({"DURATION_S": "2"}) for _ in range(12)])
        answer = batch.result()
        runs = pool.ended(batch.arn)

    assert answer["status"] == "Completed"
    assert [job["status"] for job in answer["createdRequests"]] == ["Completed"] * 12
    assert [run.state.type.value for run in runs] == ["COMPLETED"] * 2
    assert sum(ran(runs)) == 12
    assert all(ran(runs))


@pytest.mark.deep
def test_jobs_of_job_workers_that_are_cancelled_killed_or_orphaned_run_elsewhere(
    service: Service, order: Order, pool: Pool
) -> None:
    """One batch sees it all: each job worker that ends has its jobs carried out by those that are left."""
    jobs = [order({"DURATION_S": "20"}) for _ in range(4)]
    with pool.machine("first") as first, pool.machine("second") as second, pool.machine("third") as third:
        batch = Batch(service, pool, jobs, concurrency=3)
        runs = pool.running(batch.arn, 3)
        for machine in (first, second, third):
            wait_for(lambda home=machine.home: working_below(home), f"a simulation below {machine.home}", 240)
        orphan = second.flow_process()
        assert orphan is not None
        first.kill()  # as a power cut would
        second.process.kill()  # the Prefect worker alone
        wait_for(lambda: not alive({orphan}), "the end of the orphan", 120)
        wait_for(lambda: not working_below(second.home), "the end of its simulation", 120)

        process = third.flow_process()
        assert process is not None
        (lonely,) = [run for run in runs if str(run.id).encode() in Path(f"/proc/{process}/environ").read_bytes()]
        cancel_in_prefect(lonely.id)
        wait_for(lambda: not alive({process}), "the end of the cancelled one")
        answer = batch.result()
        ended = {run.id: run.state for run in pool.ended(batch.arn)}

    assert [job["status"] for job in answer["createdRequests"]] == ["Completed"] * 4
    assert (ended[lonely.id].type.value, ended[lonely.id].name) == ("CANCELLED", "Cancelled")
    crashed = [state for state in ended.values() if state.is_crashed()]
    assert len(crashed) == 2, "the one without power, and the orphan"
    assert [state.message.startswith("its Prefect worker has died") for state in crashed].count(True) == 1
    assert [state for state in ended.values() if state.is_completed()], "a later one on the third machine"


@pytest.mark.endurance  # tests/tasks/backends/test_work_pools.py follows who comes, and cancels
def test_a_machine_that_comes_later_takes_jobs_and_a_batch_that_is_cancelled_ends_all(
    service: Service, order: Order, pool: Pool
) -> None:
    with pool.machine("first") as first:
        batch = Batch(service, pool, [order({"DURATION_S": "600"}, maxJobDurationInSeconds=600) for _ in range(6)])
        wait_for(lambda: working_below(first.home), "a simulation on the first machine", 240)
        with pool.machine("second") as second:
            wait_for(lambda: working_below(second.home), "a simulation on the second machine", 240)
            pool.running(batch.arn, 2)
            call("CancelSimulationJobBatch", {"batch": batch.arn}, service)
            answer = batch.result()
            runs = pool.ended(batch.arn)

            assert answer["status"] == "Canceled"
            assert {job["status"] for job in answer["createdRequests"]} == {"Canceled"}
            assert [run.state.type.value for run in runs] == ["COMPLETED"] * 2
            assert not working_below(first.home) | working_below(second.home)


@pytest.mark.endurance  # tests/flows/test_pool_job_workers.py has its state, test_work_pools.py of tasks the end
def test_a_machine_with_another_catalog_is_told_from_the_batch(
    service: Service, order: Order, pool: Pool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # How many it takes is counted in tests/tasks/backends/test_work_pools.py.
    monkeypatch.setattr(pool_runs, "_MOST_MISCONFIGURED", 1)
    other = f"sqlite:///{pool.folder}/other.db"
    with pool.machine("first", ROBOMAKER_CATALOG_URL=other):
        batch = Batch(service, pool, [order()])
        answer = batch.result()
        runs = pool.ended(batch.arn)

    assert answer["status"] == "Failed"
    assert f"the catalog of this machine, {other}, does not have" in answer["failureReason"]
    assert {run.state.name for run in runs} == {"Misconfigured"}


@pytest.mark.endurance  # test_a_laptop_becomes_two.py has the setting, which `Service.open` reads for all
def test_a_batch_that_an_sdk_asks_for_runs_on_the_pool_by_its_setting(
    service: Service, order: Order, pool: Pool, serve: Serve
) -> None:
    """A specification does so in test_a_laptop_becomes_two.py."""
    there = {**pool.variables, "ROBOMAKER_BACKEND": f"workers:{pool.name}"}
    with pool.machine("first"), serve(**there) as served:
        batch = served.call("StartSimulationJobBatch", {"createSimulationJobRequests": [order(), order()]})["arn"]
        wait_for(
            lambda: served.call("DescribeSimulationJobBatch", {"batch": batch})["status"] == "Completed",
            "the end of the batch",
        )
        runs = pool.ended(batch)

    assert ran(runs) == [2]
    assert f"workers:{pool.name}" == served.facts["backend"]
