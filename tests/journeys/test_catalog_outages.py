"""A catalog that is away while a batch or a specification runs: that costs time, and none of the requests."""

import contextvars
import json
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from helpers.postgres_server import NEEDS_POSTGRESQL, PostgresServer
from helpers.processes import started, wait_for

from prefect_robomaker.flows.pipelines import run_spec
from prefect_robomaker.schemas.reports.progress import ProgressEvent, StepEnded
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException
from prefect_robomaker.tasks.nights.wanted_runs import WantedRun
from prefect_robomaker.tasks.operations.registry import Operation, call, registry
from prefect_robomaker.tasks.service.service import Service, Timing

pytestmark = [NEEDS_POSTGRESQL, pytest.mark.slow]
Order = Callable[..., dict[str, Any]]
ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
KIND = "simulation-job"


@pytest.fixture
def environ(postgres_database: str, tmp_path: Path, request: pytest.FixtureRequest) -> dict[str, str]:
    return {
        "ROBOMAKER_HOME": str(tmp_path / "home"),
        "ROBOMAKER_CATALOG_URL": postgres_database,
        "ROBOMAKER_BACKEND": getattr(request, "param", "local"),
        "ROBOMAKER_MAX_JOBS": "1",
    }


@pytest.fixture
def service(environ: dict[str, str]) -> Iterator[Service]:
    opened = Service.open(Settings.from_environment(environ))
    yield replace(opened, timing=Timing(after_outage_s=0.1))
    opened.catalog.close()


@pytest.mark.deep
@pytest.mark.parametrize("environ", ["local", "by-hand"], indirect=True)
def test_a_batch_goes_on_when_its_catalog_is_back(
    service: Service, environ: dict[str, str], order: Order, postgres_server: PostgresServer, prefect_server: str
) -> None:
    requests = [order({"DURATION_S": "1.5"}) for _ in range(3)]
    ordered = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": 1}}
    batch = call("StartSimulationJobBatch", ordered, service)["arn"]
    catalog, failures = service.catalog, []

    def perform() -> None:
        try:
            registry()["StartSimulationJobBatch"].perform(batch, service)
        except Exception as error:
            failures.append(error)

    with ExitStack() as stack:
        if environ["ROBOMAKER_BACKEND"] == "by-hand":
            stack.enter_context(started([*ROBOMAKER, "work", batch], {**environ, "PREFECT_API_URL": prefect_server}))
        runs = threading.Thread(target=contextvars.copy_context().run, args=(perform,), daemon=True)
        runs.start()
        wait_for(lambda: catalog.count_children(batch, KIND).get("Running"), "a job to run")
        postgres_server.kill()
        try:
            runs.join(4.0)  # the first job has ended meanwhile, and the next waits
        finally:
            postgres_server.start()
        runs.join(120.0)

    assert not failures
    assert catalog.get(batch).status == "Completed"
    assert catalog.count_children(batch, KIND) == {"Completed": 3}


@pytest.mark.deep
@pytest.mark.parametrize("environ", ["local"], indirect=True)
def test_a_batch_that_is_cancelled_just_before_its_catalog_is_away_is_cancelled(
    service: Service, order: Order, postgres_server: PostgresServer, prefect_server: str
) -> None:
    """Neither does the outage end it as something else, nor does a job that runs go on for its 200 seconds."""
    ordered = {"createSimulationJobRequests": [order({"DURATION_S": "200", "VERDICT": "PASS"}) for _ in range(2)]}
    batch = call("StartSimulationJobBatch", ordered, service)["arn"]
    catalog, failures = service.catalog, []

    def perform() -> None:
        try:
            registry()["StartSimulationJobBatch"].perform(batch, service)
        except Exception as error:
            failures.append(error)

    runs = threading.Thread(target=contextvars.copy_context().run, args=(perform,), daemon=True)
    runs.start()
    wait_for(lambda: catalog.count_children(batch, KIND).get("Running"), "a job to run")
    catalog.request_cancel(batch)
    postgres_server.kill()
    try:
        runs.join(4.0)
    finally:
        postgres_server.start()
    runs.join(150.0)

    assert not runs.is_alive()
    assert not failures
    assert catalog.get(batch).status == "Canceled"
    [job] = catalog.children(batch, kind=KIND)
    assert (job.status, job.document["failureCode"]) == ("Canceled", "BatchCanceled")
    assert job.document.get("verdict") is None


@pytest.mark.deep
@pytest.mark.parametrize("step", ["first", "second"])
def test_a_run_goes_on_when_its_catalog_was_away_after_a_step(
    service: Service, order: Order, postgres_server: PostgresServer, prefect_server: str, step: str
) -> None:
    """After the last step it is the report that has to wait."""
    drive = {"operation": "CreateSimulationJob", "input": order({"DURATION_S": "0.2"})}
    steps = {"first": drive, "second": drive}
    starts: list[threading.Timer] = []

    def take_catalog_away(event: ProgressEvent) -> None:
        if isinstance(event, StepEnded) and event.step == step and not starts:
            postgres_server.kill()
            starts.append(threading.Timer(3.0, postgres_server.start))
            starts[0].start()

    checked = load_spec(json.dumps({"version": 1, "name": "Night", "steps": steps}), "night.yaml")
    record = run_spec(WantedRun(checked, "night.yaml"), service.settings, take_catalog_away)
    starts[0].join()

    assert {ended.name: (ended.status, ended.error) for ended in record.steps} == dict.fromkeys(
        steps, ("Completed", None)
    )
    assert len(record.jobs) == 2
    assert record.report_path
    assert len(service.catalog.list(KIND).resources) == 2


@pytest.mark.deep
def test_a_step_that_is_repeated_after_an_outage_is_done_once(
    service: Service, order: Order, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer, answers = Operation.answer, count()

    def lost_at_first(*arguments: Any) -> dict[str, Any]:
        answered = answer(*arguments)
        if next(answers) == 0:  # the answer comes too late: the server dies after it has stored the job
            raise ServiceUnavailableException("the catalog does not answer")
        return answered

    monkeypatch.setattr(Operation, "answer", lost_at_first)
    steps = {"drive": {"operation": "CreateSimulationJob", "input": order({"DURATION_S": "0.2"})}}
    checked = load_spec(json.dumps({"version": 1, "name": "Night", "steps": steps}), "night.yaml")
    record = run_spec(WantedRun(checked, "night.yaml"), service.settings, lambda _: None)

    assert [job.status for job in record.jobs] == ["Completed"]
    assert [job.arn for job in service.catalog.list(KIND).resources] == [record.jobs[0].arn]


@pytest.mark.deep
@pytest.mark.parametrize("environ", ["by-hand"], indirect=True)
def test_a_job_worker_that_starts_while_the_catalog_is_away_waits_for_it(
    service: Service, environ: dict[str, str], order: Order, postgres_server: PostgresServer, tmp_path: Path
) -> None:
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [order()]}, service)["arn"]
    call("CancelSimulationJobBatch", {"batch": batch}, service)
    log = tmp_path / "work.log"
    postgres_server.stop()
    try:
        with log.open("w") as output, started([*ROBOMAKER, "work", batch], environ, stderr=output) as worker:
            wait_for(lambda: "waits for the catalog" in log.read_text(), "a line that says so")
            postgres_server.start()
            assert worker.wait(200) == 0, log.read_text()
    finally:
        postgres_server.start()
    assert "the catalog answers" in log.read_text()
    assert "ran 0 jobs" in log.read_text()
