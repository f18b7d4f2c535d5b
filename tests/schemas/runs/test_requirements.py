import json
from typing import Any

import pytest

from prefect_robomaker.schemas.operations.registry import check_request, parse_request
from prefect_robomaker.schemas.operations.simulation_jobs import CreateSimulationJobRequest
from prefect_robomaker.schemas.runs.requirement_kinds.clearance import ClearanceRequirement
from prefect_robomaker.schemas.runs.requirement_kinds.goal import GoalRequirement
from prefect_robomaker.schemas.runs.requirement_kinds.off import IN_ROOMS
from prefect_robomaker.schemas.runs.requirement_kinds.time_limit import TimeLimitRequirement
from prefect_robomaker.schemas.runs.requirements import (
    parse_requirements,
    requirements_of,
    unknown_room,
)
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.base import STORED
from prefect_robomaker.schemas.wire.errors import InvalidParameterException, SpecError

LIMIT = {"kind": "time_limit", "name": "quick", "limit_s": 60}
TOPIC = {"kind": "topic", "name": "a", "topic": "/scan"}
FORMULA = {"kind": "expression", "name": "a", "formula": "always sped < 1"}
WORLD = "arn:aws:robomaker:us-east-1:000000000000:world/w-1"


def order(requirements: Any = None, variable: Any = None, **members: Any) -> dict[str, Any]:
    launch: dict[str, Any] = {}
    if variable is not None:
        text = variable if isinstance(variable, str) else json.dumps(variable)
        launch = {"environmentVariables": {"ROBOMAKER_REQUIREMENTS": text}}
    request: dict[str, Any] = {
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/any",
        "simulationApplications": [{"application": "indoor-navigation", "launchConfig": launch, **members}],
    }
    return request if requirements is None else {**request, "requirements": requirements}


def problems(*arguments: Any, **members: Any) -> list[str]:
    return [str(problem) for problem in check_request("CreateSimulationJob", order(*arguments, **members))]


@pytest.mark.parametrize(
    ("requirement", "words"),
    [
        ({"kind": "goal", "name": "a", "rooom": "Hall"}, "requirements[0].rooom: is not known; did you mean 'room'?"),
        ({"kind": "gaol", "name": "a"}, "requirements[0].kind: is 'gaol'; did you mean 'goal'?"),
        ({"name": "a"}, "requirements[0]: has no kind"),
        ({"kind": "clearance", "name": "a"}, "requirements[0].min_m: is missing"),
        ({"kind": "clearance", "name": "a", "min_m": 0}, "requirements[0].min_m: is 0; it has to be above 0"),
        ({**LIMIT, "limit_s": "60"}, "requirements[0].limit_s: is '60'; it has to be a number"),
        ({**LIMIT, "limit_s": float("inf")}, "requirements[0].limit_s: is inf; it has to be a finite number"),
        ({"kind": "goal", "name": "a", "x": 1.0}, "requirements[0]: a point needs both x and y"),
        ({"kind": "goal", "name": "a"}, "requirements[0]: neither room and x, y; a goal is one of them"),
        ({"kind": "predicate", "name": "a", "attribute": "f"}, "requirements[0].attribute: is 'f'; it has to be a"),
        ({"kind": "sped", "name": "a"}, "requirements[0].kind: is 'sped'; did you mean 'speed'?"),
        ({"kind": "speed", "name": "a", "max_mps": 0}, "requirements[0].max_mps: is 0; it has to be above 0"),
        ({"kind": "upright", "name": "a", "max_tilt_deg": 180}, "requirements[0].max_tilt_deg: is 180; it may be"),
        ({"kind": "progress", "name": "a"}, "requirements[0].max_stuck_s: is missing"),
        ({"kind": "path_length", "name": "a", "goal": "b", "min_ratio": 1.2}, "requirements[0].min_ratio: is 1.2;"),
        ({"kind": "coverage", "name": "a", "min_share": 0.5}, "requirements[0].radius_m: is missing"),
        ({"kind": "all_rooms", "name": "a", "rooms": ["x"]}, "requirements[0].rooms: is not known"),
        ({"kind": "localization", "name": "a", "attribute": "f", "max_m": 1}, "requirements[0].attribute: is 'f'"),
        (FORMULA, "requirements[0].formula: column 8: there is no signal 'sped'; did you mean 'speed'?"),
        ({**FORMULA, "formula": "always[0, 0.25] speed < 1"}, "requirements[0].formula: the bound 0.25 is no multiple"
         " of period_s, 0.1; write 0.2, or give a period_s that divides it"),
        ({**FORMULA, "formula": "always[0, 600] speed < 1"}, "requirements[0].formula: the bound 600 is more than "
         "3000 times period_s, 0.1; give a period_s of 0.2 or more"),
        ({**FORMULA, "formula": "speed < 1", "stop": True}, "requirements[0].stop: an expression is judged when"),
        ({**FORMULA, "formula": "a < 1", "signals": {"a": "m.f", "b": "m.g"}}, "requirements[0].signals: b is not in"),
        ({**FORMULA, "signals": {"speed": "m.f"}}, "requirements[0].signals: speed is a signal of every run;"),
        (TOPIC, "requirements[0]: none of min_hz, max_gap_s, field, nodes; a requirement asks for one of them"),
        ({**TOPIC, "min_hz": 1, "max_gap_s": 1}, "requirements[0]: both min_hz and max_gap_s; a requirement asks for"),
        ({**TOPIC, "field": "data"}, "requirements[0]: field needs min or max, or both"),
        ({**TOPIC, "min_hz": 1, "max": 1}, "requirements[0]: min and max need a field"),
        ({**TOPIC, "field": "data", "min": 2, "max": 1}, "requirements[0].min: 2 is above max, 1; swap them"),
        ({**TOPIC, "min_hz": 1, "topic": "scan"}, "requirements[0].topic: is 'scan'; it has to be"),
        ({**TOPIC, "min_hz": 1, "stop": True}, "requirements[0].stop: topics are judged when the run is over"),
        ("goal", "requirements[0]: is 'goal'; it has to be a mapping"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_place(requirement: Any, words: str) -> None:
    (problem,) = problems([requirement])
    assert problem.startswith(words)
    (told,) = (str(error.value) for error in [_refusal([requirement])])
    assert told.startswith(words.replace("requirements", "my list", 1))


def _refusal(data: Any) -> Any:
    with pytest.raises(InvalidParameterException) as error:
        parse_requirements(data, "my list")
    return error


def test_names_differ_and_goals_stand_below_those_they_come_after() -> None:
    goal = {"kind": "goal", "x": 0.0, "y": 0.0}
    assert "'quick' appears more than once" in problems([LIMIT, LIMIT])[0]
    assert problems([{**goal, "name": "a"}, {**goal, "name": "b", "after": "a"}]) == []
    (problem,) = problems([{**goal, "name": "b", "after": "a"}, {**goal, "name": "a"}])
    assert problem == "requirements[0]: b: after is 'a', no goal further up; there is none before it"


def test_the_variable_says_the_same_as_the_member() -> None:
    member, variable, both = (
        parse_request("CreateSimulationJob", order(*given)) for given in (([LIMIT],), (None, [LIMIT]), ([LIMIT],) * 2)
    )
    for request in (member, variable, both):
        assert isinstance(request, CreateSimulationJobRequest)
        assert requirements_of(request) == [TimeLimitRequirement(kind="time_limit", name="quick", limit_s=60)]


PLACE = "simulationApplications[0].launchConfig.environmentVariables.ROBOMAKER_REQUIREMENTS"


@pytest.mark.parametrize(
    ("variable", "words"),
    [
        ("[{]", f"{PLACE}: not JSON"),
        ([{**LIMIT, "limit": 3}], f"{PLACE}[0].limit: is not known; did you mean 'limit_s'?"),
        ({}, f"{PLACE}: is an empty mapping; it has to be a list"),
    ],
)
def test_a_problem_of_the_variable_names_it(variable: Any, words: str) -> None:
    (problem,) = problems(None, variable)
    assert problem.startswith(words)


@pytest.mark.parametrize(
    "name",
    [
        "ROBOMAKER_REQUIREMENT", "ROBOMAKER_REQUIRMENTS", "ROBOMAKER_REQUIREMETNS", "ROBMAKER_REQUIREMENTS",
        "ROBOMAKER_REQUIREMENTS_JSON", "ROBOMAKER_RECQUIREMENTS",
    ],
)  # fmt: skip
def test_a_misspelt_variable_is_refused(name: str) -> None:
    launch = {"environmentVariables": {name: json.dumps([LIMIT])}}
    (problem,) = problems(launchConfig=launch)
    assert problem.startswith(f"simulationApplications[0].launchConfig.environmentVariables.{name} is not known; did ")
    assert "did you mean ROBOMAKER_REQUIREMENTS?" in problem


@pytest.mark.parametrize(
    "name", ["ROBOMAKER_SEED", "REQUIREMENTS", "ROBOT_REQUIREMENTS", "ROBOMAKER_REQUIRED", "ROBOMAKER_REQUEST", "X"]
)
def test_variables_of_other_names_are_not_taken_for_it(name: str) -> None:
    assert problems(launchConfig={"environmentVariables": {name: "1"}}) == []


def test_a_job_that_is_stored_already_is_read_with_any_variable() -> None:
    request = order(launchConfig={"environmentVariables": {"ROBOMAKER_REQUIREMENT": "[]"}})
    assert CreateSimulationJobRequest.model_validate(request, context=STORED).simulationApplications


def test_member_and_variable_must_not_differ() -> None:
    (problem,) = problems([LIMIT], [{**LIMIT, "limit_s": 61}])
    assert problem == f"requirements and {PLACE} differ; leave one of them out"


def test_only_what_indoor_navigation_has_can_be_switched_off_there() -> None:
    assert [problems([{"kind": "off", "name": name}]) for name in IN_ROOMS] == [[]] * 3
    (problem,) = problems([{"kind": "off", "name": "room_visited"}])
    assert problem == (
        "requirements[0].name: is 'room_visited'; indoor-navigation has no requirement of this name to switch off; "
        "did you mean 'rooms_visited'?"
    )
    assert problems([{"kind": "off", "name": "room_visited"}], application="mine") == []


def test_a_room_needs_a_world() -> None:
    goal = {"kind": "goal", "name": "home", "room": "Hall"}
    (problem,) = problems([goal])
    assert "requirements[0].room is 'Hall', but the job names no world" in problem
    assert "or give the goal as x and y" in problem
    assert problems([goal], worldConfigs=[{"world": WORLD}]) == []
    (problem,) = problems([LIMIT, {"kind": "speed", "name": "slow", "max_mps": 1.0, "room": "Hall"}])
    assert problem.endswith(
        "requirements[1].room is 'Hall', but the job names no world; "
        "add simulationApplications[0].worldConfigs, or leave out `room`"
    )
    for asked in ({"kind": "all_rooms"}, {"kind": "coverage", "min_share": 0.5, "radius_m": 0.2}):
        (problem,) = problems([{"name": "it", **asked}])
        assert f"requirements[0].kind is {asked['kind']!r}, which needs a world, but the job names no world" in problem


@pytest.mark.parametrize(
    ("member", "asked"),
    [
        ("goal", {"kind": "path_length", "name": "it", "goal": "home", "min_ratio": 0.5}),
        ("until", {"kind": "progress", "name": "it", "max_stuck_s": 5, "until": "home"}),
    ],
)
def test_what_refers_to_a_goal_needs_it_above(member: str, asked: dict[str, Any]) -> None:
    home = {"kind": "goal", "name": "home", "x": 9, "y": 0}
    assert problems([home, asked]) == []
    (problem,) = problems([asked, home])
    assert f"it: {member} is 'home', no goal further up; there is none before it" in problem


def test_a_room_that_the_world_has_not() -> None:
    asked = [("requirements[2].room", "Hal")]
    assert unknown_room(asked, ["Hall", "Kitchen"]) == (
        "requirements[2].room: the world has no room 'Hal'; did you mean 'Hall'? Its rooms are Hall, Kitchen"
    )
    assert unknown_room([("requirements[0].room", "Sauna")], ["Hall"]) == (
        "requirements[0].room: the world has no room 'Sauna'; its rooms are Hall"
    )
    assert unknown_room(asked, ["Hal"]) is None


def test_models_are_as_good_as_mappings() -> None:
    goal = GoalRequirement(kind="goal", name="there", x=1, y=2)
    clearance = ClearanceRequirement(kind="clearance", name="apart", min_m=0.1)
    assert parse_requirements([goal, clearance], "requirements") == [goal, clearance]


SPEC = """\
version: 1
name: drive
steps:
  worlds: {operation: ListWorlds}
  drive:
    operation: CreateSimulationJob
    input:
      maxJobDurationInSeconds: 600
      iamRole: arn:aws:iam::000000000000:role/any
      simulationApplications:
        - {application: indoor-navigation, launchConfig: {}, worldConfigs: [{world: "${{ worlds.worldSummaries[0].arn }}"}]}
      requirements:
        - {kind: goal, name: there, room: "${{ worlds.worldSummaries[0].template }}"}
        - {kind: no_collision, name: soft, max_force_N: 3}
"""  # noqa: E501


def test_specifications_may_refer_to_what_steps_gave() -> None:
    assert load_spec(SPEC, "spec.yaml").order == ("worlds", "drive")


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("max_force_N", "max_force", "spec.yaml:14:44: steps.drive.input.requirements[1].max_force: is not known; did"),
        ("no_collision", "no_colision", "spec.yaml:14:18: steps.drive.input.requirements[1].kind: is 'no_colision'; d"),
        ("N: 3", 'N: "${{ worlds.nextToken }}"', "spec.yaml:14:57: steps.drive.input.requirements[1].max_force_N: ${{"),
    ],
)
def test_specifications_are_checked_with_line_and_column(before: str, after: str, words: str) -> None:
    with pytest.raises(SpecError) as error:
        load_spec(SPEC.replace(before, after), "spec.yaml")
    assert str(error.value).startswith(words)


@pytest.mark.parametrize(
    "launch",
    [
        {"command": ["bin/robot"]},
        {"launchFile": "robot.launch.py"},
        {"packageName": "robot", "launchFile": "robot.launch"},
    ],
)
def test_requirements_that_nobody_would_judge_are_refused(launch: dict[str, Any]) -> None:
    robot = {"application": "robot", "launchConfig": launch}
    request = {**order(), "robotApplications": [robot], "requirements": [LIMIT]}
    alone = {name: member for name, member in request.items() if name != "simulationApplications"}
    [problem] = map(str, check_request("CreateSimulationJob", alone))
    assert "requirements: they would not be judged, since the job has only programs" in problem
    assert check_request("CreateSimulationJob", request) == [], "the simulation application has physics"
    assert check_request("CreateSimulationJob", {**alone, "requirements": []}) == []
