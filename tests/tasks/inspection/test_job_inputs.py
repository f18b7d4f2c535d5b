"""Inputs of jobs: of requests, and of jobs that ran."""

from typing import Any

import pytest
from helpers.night_records import FIRST_NIGHT
from helpers.swing_fixtures import Simulate

from prefect_robomaker.schemas.documents.simulation_jobs import (
    MadeOf,
    ResolvedDataSource,
    ResolvedKey,
    SimulationJobDocument,
)
from prefect_robomaker.schemas.reports.report import ReportedJob
from prefect_robomaker.schemas.reports.run_record import StepRecord
from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.inspection.job_outputs import inputs_of_request, told_of_twins, with_inputs
from prefect_robomaker.tasks.inspection.reports import jobs_of
from prefect_robomaker.tasks.service.service import Service

ARN = "arn:aws:robomaker:us-east-1:000000000000:robot-application/scout/1542931200000"


def request(**members: Any) -> dict[str, Any]:
    robot = {"application": "scout", "launchConfig": {"environmentVariables": {"GAIN": "1"}}}
    return {"maxJobDurationInSeconds": 60, "robotApplications": [robot], **members}


def test_a_seed_is_given_by_member_or_tag() -> None:
    assert (inputs_of_request(request(seed=3), 3).seed, inputs_of_request(request(seed=3), 3).seed_given) == (3, True)
    tagged = inputs_of_request(request(tags={"robomaker:seed": "4"}), None)
    assert (tagged.seed, tagged.seed_given) == (4, True)
    chance = inputs_of_request(request(), 99)
    assert (chance.seed, chance.seed_given) == (99, False)
    assert inputs_of_request(request(), None).seed is None


def test_what_is_other_every_night_is_no_other_request() -> None:
    worlds = [{"world": "arn:aws:robomaker:us-east-1:000000000000:world/generation-1/world-1"}]
    simulation = {"application": "indoor-navigation", "launchConfig": {}}
    plain = inputs_of_request(request(simulationApplications=[simulation]), 1).request_sha256
    robot = {"application": ARN, "launchConfig": {"environmentVariables": {"GAIN": "1"}}}
    same = request(
        robotApplications=[robot], seed=8, tags={"night": "8"}, outputLocation={"s3Bucket": "nights"}, video="always",
        simulationApplications=[{**simulation, "worldConfigs": worlds}], iamRole="arn:aws:iam::000000000000:role/a",
    )  # fmt: skip
    assert inputs_of_request(same, 2).request_sha256 == plain
    faster = {"application": "scout", "launchConfig": {"environmentVariables": {"GAIN": "2"}}}
    for other in (
        request(robotApplications=[faster], simulationApplications=[simulation]),
        request(maxJobDurationInSeconds=61, simulationApplications=[simulation]),
        request(requirements=[{"kind": "time_limit", "limit_s": 1}], simulationApplications=[simulation]),
    ):
        assert inputs_of_request(other, 1).request_sha256 != plain


def test_trials_and_data_decide_the_result_too() -> None:
    """The values of an axis that a parameter sets, say; not which trials are recorded."""

    def digest_of(source: list[ResolvedDataSource] | None = None, **members: Any) -> str | None:
        return inputs_of_request(request(**members), 1, source or []).trials_and_data_sha256

    def delayed(value: float, **more: Any) -> dict[str, Any]:
        return {"seeds": 2, "axes": {"delay": {"kind": "motor_delay_s", "values": [value]}}, **more}

    plain = digest_of(trials=delayed(0))
    assert plain is not None
    assert plain == digest_of(trials=delayed(0, record=[1], record_failed=3), tags={"night": "2"})
    assert len({plain, digest_of(), digest_of(trials=delayed(0.6)), digest_of(trials=delayed(0, seeds=3))}) == 4

    asked = [{"name": "map", "s3Bucket": "maps", "s3Keys": ["a"]}]
    maps = [
        [ResolvedDataSource(name="map", s3_bucket="maps", s3_keys=[ResolvedKey(s3_key="a", etag=etag)])]
        for etag in "xy"
    ]
    assert digest_of(maps[0], dataSources=asked) != digest_of(maps[1], dataSources=asked)
    assert digest_of(dataSources=asked) is None, "its contents are not known"


def step_of(name: str, job: dict[str, Any]) -> StepRecord:
    return StepRecord(
        name=name, operation="CreateSimulationJob", status="Completed", started_at=FIRST_NIGHT, ended_at=FIRST_NIGHT,
        arn=job["arn"],
    )  # fmt: skip


@pytest.mark.deep
def test_a_job_that_crashed_has_the_applications_of_the_others(service: Service, swing: Simulate) -> None:
    steps = [step_of("one", swing()), step_of("two", swing(seed=4, KILL_AT="3"))]
    good, crashed = jobs_of(steps, service)
    assert (good.status, crashed.status) == ("Completed", "Failed")
    assert good.inputs is not None
    assert crashed.inputs is not None
    assert (good.inputs.seed, good.inputs.seed_given, good.inputs.world) == (3, True, None)
    assert [(used.role, used.name) for used in good.inputs.applications] == [
        ("robot", "pusher"),
        ("simulation", "swing"),
    ]
    assert all(len(used.digest) == 64 for used in good.inputs.applications)
    assert crashed.inputs.applications == good.inputs.applications
    assert crashed.inputs.request_sha256 != good.inputs.request_sha256


def test_jobs_that_went_through_the_same_states_are_said_to_be_one_trial(service: Service, swing: Simulate) -> None:
    jobs = [swing(TIME_LIMIT_S="1", seed=seed) for seed in (3, 3, 4)]
    steps = [step_of(f"job-{number}", job) for number, job in enumerate(jobs)]
    results = [job.result for job in jobs_of(steps, service)]
    note = "this and 1 other job of the run went through the same states: they count once"
    assert [result.remarks if result else None for result in results] == [[note], [note], []]


def test_an_axis_that_changes_nothing_is_named() -> None:
    """Not one that changes something elsewhere, as where the robot hits nothing."""

    def notes(states: dict[tuple[str, int], str]) -> list[list[str]]:
        jobs = [
            ReportedJob(
                label=f"sim-{number}", status="Completed", step="drive", seed=1,
                axes={"NOBODY_READS": text, "MASS": mass},
                result=RunResult(
                    verdict="PASS", sim_time_s=1, wall_time_s=1, real_time_factor=1, ended_by="agent", seed=1,
                    state_digest=digest,
                ),
            )
            for number, ((text, mass), digest) in enumerate(states.items())
        ]  # fmt: skip
        return [job.result.notes if job.result else [] for job in told_of_twins(jobs)]

    once = "this and 1 other job of the run went through the same states: they count once"
    idle = {("a", 1): "light", ("b", 1): "light", ("a", 2): "heavy", ("b", 2): "heavy"}
    assert notes(idle) == [[f"axis NOBODY_READS changed nothing: {once}"]] * 4
    assert notes({**idle, ("b", 2): "heavier"}) == [[once], [once], [], []]


def test_worlds_that_are_deleted_are_told_apart(service: Service) -> None:
    """A job that ran says itself which content its world had; of a request that became none there is the ARN."""
    first, second = (service.arn("world", f"generation-1/world-{number}") for number in (1, 2))
    document = SimulationJobDocument(request=request(), seed=1, made_of=MadeOf(world="content"))
    arn = service.arn("simulation-job", "sim-1")
    service.catalog.create(
        Resource.new(arn=arn, kind="simulation-job", id="sim-1", status="Completed", document=document), token=None
    )
    lost = inputs_of_request(request(), None)
    jobs = [
        ReportedJob(label="sim-1", arn=arn, status="Completed", world_arn=first),
        ReportedJob(label="request 2", status="NotCreated", world_arn=first, inputs=lost),
        ReportedJob(label="request 3", status="NotCreated", world_arn=second, inputs=lost),
        ReportedJob(label="request 4", status="NotCreated", inputs=lost),
    ]

    worlds = [job.inputs.world for job in with_inputs(jobs, service) if job.inputs]

    assert worlds == ["content", first, second, None]
