"""How runs end in Prefect: read from its API, as automations see them."""

import json
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from uuid import UUID

import pytest
from helpers.processes import wait_for
from helpers.small_flat import ROLE

from prefect_robomaker.flows.lookup import find_flow, find_perform_flow, perform
from prefect_robomaker.flows.pipelines import run_spec
from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobBatchDocument, SimulationJobDocument
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.execution.flow_ends import RunNotSucceeded, answer_of
from prefect_robomaker.tasks.execution.prefect_settings import on_same_server
from prefect_robomaker.tasks.nights.wanted_runs import WantedRun
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]
QUICK, PATIENT = ({"kind": "time_limit", "name": name, "limit_s": s} for name, s in (("quick", 0.1), ("patient", 100)))
LAUNCH = {"packageName": "swinger", "launchFile": "make_environment"}


@pytest.fixture
def run_flow(service: Service, state_of: Callable[..., Any]) -> Callable[..., tuple[Any, Any]]:
    """Runs a flow; returns the state it returned and the one that the server has."""

    def run(operation: str, on: Service = service, **members: Any) -> tuple[Any, Any]:
        with on.activated():
            state = find_flow(operation)(**members, return_state=True)
        return state, state_of(UUID(str(state.state_details.flow_run_id)))

    return run


@pytest.fixture
def judged(swing: Any) -> Order:
    """Makes the request of a job of a pendulum, judged by a requirement; it ends by itself after 0.5 s."""

    def make(requirement: dict[str, Any], **variables: str) -> dict[str, Any]:
        variables = {"TIME_LIMIT_S": "0.5", **variables}
        return {
            "maxJobDurationInSeconds": 60,
            "iamRole": ROLE,
            "simulationApplications": [
                {"application": "swing", "launchConfig": {**LAUNCH, "environmentVariables": variables}}
            ],
            "robotApplications": [{"application": "pusher", "launchConfig": {**LAUNCH, "launchFile": "make_agent"}}],
            "requirements": [requirement],
        }

    return make


def test_a_failed_verdict_fails_the_run_and_not_the_job(run_flow: Any, service: Service, judged: Order) -> None:
    request = judged(QUICK)

    state, seen = run_flow("CreateSimulationJob", **request)

    assert (seen.type.value, seen.name) == ("FAILED", "Failed")
    answer, result = answer_of(state)
    job = service.catalog.get(answer["arn"])
    assert answer["status"] == job.status == "Completed"
    document = SimulationJobDocument.of(job)
    assert document.verdict == "FAIL"
    assert document.verdict_reason is not None
    assert document.verdict_reason.startswith("quick: ")
    assert (result.state, result.verdicts, result.counts) == ("failed", {job.id: "FAIL"}, {"failed": 1})
    assert seen.message == result.message
    assert f"failed: 0 of 1 job passed. pusher ({job.id}): FAIL: quick: " in seen.message
    assert seen.message.endswith(f". Look: robomaker repro {job.id}")
    with service.activated(), pytest.raises(RunNotSucceeded, match=r"failed: 0 of 1 job passed"):
        find_perform_flow("CreateSimulationJob")(job.arn)


def test_a_setting_lets_runs_with_failed_verdicts_complete(run_flow: Any, service: Service, judged: Order) -> None:
    lenient = replace(service, settings=service.settings.model_copy(update={"verdict_fails_run": False}))
    state, seen = run_flow("CreateSimulationJob", lenient, **judged(QUICK))

    assert seen.type.value == "COMPLETED"
    assert "FAIL" in seen.message
    answer, result = answer_of(state)
    assert (answer["status"], result.state) == ("Completed", "failed")
    assert state.result()["result"]["verdicts"] == result.verdicts


def test_a_batch_tells_its_verdicts_the_worst_first(run_flow: Any, service: Service, judged: Order) -> None:
    of_batch = [judged(PATIENT), judged(QUICK), {**judged(QUICK), "robotApplications": NOBODY}]
    for request in of_batch:
        request.pop("iamRole")

    state, seen = run_flow("StartSimulationJobBatch", createSimulationJobRequests=of_batch)

    assert seen.type.value == "FAILED"
    answer, result = answer_of(state)
    assert answer["status"] == "Completed"
    assert result.state == "broken"
    assert sorted(result.verdicts.values()) == ["FAIL", "PASS"]
    assert result.counts == {"passed": 1, "failed": 1, "broken": 1}
    assert seen.message.startswith("broken: 1 of 3 jobs passed, 1 broke. request 3: ResourceNotFound: ")
    assert "FAIL: quick" in seen.message
    batch = service.catalog.get(answer["arn"])
    assert SimulationJobBatchDocument.of(batch).verdicts == {"PASS": 1, "FAIL": 1}


NOBODY = [
    {
        "application": "arn:aws:robomaker:us-east-1:000000000000:robot-application/no-such-robot/1542931200000",
        "launchConfig": {"packageName": "a", "launchFile": "b"},
    }
]


def test_a_batch_that_times_out_ends_as_timed_out(run_flow: Any, order: Order) -> None:
    request = order({"DURATION_S": "100"})
    request.pop("iamRole")
    policy = {"timeoutInSeconds": 2, "maxConcurrency": 1}

    state, seen = run_flow("StartSimulationJobBatch", createSimulationJobRequests=[request], batchPolicy=policy)

    assert (seen.type.value, seen.name) == ("FAILED", "TimedOut")
    assert answer_of(state)[0]["status"] == "TimedOut"
    assert seen.message.startswith("timed out")


def test_a_cancelled_job_ends_as_cancelled_without_a_verdict(
    service: Service, judged: Order, prefect_server: str, state_of: Any, flow_run: Any
) -> None:
    request = judged(PATIENT, SLEEP_S="1", TIME_LIMIT_S="1000")
    job = call("CreateSimulationJob", request, service)["arn"]
    answers: list[Any] = []

    def run() -> None:
        with service.activated():
            answers.append(perform("CreateSimulationJob", job))

    thread = threading.Thread(target=on_same_server(run))
    thread.start()
    wait_for(lambda: service.catalog.get(job).status == "Running", "the job to run")
    call("CancelSimulationJob", {"job": job}, service)
    thread.join(200)

    seen = state_of(flow_run(job.rpartition("/")[2]).id)
    assert (seen.type.value, seen.name) == ("CANCELLED", "Cancelled")
    ((answer, result),) = answers
    assert (answer["status"], result.state, result.verdicts) == ("Canceled", "canceled", {})
    stored = service.catalog.get(job)
    assert SimulationJobDocument.of(stored).verdict is None
    assert result_json(service, stored)["verdict"] == "NONE"


def result_json(service: Service, job: Resource) -> dict[str, Any]:
    place = job.document["outputs"]
    return json.loads(service.store.get_bytes(place["bucket"], f"{place['prefix']}/result.json"))


def test_a_specification_returns_verdicts_counts_and_report(
    service: Service, judged: Order, prefect_server: str, state_of: Any, flow_run: Any
) -> None:
    request = judged(QUICK)
    steps = {"drive": {"operation": "CreateSimulationJob", "input": request}}
    checked = load_spec(json.dumps({"version": 1, "name": "states", "steps": steps}), "states.yaml")
    name = f"{service.settings.home.parent.name}/states.yaml"

    record = run_spec(WantedRun(checked, name), service.settings, lambda event: None)

    seen = state_of(flow_run(name).id)
    assert (record.state, seen.type.value) == ("failed", "FAILED")
    assert f"Look: robomaker report {record.run_id} --open. Report: {record.report_path}" in seen.message
    assert "FAIL: quick" in seen.message
