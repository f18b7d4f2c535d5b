"""What DescribeWorld tells of worlds, and templates that become version 2."""

import json
from collections.abc import Callable
from typing import Any

import pytest
from helpers.small_flat import BODY

from prefect_robomaker.schemas.wire.errors import InternalServerException, InvalidParameterException
from prefect_robomaker.schemas.worlds.description import WorldDescription
from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

pytestmark = pytest.mark.usefixtures("known_worlds")

Generate = Callable[..., dict[str, Any]]


def version_2(percent: Any = 40) -> dict[str, Any]:
    body = json.loads(json.dumps(BODY)) | {"Version": "2"}
    door = {"InitialState": {"OpenPosition": {"Percent": percent}}}
    sets = [{"Name": "every door", "TargetSet": "Target.All", "Door": door}]
    body["Buildings"][0]["Floors"][0]["Interior"] = {"Doorways": {"DoorwaySets": sets}}
    body["Buildings"][0]["Floors"][0]["Floorplan"]["Rooms"][1]["OriginalName"] = "Schlafzimmer"
    body["Buildings"][0]["Floors"][0]["Floorplan"]["DesiredConnections"] = [
        {"Location": ["living room", "bedroom"], "ConnectionType": "Doorway"}
    ]
    return body


def stored_description(service: Service) -> bytes:
    (key,) = (info.key for info in service.store.list("robomaker", "worlds/") if info.key.endswith("description.json"))
    return service.store.get_bytes("robomaker", key)


def test_a_world_of_version_2_is_described_with_its_doors(service: Service, template: str, generate: Generate) -> None:
    assert call("DescribeWorldTemplate", {"template": template}, service)["version"] == "1"
    call("UpdateWorldTemplate", {"template": template, "templateBody": json.dumps(version_2())}, service)
    assert call("DescribeWorldTemplate", {"template": template}, service)["version"] == "2"

    (arn,) = generate()["finishedWorldsSummary"]["succeededWorlds"]
    body = call("DescribeWorld", {"world": arn}, service)["worldDescriptionBody"]

    description = WorldDescription.model_validate_json(body)
    assert json.loads(body) == {**json.loads(stored_description(service)), "contentHash": description.contentHash}
    (door,) = description.doors
    assert set(door.rooms) == {"living room", "bedroom"}
    assert door.initialOpening.percent == 40
    assert door.opensInto in door.rooms
    assert door.clearWidth >= 0.8
    assert [room.originalName for room in description.rooms] == [None, "Schlafzimmer"]
    (key,) = (info.key for info in service.store.list("robomaker", "worlds/") if info.key.endswith("world.json"))
    world = World.model_validate_json(service.store.get_bytes("robomaker", key))
    assert [item.name for item in description.furniture] == [item.id for item in world.furniture]


def test_every_world_tells_what_was_proven_of_it(service: Service, generate: Generate) -> None:
    (arn,) = generate()["finishedWorldsSummary"]["succeededWorlds"]
    described = WorldDescription.model_validate_json(
        call("DescribeWorld", {"world": arn}, service)["worldDescriptionBody"]
    )
    assert described.templateVersion == "1"
    (key,) = (info.key for info in service.store.list("robomaker", "worlds/") if info.key.endswith("world.json"))
    world = World.model_validate_json(service.store.get_bytes("robomaker", key))
    assert described.contentHash == key.split("/")[1]
    assert described.seeds is not None
    assert (described.seeds.floorplan, described.seeds.interior) == (world.floorplan_seed, world.interior_seed)
    assert described.proofs is not None
    assert (described.proofs.guaranteesHold, described.proofs.violations) == (True, [])
    assert described.proofs.checks == world.checks
    assert described.proofs.wishes == [*world.floorplan.wishes, *world.wishes]
    assert described.proofs.wishes


def test_a_lost_description_is_told(service: Service, template: str, generate: Generate) -> None:
    call("UpdateWorldTemplate", {"template": template, "templateBody": json.dumps(version_2())}, service)
    (arn,) = generate()["finishedWorldsSummary"]["succeededWorlds"]
    for info in list(service.store.list("robomaker", "worlds/")):
        service.store.delete("robomaker", info.key)
    with pytest.raises(InternalServerException, match=r"the description of .* cannot be read"):
        call("DescribeWorld", {"world": arn}, service)


def test_a_wrong_door_is_refused_before_anything_is_stored(service: Service, template: str) -> None:
    with pytest.raises(InvalidParameterException, match=r'OpenPosition\.Percent: 140: a number from 0 to 100, or "Ran'):
        call("UpdateWorldTemplate", {"template": template, "templateBody": json.dumps(version_2(140))}, service)
    assert call("DescribeWorldTemplate", {"template": template}, service)["version"] == "1"
