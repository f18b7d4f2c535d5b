"""Goals that cannot be missed since the robot starts there."""

from typing import Any

import pytest

from prefect_robomaker.schemas.operations.registry import parse_request
from prefect_robomaker.schemas.runs.requirement_kinds.goal import goals_at_start
from prefect_robomaker.schemas.runs.requirements import doubtful_variables, starts_on_origin
from prefect_robomaker.schemas.wire.errors import InvalidParameterException

HERE = {"kind": "goal", "name": "here", "x": 0.3, "y": 0.0}
IN_HALL = {"kind": "goal", "name": "in-hall", "room": "hall"}
AWAY = {"kind": "goal", "name": "away", "x": 3, "y": 0, "after": "here"}


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ([HERE], [(0, "x")]),
        ([IN_HALL], [(0, "room")]),
        ([{**IN_HALL, "name": "other"}, IN_HALL], [(0, "room"), (1, "room")]),
        ([{**HERE, "within_m": 0.2}], []),
        ([HERE, AWAY], []),
        ([AWAY, {**IN_HALL, "after": "away"}], []),
        ([{**HERE, "by_s": 1}], []),
        ([{**HERE, "body": "door"}], []),
        ([{**IN_HALL, "room": "kitchen"}], []),
        ([{"kind": "clearance", "name": "polite", "min_m": 0.1}, "${{ inputs.goal }}", HERE], [(2, "x")]),
        ([{**HERE, "x": "${{ inputs.x }}"}], []),
    ],
)
def test_goals_that_are_reached_before_the_robot_moves(asked: list[Any], found: list[tuple[int, str]]) -> None:
    assert [(index, member) for index, member, _ in goals_at_start(asked, "hall")] == found


def test_an_order_for_such_a_goal_is_refused() -> None:
    def order(application: str) -> dict[str, Any]:
        config = {"application": application, "launchConfig": {"packageName": "a", "launchFile": "make"}}
        role = "arn:aws:iam::000000000000:role/local"
        members = {"maxJobDurationInSeconds": 60, "iamRole": role, "simulationApplications": [config]}
        return {**members, "requirements": [HERE]}

    with pytest.raises(
        InvalidParameterException, match=r"requirements\[0\]\.x: the robot starts at \(0, 0\), so the goal cannot be"
    ):
        parse_request("CreateSimulationJob", order("indoor-navigation"))
    parse_request("CreateSimulationJob", order("warehouse"))  # where its robot starts is its own


@pytest.mark.parametrize("order", [{}, {"simulationApplications": []}, {"simulationApplications": "${{ a }}"}])
def test_where_the_robot_starts_is_not_known_without_the_application(order: dict[str, Any]) -> None:
    assert not starts_on_origin(order)


def recorded(application: str = "recorded-run", **members: Any) -> dict[str, Any]:
    config = {"application": application, "launchConfig": {}}
    role = "arn:aws:iam::000000000000:role/local"
    return {"maxJobDurationInSeconds": 60, "iamRole": role, "simulationApplications": [config], **members}


def test_topics_are_not_asked_for_in_trials() -> None:
    """Trials have no recording to judge them by."""
    seen = {"kind": "topic", "name": "seen", "topic": "/scan", "min_hz": 4.0}
    quick = {"kind": "time_limit", "name": "quick", "limit_s": 9.0}
    knows = {"kind": "localization", "name": "knows", "estimate": "/tf", "truth": "/truth", "max_m": 0.5}
    for asked, kind in (([quick, seen], "topic"), ([quick, knows], "localization")):
        with pytest.raises(
            InvalidParameterException, match=rf"requirements\[1\] \({kind}\) is judged by the recording"
        ):
            parse_request("CreateSimulationJob", recorded("warehouse", requirements=asked, trials={"seeds": 2}))
        parse_request("CreateSimulationJob", recorded("warehouse", requirements=asked))
    parse_request("CreateSimulationJob", recorded("warehouse", requirements=[quick], trials={"seeds": 2}))


@pytest.mark.parametrize(
    "name", ["recorded-run", "arn:aws:robomaker:us-east-1:000000000000:simulation-application/recorded-run/1"]
)
def test_a_robot_beside_a_recording_is_refused(name: str) -> None:
    robot = {"application": "scout", "launchConfig": {}}
    with pytest.raises(InvalidParameterException, match=r"recorded-run, judges a robot that has driven already"):
        parse_request("CreateSimulationJob", recorded(name, robotApplications=[robot]))
    parse_request("CreateSimulationJob", recorded(name))
    parse_request("CreateSimulationJob", recorded("indoor-navigation", robotApplications=[robot]))


def test_launch_variables_that_are_nearly_known_ones_are_named() -> None:
    given = ["ROBOMAKER_SIM_TIMELIMIT_S", "ROBOMAKER_ROBBOT", "ROBOMAKER_REQUIRED", "ROBOMAKER_MINE", "GAIN"]

    assert dict(doubtful_variables([*given, "ROBOMAKER_ROBOT", "ROBOMAKER_REQUIREMENTS"])) == {
        "ROBOMAKER_SIM_TIMELIMIT_S": "ROBOMAKER_SIM_TIME_LIMIT_S",
        "ROBOMAKER_ROBBOT": "ROBOMAKER_ROBOT",
        "ROBOMAKER_REQUIRED": "ROBOMAKER_REQUIREMENTS",
    }
