"""Refusing what the service refused in its last years, where the setting asks for it."""

import json

import pytest

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError, InvalidParameterException
from prefect_robomaker.schemas.worlds.world import ROOM_TYPES, SERVICE_ROOM_TYPES
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

ROLE = "arn:aws:iam::000000000000:role/any"


@pytest.fixture
def strict(settings: Settings) -> Service:
    return Service.open(settings.model_copy(update={"refuse_deprecated": True}), {})


def test_a_request_of_the_early_years_is_refused_and_every_member_named(strict: Service) -> None:
    config = {"application": "indoor-navigation", "launchConfig": {}, "useDefaultTools": True}
    request = {"maxJobDurationInSeconds": 60, "iamRole": ROLE, "simulationApplications": [config]}
    logging = {"loggingConfig": {"recordAllRosTopics": True}}

    with pytest.raises(InvalidParameterException) as caught:
        call("CreateSimulationJob", {**request, **logging}, strict)

    assert "simulationApplications[0].useDefaultTools: " in str(caught.value)
    assert "loggingConfig.recordAllRosTopics: " in str(caught.value)
    assert strict.catalog.list("simulation-job").resources == ()


def test_what_the_service_took_to_the_end_is_taken(strict: Service) -> None:
    config = {"application": "indoor-navigation", "launchConfig": {}}
    request = {"maxJobDurationInSeconds": 60, "iamRole": ROLE, "simulationApplications": [config]}

    assert call("CreateSimulationJob", request, strict)["status"] == "Pending"
    assert call("CreateWorldTemplate", {"templateBody": json.dumps({})}, strict)["arn"]


def small_room(**members: object) -> dict[str, object]:
    shape = {"Area": 9.5, "AspectRatio": {}}
    return {"Name": "Bath", "Type": "Bathroom", "DesiredShape": shape, **members}


def test_templates_that_the_service_never_took_are_refused_and_every_extension_named(strict: Service) -> None:
    loose = {"Name": "all", "TargetSet": {"RoomNames": ["Bath"]}, "LooseObjects": 3}
    interior = {"Furniture": {"FurnitureArrangements": [loose]}}
    floor = {"Floorplan": {"Rooms": [small_room()]}, "Interior": interior}
    body = {"templateBody": json.dumps({"Buildings": [{"Floors": [floor]}]})}

    with pytest.raises(InvalidParameterException) as caught:
        call("CreateWorldTemplate", body, strict)

    place = "Buildings[0].Floors[0]"
    assert f"{place}.Floorplan.Rooms[0].DesiredShape.Area: 9.5 m2; the service took 10 or more" in str(caught.value)
    assert f"{place}.Interior.Furniture.FurnitureArrangements[0].LooseObjects: 3; " in str(caught.value)
    assert "ROBOMAKER_REFUSE_DEPRECATED" in str(caught.value)
    assert strict.catalog.list("world-template").resources == ()
    template = call("CreateWorldTemplate", {"templateBody": "{}"}, strict)["arn"]
    with pytest.raises(InvalidParameterException, match=r"9\.5 m2"):
        call("UpdateWorldTemplate", {"template": template, **body}, strict)
    assert json.loads(call("GetWorldTemplateBody", {"template": template}, strict)["templateBody"]) == {}


def test_templates_with_more_rooms_than_the_service_took_are_refused(strict: Service) -> None:
    many = [{"Name": f"Room {number}", "Type": "Bedroom"} for number in range(7)]
    floors = [{"Floorplan": {"Rooms": many}}]

    with pytest.raises(InvalidParameterException, match="Rooms: 7 rooms; the service took 6 at most"):
        call("CreateWorldTemplate", {"templateBody": json.dumps({"Buildings": [{"Floors": floors}]})}, strict)


@pytest.mark.parametrize("kind", [kind for kind in ROOM_TYPES if kind not in SERVICE_ROOM_TYPES])
def test_templates_with_types_of_rooms_that_the_service_did_not_have_are_refused(kind: str, strict: Service) -> None:
    floors = [{"Floorplan": {"Rooms": [{"Name": "It", "Type": kind}, {"Name": "Living", "Type": "Living"}]}}]

    with pytest.raises(InvalidParameterException, match=rf"Rooms\[0\]\.Type: {kind}; the service had Bedroom, "):
        call("CreateWorldTemplate", {"templateBody": json.dumps({"Buildings": [{"Floors": floors}]})}, strict)


def test_small_rooms_are_taken_by_default(service: Service) -> None:
    body = {"Buildings": [{"Floors": [{"Floorplan": {"Rooms": [small_room()]}}]}]}

    assert call("CreateWorldTemplate", {"templateBody": json.dumps(body)}, service)["arn"]


def test_nothing_is_refused_by_default(service: Service) -> None:
    config = {"application": "indoor-navigation", "launchConfig": {}, "useDefaultTools": True}
    request = {"maxJobDurationInSeconds": 60, "iamRole": ROLE, "simulationApplications": [config]}

    assert call("CreateSimulationJob", request, service)["simulationApplications"][0]["useDefaultTools"] is True


@pytest.mark.parametrize(("value", "meaning"), [("1", True), ("0", False), ("", False)])
def test_the_setting_is_read_from_the_environment(value: str, meaning: bool, tmp_path: object) -> None:
    environ = {"ROBOMAKER_HOME": str(tmp_path), "ROBOMAKER_REFUSE_DEPRECATED": value}

    assert Settings.from_environment(environ).refuse_deprecated is meaning


def test_another_value_of_the_setting_is_an_error(tmp_path: object) -> None:
    environ = {"ROBOMAKER_HOME": str(tmp_path), "ROBOMAKER_REFUSE_DEPRECATED": "maybe"}

    with pytest.raises(ConfigurationError, match="ROBOMAKER_REFUSE_DEPRECATED is 'maybe'; it has to be 1 or 0"):
        Settings.from_environment(environ)
