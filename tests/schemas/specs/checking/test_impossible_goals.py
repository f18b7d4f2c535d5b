"""Goals in rooms that the templates of a specification do not have."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import SpecError

ROLE = "arn:aws:iam::000000000000:role/local"
SUCCEEDED = "${{ worlds.finishedWorldsSummary.succeededWorlds }}"
ROOMS = [{"Type": "Kitchen", "Name": "kitchen"}, {"Type": "Bedroom", "Name": "bed room"}]
BODY = {"Version": "1", "Buildings": [{"Floors": [{"Floorplan": {"Rooms": ROOMS}}]}]}
THERE = "the world has no room 'cellar'; its rooms are kitchen, bed room"


def goal(room: str) -> dict[str, Any]:
    return {"kind": "goal", "name": f"to-{room.replace(' ', '-')}", "room": room}


def job(world: str, *rooms: str) -> dict[str, Any]:
    config = {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": world}]}
    return {
        "iamRole": ROLE,
        "maxJobDurationInSeconds": 60,
        "simulationApplications": [config],
        "requirements": [goal(room) for room in rooms],
    }


def spec(drive: dict[str, Any], body: Any = BODY, **steps: Any) -> str:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    worlds = {"template": "${{ template.arn }}", "worldCount": count}
    made = {
        "template": {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": body}},
        "worlds": {"operation": "CreateWorldGenerationJob", "input": worlds},
        "drive": drive,
    }
    return json.dumps({"version": 1, "name": "check", "steps": made | steps}, indent=1)


def single(*rooms: str) -> dict[str, Any]:
    return {"operation": "CreateSimulationJob", "input": job(SUCCEEDED.replace(" }}", "[0] }}"), *rooms)}


def batch(requests: Any) -> dict[str, Any]:
    return {"operation": "StartSimulationJobBatch", "input": {"createSimulationJobRequests": requests}}


def each(*rooms: str) -> dict[str, Any]:
    return batch({"forEach": SUCCEEDED, "as": "world", "value": job("${{ world }}", *rooms)})


def problems(text: str) -> list[str]:
    try:
        load_spec(text, "s.yaml")
    except SpecError as error:
        return [f"{problem.path}: {problem.message}" for problem in error.problems]
    return []


@pytest.mark.parametrize(
    ("drive", "path"),
    [
        (single("kitchen", "cellar"), "steps.drive.input.requirements[1].room"),
        (each("cellar"), "steps.drive.input.createSimulationJobRequests.value.requirements[0].room"),
        (
            batch([job(single()["input"]["simulationApplications"][0]["worldConfigs"][0]["world"], "cellar")]),
            "steps.drive.input.createSimulationJobRequests[0].requirements[0].room",
        ),
    ],
)
@pytest.mark.parametrize("body", [BODY, json.dumps(BODY)], ids=["mapping", "text"])
def test_a_room_that_no_world_will_have_is_found(drive: dict[str, Any], path: str, body: Any) -> None:
    assert problems(spec(drive, body)) == [f"{path}: {THERE}"]


@given(st.lists(st.sampled_from(["kitchen", "bed room"]), unique=True))
def test_rooms_that_there_are_are_fine(rooms: list[str]) -> None:
    assert problems(spec(each(*rooms))) == problems(spec(single(*rooms))) == []


def test_a_template_without_rooms_has_the_usual_one() -> None:
    [problem] = problems(spec(each("kitchen"), {"Version": "1"}))
    assert problem.endswith("its rooms are My Living Room")


def test_what_the_file_does_not_say_is_not_guessed() -> None:
    renamed = {"template": "${{ template.arn }}", "templateBody": BODY}
    update = {"operation": "UpdateWorldTemplate", "needs": ["template"], "input": renamed}
    assert problems(spec(each("cellar"), update=update)) == []
    world = "arn:aws:robomaker:us-east-1:000000000000:world/w-1"
    assert problems(spec({"operation": "CreateSimulationJob", "input": job(world, "cellar")})) == []


LIVING, HALL = {"Type": "Living", "Name": "salon"}, {"Type": "Hallway", "Name": "hall"}


@pytest.mark.parametrize(
    ("rooms", "asked", "problem"),
    [
        ([*ROOMS, LIVING], "salon", "the robot starts in 'salon', so the goal cannot be missed"),
        (ROOMS[:1], "kitchen", "the robot starts in 'kitchen', so the goal cannot be missed"),
        ([*ROOMS, LIVING], "kitchen", ""),
        ([*ROOMS, LIVING, HALL], "salon", ""),
        ([*ROOMS, LIVING, {**LIVING, "Name": "den"}], "salon", ""),
        (ROOMS, "kitchen", ""),
    ],
)
def test_a_goal_in_the_room_that_robots_start_in_is_found(rooms: list[Any], asked: str, problem: str) -> None:
    body = {"Version": "1", "Buildings": [{"Floors": [{"Floorplan": {"Rooms": rooms}}]}]}

    found = problems(spec(each(asked), body))

    path = "steps.drive.input.createSimulationJobRequests.value.requirements[0].room"
    assert [each.partition("; ")[0] for each in found] == ([f"{path}: {problem}"] if problem else [])
