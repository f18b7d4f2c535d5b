"""What only steps of specifications call: variations of worlds."""

import pytest
from helpers.small_flat import BODY

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.worlds.step_operations import VaryWorldsRequest, VaryWorldsResponse
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.operations.step_operations import step_registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for
from prefect_robomaker.tasks.worlds.keeping import keep_world


@pytest.fixture
def world(service: Service) -> str:
    """ARN of a stored world."""
    made = generate_world(WorldTemplateBody.model_validate(BODY), *seeds_for(7, 0, 0), settle=False)
    return keep_world(made, "import", {}, service).arn


def varied(service: Service, world: str, *variations: dict[str, str]) -> list[str]:
    request = VaryWorldsRequest.model_validate({"worlds": [world], "variations": list(variations)})
    answer = step_registry()["VaryWorlds"].handler(request, service)
    assert isinstance(answer, VaryWorldsResponse)
    return answer.worlds


def test_a_step_that_is_asked_for_again_makes_nothing_twice(service: Service, world: str) -> None:
    night, evening = {"light": "night"}, {"light": "evening"}
    first = varied(service, world, night, evening)

    assert varied(service, world, evening, night) == first[::-1]
    assert len(call("ListWorlds", {}, service)["worldSummaries"]) == 3

    call("BatchDeleteWorlds", {"worlds": [first[0]]}, service)
    again = varied(service, world, night, evening)
    assert again[1] == first[1]
    assert again[0] not in first
