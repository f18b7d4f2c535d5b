"""Simulation jobs that are judged by requirements, from the order to result.json."""

import json
import re
from collections.abc import Callable
from typing import Any

import pytest
from helpers.small_flat import ROLE

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import InvalidParameterException, SpecError, StorageUnavailableError
from prefect_robomaker.tasks.inspection.preflight import check_preconditions
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.inputs.bundles import rooms_of_world

pytestmark = pytest.mark.usefixtures("known_worlds")
Drive = Callable[..., tuple[dict[str, Any], RunResult | None]]


@pytest.fixture
def drive(service: Service, generate: Any, simulate: Any) -> Drive:
    """Drives Scout through a flat of two rooms."""
    world = generate()["finishedWorldsSummary"]["succeededWorlds"][0]

    def run(variables: dict[str, str] | None = None, **members: Any) -> tuple[dict[str, Any], RunResult | None]:
        launch = {"environmentVariables": variables} if variables else {}
        config = {"application": "indoor-navigation", "launchConfig": launch, "worldConfigs": [{"world": world}]}
        job = simulate(
            {
                "maxJobDurationInSeconds": 120, "iamRole": ROLE, "seed": 3, "simulationApplications": [config],
                "loggingConfig": {"recordAllRosTopics": False}, **members,
            }
        )  # fmt: skip
        place = service.catalog.get(job["arn"]).document.get("outputs")
        if job["status"] != "Completed" or place is None:
            return job, None
        return job, RunResult.model_validate_json(
            service.store.get_bytes(place["bucket"], f"{place['prefix']}/result.json")
        )

    return run


GOAL = {"kind": "goal", "name": "there", "room": "bedroom", "stop": True}


def test_a_goal_ends_the_job_with_a_pass(drive: Drive) -> None:
    clearance = {"kind": "clearance", "name": "apart", "min_m": 0.005}
    job, result = drive(requirements=[GOAL, clearance])
    assert job["status"] == "Completed"
    assert result is not None
    assert (result.verdict, result.ended_by) == ("PASS", "requirements")
    judged = {item.name: item for item in result.requirements}
    assert judged["there"].value == pytest.approx(result.sim_time_s, abs=0.2)
    assert judged["apart"].margin is not None
    assert 0 < judged["apart"].margin < 2
    assert not judged["rooms_visited"].counts
    assert result.metrics["goals_reached"] == 1


def test_the_launch_variable_does_the_same_and_fail_is_no_failure_of_the_job(drive: Drive) -> None:
    limit = {"kind": "time_limit", "name": "hurry", "limit_s": 1.0, "stop": True}
    job, result = drive({"ROBOMAKER_REQUIREMENTS": json.dumps([limit])})
    assert job["status"] == "Completed"
    assert "failureCode" not in job
    assert result is not None
    assert (result.verdict, result.ended_by) == ("FAIL", "requirements")
    (hurry,) = (item for item in result.requirements if item.name == "hurry")
    assert hurry.first_violation_s == pytest.approx(1.05, abs=0.06)
    assert hurry.room == "living room"


def test_a_limit_that_indoor_navigation_never_comes_to_is_not_met(drive: Drive) -> None:
    limit = {"kind": "time_limit", "name": "hurry", "limit_s": 1.0}
    job, result = drive({"ROBOMAKER_SIM_TIME_LIMIT_S": "1"}, requirements=[limit])
    assert (job["status"], result is None) == ("Completed", False)
    assert result is not None
    (hurry,) = (item for item in result.requirements if item.name == "hurry")
    assert hurry.error == "the environment ends its runs at 1 s, so a limit of 1 s is never over"
    assert result.verdict == "ERROR"


@pytest.fixture
def ordered(generate: Any) -> Callable[..., dict[str, Any]]:
    """Makes the order for a job in a flat of two rooms."""
    world = generate()["finishedWorldsSummary"]["succeededWorlds"][0]

    def make(requirements: list[dict[str, Any]] | None = None, variable: str | None = None) -> dict[str, Any]:
        launch = {"environmentVariables": {"ROBOMAKER_REQUIREMENTS": variable}} if variable else {}
        config = {"application": "indoor-navigation", "launchConfig": launch, "worldConfigs": [{"world": world}]}
        order = {"maxJobDurationInSeconds": 120, "iamRole": ROLE, "simulationApplications": [config]}
        return order if requirements is None else {**order, "requirements": requirements}

    return make


IN_THE_CELLAR = {**GOAL, "room": "cellar"}
THERE_IS_NONE = r"\[1\]\.room: the world has no room 'cellar'; its rooms are .*bedroom"
NEAR = {"kind": "goal", "name": "near", "x": 1.0, "y": 1.0}


def test_a_room_that_the_world_has_not_is_refused_with_the_rooms_it_has(
    service: Service, ordered: Callable[..., dict[str, Any]]
) -> None:
    wrong = ordered([NEAR, IN_THE_CELLAR])
    with pytest.raises(InvalidParameterException, match=rf"^requirements{THERE_IS_NONE}"):
        call("CreateSimulationJob", wrong, service)
    place = r"simulationApplications\[0\]\.launchConfig\.environmentVariables\.ROBOMAKER_REQUIREMENTS"
    with pytest.raises(InvalidParameterException, match=rf"^{place}{THERE_IS_NONE}"):
        call("CreateSimulationJob", ordered(variable=json.dumps([NEAR, IN_THE_CELLAR])), service)
    requests = [ordered(), ordered([GOAL]), wrong]
    with pytest.raises(
        InvalidParameterException, match=rf"^createSimulationJobRequests\[2\]\.requirements{THERE_IS_NONE}"
    ):
        call("StartSimulationJobBatch", {"createSimulationJobRequests": requests}, service)
    assert not service.catalog.list("simulation-job").resources
    assert not service.catalog.list("simulation-job-batch").resources

    drive = {"operation": "StartSimulationJobBatch", "input": {"createSimulationJobRequests": requests}}
    spec = load_spec(json.dumps({"version": 1, "name": "check", "steps": {"drive": drive}}), "check.yaml")
    place = r"steps\.drive\.input\.createSimulationJobRequests\[2\]\.requirements"
    with pytest.raises(SpecError, match=place + THERE_IS_NONE):
        check_preconditions(spec, service)


def test_a_goal_in_the_room_where_the_robot_starts_is_refused_before_a_night_begins(
    service: Service, ordered: Callable[..., dict[str, Any]]
) -> None:
    world = service.catalog.get(ordered()["simulationApplications"][0]["worldConfigs"][0]["world"])
    rooms = rooms_of_world(world, service)
    assert rooms is not None

    def check(**members: Any) -> None:
        drive = {"operation": "CreateSimulationJob", "input": ordered([{**GOAL, "room": rooms.start, **members}])}
        spec = load_spec(json.dumps({"version": 1, "name": "check", "steps": {"drive": drive}}), "check.yaml")
        check_preconditions(spec, service)

    with pytest.raises(SpecError, match=rf"requirements\[0\]\.room: the robot starts in '{rooms.start}', so the goal"):
        check()
    check(by_s=2)
    check(room=next(name for name in rooms.names if name != rooms.start))


def test_what_could_not_be_looked_up_then_fails_the_job_when_it_starts(
    service: Service, ordered: Callable[..., dict[str, Any]], prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    order, get_bytes = ordered([NEAR, IN_THE_CELLAR]), service.store.get_bytes

    def refuse(*arguments: object) -> bytes:
        raise StorageUnavailableError("503 Slow Down")

    monkeypatch.setattr(service.store, "get_bytes", refuse)
    arn = call("CreateSimulationJob", order, service)["arn"]
    monkeypatch.setattr(service.store, "get_bytes", get_bytes)

    job = registry()["CreateSimulationJob"].perform(arn, service)

    assert (job["status"], job["failureCode"]) == ("Failed", "InvalidInput")
    assert re.match(rf"requirements{THERE_IS_NONE}", job["failureReason"])


def test_a_body_that_the_model_has_not_fails_the_job_at_its_first_step(drive: Drive) -> None:
    job, _ = drive(requirements=[{"kind": "goal", "name": "there", "x": 0.0, "y": 0.0, "body": "scoot/base"}])
    assert (job["status"], job["failureCode"]) == ("Failed", "InvalidInput")
    assert job["failureReason"].startswith(
        "requirement there (goal): the model has no body 'scoot/base'; did you mean 'scout/base'?"
    )


def test_a_variable_that_cannot_be_understood_is_refused(service: Service) -> None:
    config = {
        "application": "indoor-navigation",
        "launchConfig": {"environmentVariables": {"ROBOMAKER_REQUIREMENTS": '[{"kind": "goal"}]'}},
    }
    order = {"maxJobDurationInSeconds": 9, "iamRole": ROLE, "simulationApplications": [config]}
    with pytest.raises(InvalidParameterException, match=r"environmentVariables\.ROBOMAKER_REQUIREMENTS\[0\]\.name"):
        call("CreateSimulationJob", order, service)
