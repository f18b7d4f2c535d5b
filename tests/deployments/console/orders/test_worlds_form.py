"""The form that generates worlds: rooms, the plan beside it, and who may."""

import base64
import json
import re
from collections.abc import Callable
from typing import Any

import pytest

from prefect_robomaker.deployments.console.orders import worlds_form
from prefect_robomaker.deployments.console.orders.previews import NoPlanError
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

Enter = Callable[..., Any]
SUBMIT = AccessKey("SUBMIT", "word", "submitter", "submit")
READER = AccessKey("READ", "word", "reader", "read")
RED = AccessKey("RED", "word", "red", "submit", (), ("team=red",))
ROOMS = {"room-0-type": "Living", "room-0-name": "Hall <b>", "room-0-area": "20", "room-0-ratio": "3:2"}


class DrawnPlans:
    """Draws nothing, and keeps what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, int, str]] = []
        self.problem = ""

    def draw(self, body: str, seed: int, visitor: str) -> str:
        self.asked.append((body, seed, visitor))
        if self.problem:
            raise NoPlanError(self.problem)
        return "<svg/>"


@pytest.fixture(autouse=True)
def plans(monkeypatch: pytest.MonkeyPatch) -> DrawnPlans:
    plans = DrawnPlans()
    monkeypatch.setattr(worlds_form, "_PREVIEWS", plans)
    return plans


def count(kind: str, service: Service) -> int:
    return len(service.catalog.list(kind).resources)


def test_the_form_shows_the_first_world(enter: Enter, plans: DrawnPlans) -> None:
    page = enter().get("/worlds/new").text
    assert f"data:image/svg+xml;base64,{base64.b64encode(b'<svg/>').decode()}" in page
    [(body, seed, _)] = plans.asked
    rooms = json.loads(body)["Buildings"][0]["Floors"][0]["Floorplan"]["Rooms"]
    assert ([room["Name"] for room in rooms], seed) == (["Living room", "Kitchen", "Bedroom"], 7)


def test_rooms_come_and_go_without_a_script(enter: Enter, service: Service) -> None:
    visitor = enter()
    more = visitor.send("/worlds/new", **ROOMS, do="add").text
    assert re.findall(r'name="room-\d-name" value="([^"]*)"', more) == ["Hall &lt;b&gt;", "Room 2"]
    fields = {**ROOMS, **{name.replace("-0-", "-1-"): value for name, value in ROOMS.items()}, "room-1-name": "Den"}
    fewer = visitor.send("/worlds/new", **fields, do="remove-0").text
    assert re.findall(r'name="room-\d-name" value="([^"]*)"', fewer) == ["Den"]
    assert count("world-template", service) == 0


TWO_ROOMS = {
    **ROOMS,
    **{name.replace("-0-", "-1-"): value for name, value in ROOMS.items()},
    "room-0-name": "Hall",
    "room-1-name": "Den",
    "room-1-type": "Bedroom",
}
WAY = {"way-0-first": "1", "way-0-second": "0", "way-0-kind": "no wall"}


def test_ways_doors_and_materials_are_in_the_body(enter: Enter, plans: DrawnPlans, service: Service) -> None:
    fields = {**TWO_ROOMS, **WAY, "doors": "half open", "room-1-floor": "Tiles", "room-0-walls": "Brick"}
    assert enter().send("/worlds/new/preview", **fields).status_code == 200
    assert enter().send("/worlds/new", **fields, do="create").status_code == 303
    [template] = service.catalog.list("world-template").resources
    drawn, made = (json.loads(text) for text in (plans.asked[-1][0], template.document["templateBody"]))
    floor = made["Buildings"][0]["Floors"][0]
    assert drawn == made
    assert made["Version"] == "2"
    assert floor["Floorplan"]["DesiredConnections"] == [{"Location": ["Den", "Hall"], "ConnectionType": "Opening"}]
    [flooring], [walls] = (floor["Interior"][each]["MaterialSets"] for each in ("Flooring", "Walls"))
    assert (flooring["TargetSet"], flooring["SampleSet"]) == ({"RoomNames": ["Den"]}, {"MaterialTypes": ["Tiles"]})
    assert (walls["TargetSet"], walls["SampleSet"]) == ({"RoomNames": ["Hall"]}, {"MaterialTypes": ["Brick"]})
    [doors] = floor["Interior"]["Doorways"]["DoorwaySets"]
    assert doors["Door"]["InitialState"]["OpenPosition"]["Percent"] == 50


def test_names_in_any_letters_are_kept_beside_plain_ones(enter: Enter, service: Service) -> None:
    fields = {**TWO_ROOMS, **WAY, "room-0-name": "Küche", "room-1-name": "寝室", "room-1-floor": "Tiles"}
    assert enter().send("/worlds/new", **fields, do="create").status_code == 303
    [template] = service.catalog.list("world-template").resources
    made = json.loads(template.document["templateBody"])
    floor = made["Buildings"][0]["Floors"][0]
    names = [(room["Name"], room["OriginalName"]) for room in floor["Floorplan"]["Rooms"]]
    assert (made["Version"], names) == ("2", [("Kuche", "Küche"), ("Room 2", "寝室")])
    assert floor["Floorplan"]["DesiredConnections"][0]["Location"] == ["Room 2", "Kuche"]
    assert floor["Interior"]["Flooring"]["MaterialSets"][0]["TargetSet"] == {"RoomNames": ["Room 2"]}


def test_ways_come_and_go_and_follow_their_rooms(enter: Enter) -> None:
    visitor = enter()

    def ways(**fields: str) -> list[tuple[str, ...]]:
        page = visitor.send("/worlds/new", **fields).text
        chosen = re.findall(r'<select name="way-\d-(?:first|second)">.*?value="(\d)" selected', page)
        return list(zip(chosen[::2], chosen[1::2], strict=True))

    three = {**TWO_ROOMS, **{f"room-2-{each}": ROOMS[f"room-0-{each}"] for each in ("type", "area", "ratio")}}
    three["room-2-name"] = "Attic"
    assert ways(**three, do="way") == [("0", "1")]
    two_ways = {**WAY, "way-1-first": "2", "way-1-second": "1", "way-1-kind": "doorway"}
    assert ways(**three, **two_ways, do="preview") == [("1", "0"), ("2", "1")]
    assert ways(**three, **two_ways, do="unway-0") == [("2", "1")]
    assert ways(**three, **two_ways, do="remove-0") == [("1", "0")]  # what was between the second and third room
    assert visitor.send("/worlds/new", **three, do="remove-" + "9" * 5000).status_code == 200


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("room-0-area", "1", "Room 1.DesiredShape.Area: 1.0: 2 or more would be right"),
        ("room-0-area", "wide", "it has to be a number"),
        ("room-0-name", "Hall <b>", "Room 1.Name"),
        ("room-0-name", "Küche \x9b31m", "Room 1.Name"),
        ("height", "9", "Ceiling.Height"),
        ("seed", "-1", "a whole number"),
        ("room-0-floor", "Lava", "Flooring.MaterialSets[0].SampleSet.MaterialTypes[0]"),
        ("doors", "ajar", "doors: is &#39;ajar&#39;"),
        ("plans", "26", "26 floor plans with 2 interiors each are 52 worlds; a job may make at most 50"),
        ("plans", "x", "floor plans: is &#39;x&#39;"),
        ("interiors", "0", "interiorCountPerFloorplan"),
        ("tags", "red", "key=value"),
    ],
)
def test_what_is_wrong_is_told_and_nothing_is_made(
    enter: Enter, service: Service, field: str, value: str, told: str
) -> None:
    answer = enter().send("/worlds/new", **{**ROOMS, "room-0-name": "Hall", field: value}, do="create")
    assert (answer.status_code, told in answer.text) == (400, True), answer.text
    assert (count("world-template", service), count("world-generation-job", service)) == (0, 0)


@pytest.mark.parametrize(
    ("way", "told"),
    [
        ({"way-0-second": "1"}, "Way 1"),
        ({"way-0-first": "7"}, "there is no room 8"),
        ({"way-0-kind": "slide"}, "Way 1"),
    ],
)
def test_ways_that_cannot_be_are_told(enter: Enter, service: Service, way: dict[str, str], told: str) -> None:
    answer = enter().send("/worlds/new", **{**TWO_ROOMS, **WAY, **way}, do="create")
    assert (answer.status_code, told in answer.text) == (400, True), answer.text
    assert count("world-template", service) == 0


def test_a_plan_that_cannot_be_drawn_is_told(enter: Enter, plans: DrawnPlans) -> None:
    plans.problem = "no plan <b>"
    answer = enter().send("/worlds/new/preview", **{**ROOMS, "room-0-name": "Hall"})
    assert (answer.status_code, "no plan &lt;b&gt;" in answer.text) == (200, True)
    assert "<html" not in answer.text


def test_worlds_are_ordered_of_a_new_template(enter: Enter, service: Service) -> None:
    fields = {**ROOMS, "room-0-name": "Hall", "plans": "3", "interiors": "2", "seed": "5", "tags": "team=red"}
    answer = enter().send("/worlds/new", **fields, name="flat", do="create")
    [job] = service.catalog.list("world-generation-job").resources
    [template] = service.catalog.list("world-template").resources
    assert (answer.status_code, answer.headers["location"]) == (303, f"/console/generations/{job.id}")
    assert (template.name, template.tags, job.tags) == ("flat", {"team": "red"}, {"team": "red"})
    assert job.document["request"]["worldCount"] == {"floorplanCount": 3, "interiorCountPerFloorplan": 2}
    assert (job.document["request"]["template"], job.document["seed"]) == (template.arn, 5)


def test_worlds_are_ordered_of_a_template_that_exists(
    enter: Enter, template: str, service: Service, plans: DrawnPlans
) -> None:
    visitor, name = enter(SUBMIT), template.rpartition("/")[2]
    assert "two rooms" in visitor.get(f"/worlds/new?template={name}").text
    assert "living room" in plans.asked[0][0]
    assert visitor.send("/worlds/new", template=name, do="create").status_code == 303
    [job] = service.catalog.list("world-generation-job").resources
    assert job.document["request"]["template"] == template


def test_a_job_that_failed_says_why(enter: Enter, template: str, service: Service) -> None:
    request = {"template": template, "worldCount": {"floorplanCount": 26, "interiorCountPerFloorplan": 2}}
    job = registry()["CreateWorldGenerationJob"].perform(
        call("CreateWorldGenerationJob", request, service)["arn"], service
    )
    page = enter().get(f"/generations/{job['arn'].rpartition('/')[2]}").text
    assert "52 worlds; a job may make at most 50" in page


@pytest.mark.parametrize("path", ["/worlds/new", "/worlds/new/preview"])
def test_who_may_not_generate(enter: Enter, template: str, service: Service, plans: DrawnPlans, path: str) -> None:
    name = template.rpartition("/")[2]
    fields = {**ROOMS, "do": "create"}
    assert enter(READER).send(path, **fields).status_code == 403
    assert enter(SUBMIT).send(path, **fields).status_code == 403  # a template needs more
    assert enter(RED).send(path, **fields, template=name).status_code == 404  # it is none of theirs
    assert enter(READER).get("/worlds/new").status_code == 403
    assert count("world-generation-job", service) == 0
    assert plans.asked == []


@pytest.mark.parametrize("path", ["/worlds/new", "/worlds/new/preview"])
def test_forms_of_others_generate_nothing(enter: Enter, service: Service, plans: DrawnPlans, path: str) -> None:
    visitor = enter()
    for headers in ({"origin": "http://evil.example"}, {"sec-fetch-site": "cross-site"}):
        assert visitor.send(path, headers=headers, **ROOMS, do="create").status_code == 403
    visitor.token = "guess"
    assert visitor.send(path, **ROOMS, do="create").status_code == 403
    assert count("world-template", service) == 0
    assert plans.asked == []
