"""The tasks that Prefect shows of each flow: read from its API, as its pages do."""

import re
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
from helpers.deployed_robots import deployable, good, living
from helpers.small_flat import ROLE
from prefect import flow

from prefect_robomaker.flows.lookup import find_flow
from prefect_robomaker.tasks.service.service import Service

ShownTasks = Callable[..., tuple[dict[str, Any], dict[str, int]]]


@pytest.fixture
def shown_tasks(service: Service, prefect_server: str) -> ShownTasks:
    """Runs the flow of an operation; returns its answer, and how many runs of which task Prefect's API tells of."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterId
    from prefect.client.schemas.objects import State

    def run(operation: str, expected: int, **members: Any) -> tuple[dict[str, Any], dict[str, int]]:
        with service.activated():
            state: State[Any] = find_flow(operation)(**members, return_state=True)
        assert state.state_details.flow_run_id is not None
        ours = FlowRunFilter(id=FlowRunFilterId(any_=[state.state_details.flow_run_id]))
        deadline = time.monotonic() + 120  # task runs reach the API as events, seconds later
        with get_client(sync_client=True) as client:
            while True:
                names = [re.sub("-[0-9a-f]{3}$", "", run.name) for run in client.read_task_runs(flow_run_filter=ours)]
                if len(names) >= expected or time.monotonic() > deadline:
                    return state.result(), Counter(names)
                time.sleep(0.2)

    return run


def test_a_read_has_no_tasks(shown_tasks: ShownTasks) -> None:
    assert shown_tasks("ListWorlds", 0) == ({"worldSummaries": []}, {})


def test_a_write_is_validated_and_recorded(shown_tasks: ShownTasks) -> None:
    _, tasks = shown_tasks("CreateWorldTemplate", 2, name="flat", templateBody="{}")

    assert tasks == {"validate": 1, "record": 1}


@pytest.mark.usefixtures("known_worlds")
def test_worlds_are_generated_and_uploaded(shown_tasks: ShownTasks, template: str) -> None:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 2}
    job, tasks = shown_tasks("CreateWorldGenerationJob", 6, template=template, worldCount=count, seed=7)

    worlds = job["finishedWorldsSummary"]["succeededWorlds"]
    assert tasks == {"validate": 1, "record": 1, "upload": 2, **dict.fromkeys(worlds, 1)}


@pytest.mark.deep
@pytest.mark.usefixtures("known_worlds")
def test_worlds_are_exported_and_the_archive_is_uploaded(
    shown_tasks: ShownTasks, service: Service, generate: Callable[..., dict[str, Any]]
) -> None:
    worlds = generate()["finishedWorldsSummary"]["succeededWorlds"]
    place = {"s3Bucket": "archives"}
    service.store.ensure_bucket("archives")

    job, tasks = shown_tasks("CreateWorldExportJob", 4, worlds=worlds, outputLocation=place, iamRole=ROLE)

    assert job["status"] == "Completed"
    assert tasks == {"validate": 1, "record": 1, "export": 1, "upload": 1}


@pytest.mark.deep
def test_a_deployment_is_prepared_and_each_wave_is_a_task(shown_tasks: ShownTasks, service: Service) -> None:
    with living(service) as yard:
        for number in range(3):
            yard.robot(f"r{number}", good)
        half = {"concurrentDeploymentPercentage": 67}
        order = yard.fleets.order(yard.arn, deployable(yard.fleets, "X86_64"), deploymentConfig=half)

        job, tasks = shown_tasks("CreateDeploymentJob", 5, **order)
        yard.robot("r3", good)
        sync, sync_tasks = shown_tasks("SyncDeploymentJob", 4, fleet=yard.arn, clientRequestToken="sync")

    assert job["status"] == sync["status"] == "Succeeded"
    assert tasks == {"validate": 1, "record": 1, "prepare": 1, "wave-1-of-2": 1, "wave-2-of-2": 1}
    assert sync_tasks == {"validate": 1, "record": 1, "prepare": 1, "wave-1-of-1": 1}


def test_a_simulation_is_prepared_run_and_uploaded(shown_tasks: ShownTasks, order: Callable[..., Any]) -> None:
    job, tasks = shown_tasks("CreateSimulationJob", 5, **order({"DURATION_S": "0.1"}))

    assert job["status"] == "Completed"
    assert tasks == {"validate": 1, "record": 1, "prepare": 1, "simulate": 1, "upload": 1}


@pytest.mark.slow
def test_subflows_of_a_users_flow_are_named_after_their_jobs(
    service: Service, prefect_server: str, order: Callable[..., Any]
) -> None:
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import (
        FlowRunFilter,
        FlowRunFilterParentFlowRunId,
    )

    create = find_flow("CreateSimulationJob")
    request = order({"DURATION_S": "0.1"})

    @flow(name="night")
    def night() -> list[str]:
        named = create.with_options(flow_run_name="mine")
        return [each(**request)["arn"].rsplit("/", 1)[-1] for each in (create, named)]

    with service.activated():
        state = night(return_state=True)
    first, _ = state.result()

    assert state.state_details.flow_run_id is not None
    parent = FlowRunFilterParentFlowRunId(any_=[state.state_details.flow_run_id])
    with get_client(sync_client=True) as client:
        runs = client.read_flow_runs(flow_run_filter=FlowRunFilter(parent_flow_run_id=parent))
    assert {run.name for run in runs} == {first, "mine"}


def test_a_batch_has_one_task_for_each_request(shown_tasks: ShownTasks, order: Callable[..., Any]) -> None:
    request = {name: value for name, value in order({"DURATION_S": "0.1"}).items() if name != "iamRole"}

    batch, tasks = shown_tasks("StartSimulationJobBatch", 4, createSimulationJobRequests=[request, request])

    assert batch["status"] == "Completed"
    assert tasks == {"validate": 1, "record": 1, "request-0": 1, "request-1": 1}
