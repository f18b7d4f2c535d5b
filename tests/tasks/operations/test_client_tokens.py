"""Calls that are repeated with their token: the same answer, whatever has changed since."""

import copy
import json
from collections.abc import Callable
from typing import Any

import pytest
from helpers.small_flat import BODY, ROLE

from prefect_robomaker.schemas.wire.errors import IdempotentParameterMismatchException, InvalidParameterException
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

COUNT = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}


@pytest.fixture
def world(service: Service) -> str:
    """ARN of a world that is in the catalog only."""
    arn = service.arn("world", "generation-000000000000/world-1")
    service.catalog.create(Resource.new(arn=arn, kind="world", id=arn.split(":world/")[1]), token=None)
    return arn


def mismatched(operation: str, request: dict[str, Any], service: Service) -> None:
    with pytest.raises(IdempotentParameterMismatchException, match="once"):
        call(operation, request, service)


def test_a_template_read_from_a_place_that_is_empty_by_now(service: Service) -> None:
    service.store.ensure_bucket("templates")
    service.store.put_bytes("templates", "flat.json", json.dumps(BODY).encode())
    location = {"s3Bucket": "templates", "s3Key": "flat.json"}
    request = {"name": "flat", "templateLocation": location, "clientRequestToken": "once"}
    first = call("CreateWorldTemplate", request, service)
    service.store.delete("templates", "flat.json")

    assert call("CreateWorldTemplate", request, service) == first
    # The one call with a token that does not declare the error for it.
    with pytest.raises(InvalidParameterException, match="once"):
        call("CreateWorldTemplate", {**request, "name": "other"}, service)


def test_a_generation_job_of_a_template_that_is_gone(service: Service, template: str) -> None:
    request = {"template": template, "worldCount": COUNT, "clientRequestToken": "once"}
    first = call("CreateWorldGenerationJob", request, service)
    seed = service.catalog.get(first["arn"]).document["seed"]
    service.catalog.delete(template)

    assert call("CreateWorldGenerationJob", request, service) == first
    assert service.catalog.get(first["arn"]).document["seed"] == seed
    mismatched("CreateWorldGenerationJob", {**request, "tags": {"other": "1"}}, service)


def test_an_export_job_of_a_world_that_is_gone(service: Service, world: str) -> None:
    location = {"s3Bucket": "exports"}
    request = {"worlds": [world], "outputLocation": location, "iamRole": ROLE, "clientRequestToken": "once"}
    first = call("CreateWorldExportJob", request, service)
    service.catalog.delete(world)

    assert call("CreateWorldExportJob", request, service) == first
    mismatched("CreateWorldExportJob", {**request, "outputLocation": {"s3Bucket": "other"}}, service)


def test_a_simulation_job_whose_status_has_moved_on_and_whose_world_is_gone(
    service: Service, order: Callable[..., dict[str, Any]], world: str
) -> None:
    request = order(clientRequestToken="once")
    request["simulationApplications"][0]["worldConfigs"] = [{"world": world}]
    first = call("CreateSimulationJob", request, service)
    service.catalog.delete(world)
    moved = service.catalog.transition(first["arn"], "prepare")

    again = call("CreateSimulationJob", request, service)

    assert again == {**first, "status": "Preparing", "lastUpdatedAt": moved.updated_at}
    other = copy.deepcopy(request)
    other["maxJobDurationInSeconds"] += 1
    mismatched("CreateSimulationJob", other, service)
    assert len(service.catalog.list("simulation-job").resources) == 1


def test_a_batch(service: Service, order: Callable[..., dict[str, Any]]) -> None:
    request = {"createSimulationJobRequests": [order()], "clientRequestToken": "once"}
    first = call("StartSimulationJobBatch", request, service)

    assert call("StartSimulationJobBatch", request, service) == first
    mismatched("StartSimulationJobBatch", {**request, "createSimulationJobRequests": [order(), order()]}, service)
