"""Jobs whose applications need a world and that name none: refused before they run, in the words of the job itself."""

import json
from typing import Any

import pytest

from prefect_robomaker.schemas.runs.plan import why_a_world
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import SpecError

WORLD = "arn:aws:robomaker:us-east-1:000000000000:world/import-1/world-1"
INDOOR = {"application": "indoor-navigation", "launchConfig": {}}
SCOUT = {"application": "scout", "launchConfig": {}}
OWN = {"application": "warehouse", "launchConfig": {}}
PROGRAM = {"command": ["./drive"]}


def told(**members: Any) -> list[str]:
    """Texts about a batch of one job that is made for each of two worlds."""
    job = {"maxJobDurationInSeconds": 60, "tags": {"world": "${{ item }}"}, **members}
    requests = {"createSimulationJobRequests": {"forEach": [WORLD, WORLD], "value": job}}
    steps = {"drive": {"operation": "StartSimulationJobBatch", "input": requests}}
    try:
        load_spec(json.dumps({"version": 1, "name": "night", "steps": steps}), "s.json")
    except SpecError as error:
        return [f"{each.path.partition('.value.')[2]}: {each.message}" for each in error.problems]
    return []


@pytest.mark.parametrize(
    ("members", "path", "application"),
    [
        ({"simulationApplications": [INDOOR]}, "simulationApplications[0].worldConfigs", "indoor-navigation"),
        (
            {"simulationApplications": [{**INDOOR, "worldConfigs": []}]},
            "simulationApplications[0].worldConfigs",
            "indoor-navigation",
        ),
        (
            {"simulationApplications": [OWN], "robotApplications": [SCOUT]},
            "simulationApplications[0].worldConfigs",
            "scout",
        ),
        ({"robotApplications": [SCOUT]}, "simulationApplications", "scout"),
    ],
)
def test_a_job_that_needs_a_world_and_names_none_is_refused(members: Any, path: str, application: str) -> None:
    assert told(**members) == [f"{path}: is missing: {why_a_world(application)}"]


@pytest.mark.parametrize(
    "members",
    [
        {"simulationApplications": [{**INDOOR, "worldConfigs": [{"world": "${{ item }}"}]}]},
        {"simulationApplications": [{**INDOOR, "worldConfigs": "${{ item }}"}]},
        {"simulationApplications": [OWN]},
        {"simulationApplications": [{**INDOOR, "launchConfig": PROGRAM}]},
        {"simulationApplications": [OWN], "robotApplications": [{**SCOUT, "launchConfig": PROGRAM}]},
        {"simulationApplications": [OWN], "robotApplications": [SCOUT], "policy": "fixed:0,0"},
    ],
)
def test_a_job_that_names_a_world_or_brings_its_own_is_valid(members: Any) -> None:
    assert [each for each in told(**members) if "is missing" in each] == []
