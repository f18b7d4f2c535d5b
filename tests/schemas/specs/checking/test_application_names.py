"""Applications that jobs name: built-in ones, those that steps make, and others, which only the catalog may know."""

import json
from typing import Any

import pytest

from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.checking.application_names import BUILT_IN
from prefect_robomaker.tasks.service.service import BUILTINS

ROLE = "arn:aws:iam::000000000000:role/x"


def notes(robot: str, *steps: dict[str, Any], simulation: str = "indoor-navigation") -> list[str]:
    job = {
        "iamRole": ROLE,
        "maxJobDurationInSeconds": 60,
        "robotApplications": [{"application": robot, "launchConfig": {}}],
        "simulationApplications": [
            {"application": simulation, "launchConfig": {}, "worldConfigs": [{"world": "${{ item }}"}]}
        ],
    }
    batch = {"createSimulationJobRequests": {"forEach": ["arn:a"], "value": {**job, "tags": {"world": "${{ item }}"}}}}
    named = {f"made_{number}": step for number, step in enumerate(steps)}
    spec = {
        "version": 1,
        "name": "night",
        "steps": {**named, "drive": {"operation": "StartSimulationJobBatch", "input": batch}},
    }
    return [f"{note.path.split('.')[-2]}: {note.message}" for note in load_spec(json.dumps(spec), "s.json").notes]


def made(name: str) -> dict[str, Any]:
    request = {"name": name, "robotSoftwareSuite": {"name": "General"}, "environment": {"uri": "python://rover"}}
    return {"operation": "CreateRobotApplication", "input": request}


def test_the_built_in_applications_are_those_of_the_service() -> None:
    known = {(name, f"{kind}-application") for kind, names in BUILT_IN.items() for name in names}

    assert known == {(name, kind) for name, (kind, _) in BUILTINS.items()}


@pytest.mark.parametrize("robot", ["scout", "walker", "arn:aws:robomaker:us-east-1:000000000000:robot-application/a/1"])
def test_what_is_there_or_is_no_name_is_not_noted(robot: str) -> None:
    assert notes(robot) == []


def test_a_name_of_neither_is_noted_with_the_nearest_one() -> None:
    assert notes("scouty") == [
        "robotApplications[0]: there is no built-in robot application 'scouty', and no step makes one; did you mean "
        "'scout'? If it is in the catalog, a run finds it"
    ]
    assert notes("scout", simulation="warehouse") == [
        "simulationApplications[0]: there is no built-in simulation application 'warehouse', and no step makes one; if "
        "it is in the catalog, a run finds it"
    ]


def test_what_a_step_makes_is_there() -> None:
    assert notes("rover", made("rover")) == []
    (note,) = notes("rovr", made("rover"))
    assert "did you mean 'rover'?" in note


def test_where_a_step_makes_what_only_the_run_knows_nothing_is_noted() -> None:
    worlds = {"operation": "ListWorlds"}
    assert notes("rovr", worlds, made("${{ made_0.worldSummaries[0].arn }}")) == []
