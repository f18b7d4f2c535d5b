"""A service of its own for each test, and a template small enough to be quick."""

import json
from collections.abc import Callable
from typing import Any

import pytest
from small_flat import BODY

from prefect_robomaker.flows.operation import call, registry
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.service import Service


@pytest.fixture
def service(settings: Settings) -> Service:
    """An empty service."""
    return Service.open(settings, {})


@pytest.fixture
def template(service: Service) -> str:
    """ARN of a template with two rooms."""
    request = {"name": "two rooms", "templateBody": json.dumps(BODY)}
    return call("CreateWorldTemplate", request, service)["arn"]


@pytest.fixture
def generate(service: Service, template: str, prefect_server: str) -> Callable[..., dict[str, Any]]:
    """Generates worlds and returns the job's final description."""

    def run(floorplans: int = 1, interiors: int = 1, **members: Any) -> dict[str, Any]:
        count = {"floorplanCount": floorplans, "interiorCountPerFloorplan": interiors}
        job = call(
            "CreateWorldGenerationJob", {"template": template, "worldCount": count, "seed": 7, **members}, service
        )
        return registry()["CreateWorldGenerationJob"].perform(job["arn"], service)

    return run
