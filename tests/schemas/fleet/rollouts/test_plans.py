"""Plans of rollouts: what they refuse, their defaults, and how they are stored."""

import json

import pytest
from pydantic import TypeAdapter, ValidationError

from prefect_robomaker.schemas.fleet.rollouts.rollout import (
    Failed,
    Offered,
    RobotDeploymentState,
    Rollout,
    RolloutEvent,
    Stopped,
    Succeeded,
)
from prefect_robomaker.schemas.fleet.rollouts.rollout_plan import PlannedRobot, RolloutPlan
from prefect_robomaker.schemas.wire.errors import InvalidParameterException

ROBOTS = (PlannedRobot(arn="a"), PlannedRobot(arn="b", unfit_code="MissingRobotArchitecture"))


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({"robots": ()}, "robots: the plan of a rollout has none; register some with the fleet first"),
        ({"robots": (*ROBOTS, ROBOTS[0])}, "robots: a is there twice; name each robot once"),
        ({"robots": ROBOTS, "canaries": ("c",)}, "canaries: c is not among the robots; name robots of the fleet"),
        ({"robots": ROBOTS, "canaries": ("a", "a")}, "canaries: a is there twice; name each robot once"),
    ],
)
def test_a_plan_needs_robots_that_are_known_and_named_once(members: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidParameterException) as refused:
        RolloutPlan.model_validate(members)

    assert str(refused.value) == message


@pytest.mark.parametrize(
    ("member", "value"),
    [
        ("concurrent_percentage", 0),
        ("concurrent_percentage", 101),
        ("threshold_percentage", 0),
        ("robot_timeout_s", 0),
        ("job_timeout_s", float("inf")),
    ],
)
def test_percentages_and_times_have_bounds(member: str, value: float) -> None:
    with pytest.raises(ValidationError, match=member):
        RolloutPlan.model_validate({"robots": ROBOTS, member: value})


def test_a_stored_plan_says_what_holds_even_if_defaults_change() -> None:
    stored = RolloutPlan(robots=ROBOTS).to_json()

    assert stored == {
        "robots": [{"arn": "a"}, {"arn": "b", "unfitCode": "MissingRobotArchitecture"}],
        "concurrentPercentage": 20,
        "thresholdPercentage": 20,
        "robotTimeoutS": 18000.0,
        "jobTimeoutS": 2592000.0,
        "canaries": [],
        "requiresApproval": False,
        "windows": [],
        "rollsBack": False,
    }


def test_a_rollout_is_stored_as_json_and_read_again() -> None:
    state = RobotDeploymentState(order="fetched", action_id=2**31 - 1, percent_done=12.5, deadline_s=1.5e9, started_s=1)
    robots = {"a": state, "b": RobotDeploymentState(outcome="failed", failure_code="MissingRobotArchitecture")}
    rollout = Rollout(plan=RolloutPlan(robots=ROBOTS), robots=robots, began_s=1.25, now_s=3)

    assert Rollout.of_json(json.loads(json.dumps(rollout.to_json()))) == rollout


def test_members_of_newer_releases_are_left_alone() -> None:
    stored = {**RolloutPlan(robots=ROBOTS).to_json(), "shape": "round"}

    assert RolloutPlan.of_json(stored) == RolloutPlan(robots=ROBOTS)


@pytest.mark.parametrize(
    "event",
    [Offered(robot="a", action_id=1), Stopped(why="canceled"), Failed(robot="a", action_id=3, code="EtagMismatch")],
)
def test_an_event_can_be_stored(event: RolloutEvent) -> None:
    stored = json.loads(json.dumps(event.to_json()))

    assert TypeAdapter(RolloutEvent).validate_python(stored) == event


@pytest.mark.parametrize("number", [0, -1, 2**31])
def test_numbers_of_orders_fit_into_what_clients_hold(number: int) -> None:
    with pytest.raises(ValidationError, match="action_id"):
        Succeeded(robot="a", action_id=number)


def test_robots_cannot_report_what_only_the_service_finds() -> None:
    with pytest.raises(ValidationError, match="code"):
        Failed.model_validate({"robot": "a", "action_id": 1, "code": "FailureThresholdBreached"})
