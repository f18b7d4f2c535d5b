"""Requests of a challenge: which jobs are chosen, what their arms have in common, and what cannot be challenged."""

import json
from typing import Any

import pytest

from prefect_robomaker.schemas.operations.simulation_job_batches import StartSimulationJobBatchRequest
from prefect_robomaker.schemas.specs.challenge_requests import ChallengeCut, challenged_spec
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.resolving import resolve_input
from prefect_robomaker.schemas.specs.sabotages import BUILT_IN
from prefect_robomaker.schemas.specs.specification import CheckedSpec
from prefect_robomaker.schemas.wire.errors import SpecError

ROLE = "arn:aws:iam::000000000000:role/test"
SABOTAGES = BUILT_IN[:2]
ROBOT = {"robotApplications": [{"application": "robot", "launchConfig": {"command": ["./drive"]}}]}
ARMS = 1 + len(SABOTAGES)


def job(**members: Any) -> dict[str, Any]:
    application = {"application": "arena", "launchConfig": members.pop("launch", {})}
    return {"maxJobDurationInSeconds": 60, "simulationApplications": [application], **members}


def single(**members: Any) -> dict[str, Any]:
    return {"operation": "CreateSimulationJob", "input": {**job(**members), "iamRole": ROLE}}


def batch(*jobs: Any, **members: Any) -> dict[str, Any]:
    requests = jobs[0] if len(jobs) == 1 and "forEach" in jobs[0] else list(jobs)
    return {"operation": "StartSimulationJobBatch", "input": {"createSimulationJobRequests": requests, **members}}


def loaded(**steps: Any) -> CheckedSpec:
    return load_spec(json.dumps({"version": 1, "name": "night", "steps": steps}), "night.yaml")


def requests_of(spec: CheckedSpec, jobs: int) -> list[dict[str, Any]]:
    """The batches that a challenge of some jobs orders, checked as the operation checks them."""
    challenged = challenged_spec(spec, jobs)
    cut = ChallengeCut.of(challenged, SABOTAGES, jobs)
    made = [
        cut(step.operation, resolve_input(step, {})) for step in map(challenged.steps.get, challenged.order) if step
    ]
    for each in made:
        StartSimulationJobBatchRequest.model_validate(each)
    return made


def test_each_job_runs_as_it_is_and_with_each_sabotage_with_one_seed() -> None:
    tags = {"robomaker:seed": "9", "team": "night"}
    text = json.dumps({"seeds": 5, "axes": {"SPEED": {"kind": "variable", "values": ["fast"]}}})
    launch = {"environmentVariables": {"ROBOMAKER_TRIALS": text, "GAIN": "1"}}
    [made] = requests_of(loaded(drive=batch(job(seed=4, video="always"), job(tags=tags, launch=launch))), 3)
    arms = made["createSimulationJobRequests"]

    assert [arm["tags"]["challenged-job"] for arm in arms] == ["1"] * ARMS + ["2"] * ARMS
    assert [arm["tags"].get("sabotage") for arm in arms] == [None, "idle", "blind"] * 2
    assert [arm["seed"] for arm in arms] == [4] * ARMS + [9] * ARMS
    assert {arm["tags"].get("team") for arm in arms[ARMS:]} == {"night"}
    assert {arm["video"] for arm in arms} == {"none"}
    assert {arm["trials"]["seeds"] for arm in arms} == {1}
    assert "axes" not in arms[0]["trials"]
    assert all(arm["trials"]["axes"]["SPEED"]["values"] == ["fast"] for arm in arms[ARMS:])
    variables = [arm["simulationApplications"][0]["launchConfig"].get("environmentVariables") for arm in arms]
    assert variables == [None] * ARMS + [{"GAIN": "1"}] * ARMS, "trials are ordered once"


def test_a_job_with_tags_of_such_names_has_its_control_arm() -> None:
    [made] = requests_of(loaded(drive=batch(job(tags={"sabotage": "of mine", "challenged-job": "9", "team": "a"}))), 1)
    tags = [arm["tags"] for arm in made["createSimulationJobRequests"]]
    assert [each.get("sabotage") for each in tags] == [None, "idle", "blind"]
    assert {(each["challenged-job"], each["team"]) for each in tags} == {("1", "a")}


def test_arms_without_a_seed_do_not_draw_their_own() -> None:
    [made] = requests_of(loaded(drive=batch(job())), 1)
    assert {arm["seed"] for arm in made["createSimulationJobRequests"]} == {0}


def test_a_single_job_becomes_a_batch_of_its_arms() -> None:
    [made] = requests_of(loaded(drive=single(clientRequestToken="x" * 10)), 3)
    assert len(made["createSimulationJobRequests"]) == ARMS
    assert "clientRequestToken" not in json.dumps(made)


@pytest.mark.parametrize(("jobs", "shares"), [(1, [1]), (2, [1, 1]), (3, [2, 1]), (5, [3, 2]), (50, [4, 3])])
def test_jobs_are_shared_among_steps(jobs: int, shares: list[int]) -> None:
    spec = loaded(first=batch(*[job(seed=seed) for seed in range(4)]), second=batch(*[job(seed=9)] * 3))
    made = requests_of(spec, jobs)
    assert [len(each["createSimulationJobRequests"]) // ARMS for each in made] == shares
    numbers = [arm["tags"]["challenged-job"] for each in made for arm in each["createSimulationJobRequests"]]
    assert len(set(numbers)) == sum(shares), "jobs of several steps have numbers of their own"


def test_a_batch_has_as_many_times_its_time() -> None:
    [made] = requests_of(loaded(drive=batch(job(), batchPolicy={"timeoutInSeconds": 600, "maxConcurrency": 2})), 1)
    assert made["batchPolicy"] == {"timeoutInSeconds": 600 * ARMS, "maxConcurrency": 2}


def test_only_steps_that_simulation_needs_run() -> None:
    template = {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": {"Version": "1"}}}
    worlds = {
        "operation": "CreateWorldGenerationJob",
        "input": {
            "template": "${{ template.arn }}",
            "worldCount": {"floorplanCount": 40, "interiorCountPerFloorplan": 1},
        },
    }
    world = job(simulationApplications=[
        {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": "${{ world }}"}]}
    ])  # fmt: skip
    each = {"forEach": "${{ worlds.finishedWorldsSummary.succeededWorlds }}", "as": "world", "value": world}
    export = {
        "operation": "CreateWorldExportJob",
        "input": {"worlds": each["forEach"], "outputLocation": {"s3Bucket": "bucket"}, "iamRole": ROLE},
    }
    spec = challenged_spec(loaded(template=template, worlds=worlds, export=export, drive=batch(each)), 3)
    assert spec.order == ("template", "worlds", "drive")

    cut = ChallengeCut.of(spec, SABOTAGES, 3)
    asked = {"template": "t", "worldCount": {"floorplanCount": 40, "interiorCountPerFloorplan": 1}}
    assert cut("CreateWorldGenerationJob", asked)["worldCount"]["floorplanCount"] == 3
    # A request may name any world where requests are listed one by one.
    listed = json.loads(
        json.dumps(world).replace("${{ world }}", "${{ worlds.finishedWorldsSummary.succeededWorlds[9] }}")
    )
    spec = challenged_spec(loaded(template=template, worlds=worlds, drive=batch(listed)), 3)
    cut = ChallengeCut.of(spec, SABOTAGES, 3)
    assert cut("CreateWorldGenerationJob", asked) == asked


@pytest.mark.parametrize(
    ("steps", "said"),
    [
        ({"read": {"operation": "ListWorlds", "input": {}}}, "night.yaml:1:1: steps: no step runs simulation jobs"),
        (
            {"drive": single(), "remove": {"operation": "DeleteSimulationApplication", "input": {"application": "a"}}},
            "which a challenge would do as well",
        ),
        (
            {"drive": single(), "again": single(tags={"after": "${{ drive.arn }}"})},
            "steps.again.input: uses what drive gives; a challenge runs other jobs there",
        ),
        (
            {"drive": batch(job(), job(launch={"command": ["./drive"]}))},
            "steps.drive.input: a job's simulation is a program",
        ),
        (
            {"drive": single(launch={"packageName": "p", "launchFile": "run.py"})},
            "challenges need a simulation application that is a factory",
        ),
        (
            {"drive": {**single(), "input": {"maxJobDurationInSeconds": 60, "iamRole": ROLE, **ROBOT}}},
            "or its robot program has none to drive",
        ),
    ],
)
def test_specifications_that_cannot_be_challenged_are_refused(steps: Any, said: str) -> None:
    with pytest.raises(SpecError, match=said):
        challenged_spec(loaded(**steps), 3)


def test_a_robot_program_that_drives_a_factorys_simulation_is_challenged() -> None:
    [made] = requests_of(loaded(drive=batch(job(seed=4, **ROBOT))), 3)
    arms = made["createSimulationJobRequests"]
    assert [arm["robotApplications"] for arm in arms] == [ROBOT["robotApplications"]] * ARMS
    assert [(arm.get("trials") or {}).get("axes") is not None for arm in arms] == [False, True, True]


def test_a_step_that_only_waits_for_another_is_challenged_too() -> None:
    spec = challenged_spec(loaded(drive=single(), again={**single(), "needs": ["drive"]}), 3)
    assert spec.order == ("drive", "again")
