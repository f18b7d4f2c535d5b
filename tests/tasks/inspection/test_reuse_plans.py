"""What a run would take over, told before it runs: what steps have not made yet is followed all the same."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.known_worlds import make_worlds
from helpers.small_flat import BODY, ROLE
from helpers.swing_fixtures import upload_swinger

from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.tasks.inspection.reuse_plans import NO_SEED, PlannedPart, plan_reuse
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

Plan = Callable[..., dict[str, list[PlannedPart]]]
TEMPLATE = {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": BODY}}
SUITE = {"name": "General"}


def worlds(count: int, **members: Any) -> dict[str, Any]:
    counts = {"floorplanCount": count, "interiorCountPerFloorplan": 1}
    return {
        "operation": "CreateWorldGenerationJob",
        "input": {"template": "${{ template.arn }}", "worldCount": counts, **members},
    }


def job(robot: str = "scout", world: str = "", **members: Any) -> dict[str, Any]:
    launch = {} if world else {"command": ["./drive"]}  # a program of its own needs no world
    simulation: dict[str, Any] = {"application": "indoor-navigation", "launchConfig": launch}
    if world:
        simulation["worldConfigs"] = [{"world": world}]
    request = {
        "maxJobDurationInSeconds": 60,
        "iamRole": ROLE,
        "robotApplications": [{"application": robot, "launchConfig": launch}],
        "simulationApplications": [simulation],
        **members,
    }
    return {"operation": "CreateSimulationJob", "input": request}


@pytest.fixture
def plan(service: Service) -> Plan:
    """What a run of some steps would take over."""

    def tell(**steps: Any) -> dict[str, list[PlannedPart]]:
        checked = load_spec(json.dumps({"version": 1, "name": "night", "steps": steps}), "night.yaml")
        before = service.catalog.count()
        parts = plan_reuse(checked, service)
        assert service.catalog.count() == before, "a plan changes nothing"
        return parts

    return tell


def test_what_was_never_made_is_run(plan: Plan) -> None:
    first = "${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}"
    parts = plan(template=TEMPLATE, worlds=worlds(2, seed=7), drive=job(world=first, seed=1), loose=job())

    assert list(parts) == ["worlds", "drive", "loose"], "steps that make neither worlds nor jobs have no parts"
    assert {(each.reuse, each.why) for each in parts["worlds"]} == {
        (False, "no world of this template, seed and generator is there yet")
    }
    assert parts["drive"] == [PlannedPart("job", reuse=False, why="its world is generated first")]
    assert parts["loose"] == [PlannedPart("job", reuse=False, why=NO_SEED)]


@pytest.mark.usefixtures("known_worlds")
def test_trials_without_a_seed_begin_with_seed_0(plan: Plan, generate: Callable[..., dict[str, Any]]) -> None:
    world = generate(floorplans=1)["finishedWorldsSummary"]["succeededWorlds"][0]
    parts = plan(drive=job(world=world, trials={"seeds": 2}))

    assert parts["drive"] == [PlannedPart("job", reuse=False, why="no job had these inputs yet")]


def test_what_only_the_run_knows_is_said_to_be_so(plan: Plan) -> None:
    parts = plan(list={"operation": "ListWorlds"}, drive=job(world="${{ list.worldSummaries[0].arn }}", seed=1))

    assert parts["drive"][0].why.startswith("known only in the run: ")
    assert "gives nothing" in parts["drive"][0].why
    (told,) = plan(drive=job(robot="no-such-robot", seed=1))["drive"]
    assert told.why == "there is no robot application named 'no-such-robot'"


@pytest.mark.usefixtures("known_worlds")
def test_worlds_that_are_there_are_found(plan: Plan, generate: Callable[..., dict[str, Any]]) -> None:
    generate(floorplans=1)
    last = "${{ worlds.finishedWorldsSummary.succeededWorlds[1] }}"
    parts = plan(template=TEMPLATE, worlds=worlds(2, seed=7), drive=job(world=last, seed=1), others=worlds(1))

    assert [each.reuse for each in parts["worlds"]] == [True, False]
    assert parts["worlds"][0].why.startswith("found in generation-")
    assert parts["drive"][0].why == "its world is generated first"
    assert parts["others"][0].why == NO_SEED


@pytest.mark.usefixtures("known_worlds")
def test_jobs_with_and_without_diversity_share_no_world(
    plan: Plan, service: Service, template: str, tmp_path: Path
) -> None:
    request = worlds(1, seed=7, diversity=0)["input"] | {"template": template}
    make_worlds(service, call("CreateWorldGenerationJob", request, service)["arn"], 1, tmp_path)
    parts = plan(template=TEMPLATE, same=worlds(1, seed=7, diversity=0), other=worlds(1, seed=7, diversity=1))
    assert {name: [each.reuse for each in found] for name, found in parts.items()} == {"same": [True], "other": [False]}


def test_applications_that_steps_would_make_are_what_their_archives_are_now(
    plan: Plan, service: Service, tmp_path: Path
) -> None:
    upload_swinger(service, tmp_path)
    source = [{"s3Bucket": "applications", "s3Key": "swinger.tar.gz"}]
    runtime = {"name": "SimulationRuntime"}
    request = {"name": "swing", "sources": source, "robotSoftwareSuite": SUITE, "simulationSoftwareSuite": runtime}
    made = call("CreateSimulationApplication", request, service)["arn"]
    launch = {"packageName": "swinger", "launchFile": "make_environment", "environmentVariables": {"TIME_LIMIT_S": "1"}}

    def drive(application: str) -> dict[str, Any]:
        order = {
            "maxJobDurationInSeconds": 60,
            "iamRole": ROLE,
            "seed": 3,
            "robotApplications": [{"application": "pusher", "launchConfig": push}],
            "simulationApplications": [{"application": application, "launchConfig": launch}],
        }
        return {"operation": "CreateSimulationJob", "input": order, "needs": []}

    push = {"packageName": "swinger", "launchFile": "make_agent"}
    call("CreateRobotApplication", {"name": "pusher", "sources": source, "robotSoftwareSuite": SUITE}, service)
    ordered = call("CreateSimulationJob", drive(made)["input"], service)
    registry()["CreateSimulationJob"].run_job(ordered["arn"], service)  # pyright: ignore[reportOptionalCall]
    step = {"operation": "CreateSimulationApplication", "input": {**request, "name": "renamed"}, "ifExists": "update"}

    planned = {"swing": step, "drive": drive("${{ swing.arn }}")}
    assert [each.reuse for each in plan(**planned)["drive"]] == [True], "what it is counts, not its name"
    upload_swinger(service, tmp_path, b"another policy")
    assert [each.reuse for each in plan(**planned)["drive"]] == [False]
