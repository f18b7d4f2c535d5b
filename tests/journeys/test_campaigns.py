"""Campaigns: steps of several batches, of each of which Prefect has one task run for all jobs."""

import copy
import json
from collections.abc import Callable
from typing import Any

import pytest
from helpers.batch_task_runs import task_runs

from prefect_robomaker.flows.pipelines import run_spec
from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobBatchDocument
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs import batch_splitting
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.tasks.nights.wanted_runs import WantedRun
from prefect_robomaker.tasks.service.service import Service

NOBODY = "arn:aws:robomaker:us-east-1:000000000000:robot-application/no-such-robot/1542931200000"


def run(requests: list[dict[str, Any]], settings: Settings) -> RunRecord:
    """Runs a step with these job requests."""
    asked = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": 2}}
    steps = {"drive": {"operation": "StartSimulationJobBatch", "input": asked}}
    checked = load_spec(json.dumps({"version": 1, "name": "many", "steps": steps}), "many.yaml")
    return run_spec(WantedRun(checked, "many.yaml"), settings, lambda _: None)


@pytest.mark.deep
def test_a_batch_of_a_campaign_has_one_task_run_for_those_that_ran_and_says_how_all_went(
    settings: Settings,
    service: Service,
    order: Callable[..., dict[str, Any]],
    prefect_server: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(batch_splitting, "MOST_REQUESTS", 3)
    quick, crashes = order({"DURATION_S": "0.1"}), order({"FAIL_AT_STEP": "2"})
    del quick["iamRole"], crashes["iamRole"]
    refused = copy.deepcopy(quick)
    refused["robotApplications"][0]["application"] = NOBODY

    record = run([quick, crashes, refused, quick], settings)

    assert [step.name for step in record.steps] == ["drive_1_of_2", "drive_2_of_2"]
    batches = [step.arn or "" for step in record.steps]
    shown = [[(each.name, each.state and each.state.message) for each in task_runs(batch)] for batch in batches]
    assert shown == [
        [("simulate-request x 2", "3 jobs: 2 broken, 1 no verdict")],
        [("simulate-request x 1", "1 job: 1 no verdict")],
    ]
    documents = [SimulationJobBatchDocument.of(service.catalog.get(batch)) for batch in batches]
    assert [document.in_campaign for document in documents] == [True, True], "also where another process carries it on"


def test_a_batch_that_is_a_whole_step_has_a_task_run_for_each_job(
    settings: Settings, order: Callable[..., dict[str, Any]], prefect_server: str
) -> None:
    request = order({"DURATION_S": "0.1"})
    del request["iamRole"]

    (step,) = run([request, request], settings).steps

    assert sorted(each.name for each in task_runs(step.arn or "")) == ["request-0", "request-1"]
