"""Fleets and deployments as they are seen: found by name, followed to their end, told, and reported."""

from datetime import timedelta

import pytest
from helpers.deployed_robots import Yard, bad, deployable, good, slow

from prefect_robomaker.schemas.fleet.documents import RobotInstallation, RobotSighting
from prefect_robomaker.schemas.wire.errors import InvalidParameterException, ResourceNotFoundException
from prefect_robomaker.tasks.fleet.catalog_rollouts import Rollouts
from prefect_robomaker.tasks.fleet.deployment_runs import POLL_S
from prefect_robomaker.tasks.fleet.fleet_records import enrol, last_deployment
from prefect_robomaker.tasks.fleet.kept_rollouts import open_rollouts
from prefect_robomaker.tasks.fleet.views.deployment_report import report_of, report_path, write_report
from prefect_robomaker.tasks.fleet.views.fleet_standings import (
    Look,
    deployment_standing,
    find_deployment,
    find_fleet,
    fleet_standing,
    follow,
)
from prefect_robomaker.tasks.fleet.views.rollout_tables import robot_rows
from prefect_robomaker.tasks.service.service import Service

HALF = {"concurrentDeploymentPercentage": 50, "failureThresholdPercentage": 60}


class Enough(BaseException):
    """Stops a run in the middle."""


@pytest.fixture
def yard(service: Service) -> Yard:
    return Yard(service)


def deploy(yard: Yard, token: str = "once", **config: object) -> str:
    found = yard.service.catalog.find("robot-application", "mine")
    application = deployable(yard.fleets, "X86_64") if found is None else found.arn
    return yard.fleets.deploy(yard.arn, application, token, deploymentConfig={**HALF, **config})["arn"]


def run_for(yard: Yard, job: str, looks: int) -> None:
    def stop() -> None:
        raise Enough

    yard.at_look[yard.looks + looks] = stop
    with pytest.raises(Enough):
        yard.run(job)


def test_a_fleet_is_found_by_name_and_arn(yard: Yard) -> None:
    assert find_fleet("yard", yard.service).arn == yard.arn == find_fleet(yard.arn, yard.service).arn
    with pytest.raises(InvalidParameterException, match="there is no fleet named 'dock'"):
        find_fleet("dock", yard.service)
    robot = yard.robot("r0", good)
    with pytest.raises(InvalidParameterException, match="names a robot; it has to name a deployment-fleet"):
        find_fleet(robot, yard.service)


def test_a_deployment_is_found_by_arn_by_fleet_and_alone(yard: Yard) -> None:
    yard.robot("r0", good)
    with pytest.raises(InvalidParameterException, match="fleet 'yard' has had no deployment"):
        find_deployment("yard", yard.service)
    with pytest.raises(InvalidParameterException, match="no deployment goes on"):
        find_deployment(None, yard.service)
    job = deploy(yard)
    assert {find_deployment(named, yard.service).arn for named in (None, "yard", yard.arn, job)} == {job}
    with pytest.raises(ResourceNotFoundException):
        find_deployment(job + "x", yard.service)

    dock = yard.fleets.fleet("dock")
    yard.fleets.robot("d0", dock)
    other = yard.fleets.deploy(dock, find_application(yard), "dock")["arn"]
    with pytest.raises(InvalidParameterException, match="deployments to 2 fleets go on: dock, yard; name one of them"):
        find_deployment(None, yard.service)
    yard.fleets.cancel(job)
    assert find_deployment(None, yard.service).arn == other


def find_application(yard: Yard) -> str:
    found = yard.service.catalog.find("robot-application", "mine")
    assert found is not None
    return found.arn


def test_how_a_fleet_stands(yard: Yard) -> None:
    robots = [yard.robot(f"r{number}", each) for number, each in enumerate((good, bad, slow, good))]
    enrol("r0", yard.service, lambda count: bytes(count), rotate=False)
    yard.service.catalog.update(robots[0], RobotSighting(last_seen_s=yard.now.timestamp()))
    yard.service.catalog.update(robots[3], RobotInstallation(installed_name="mine", installed_version="7"))
    fleet = find_fleet("yard", yard.service)
    assert fleet_standing(fleet, yard.service).deployment is None
    job = deploy(yard)
    waiting = fleet_standing(fleet, yard.service).deployment
    assert waiting is not None
    assert (waiting.status, waiting.waves, waiting.counts) == ("Pending", None, {})

    run_for(yard, job, 8)

    standing = fleet_standing(fleet, yard.service)
    assert [robot.robot for robot in standing.robots] == ["r0", "r1", "r2", "r3"]
    assert [robot.status for robot in standing.robots] == ["InSync", "Failed", "Deploying", "Deploying"]
    r0, r1, r2, r3 = standing.robots
    assert (r0.kind, r0.last_seen) == ("updater", yard.now.replace(microsecond=0) - timedelta(seconds=8 * POLL_S))
    assert (r1.kind, r1.failure_code, r1.failure_reason) == (None, "PreLaunchFileFailure", "no arm")
    assert r0.order is r1.order is None
    assert r2.order is not None
    assert (r2.order.state, r2.order.step) == ("fetched", None)
    assert r3.order is not None
    assert (r3.version, r3.order.step, r3.order.percent_done) == ("mine 7", "DownloadingExtracting", 25.0)
    deployment = standing.deployment
    assert deployment is not None
    assert (deployment.application, deployment.version, deployment.wave, deployment.waves) == ("mine", "1", 2, 2)
    assert deployment.counts == {"succeeded": 1, "failed": 1, "deploying": 2}
    assert (deployment.failed_percent, deployment.threshold_percent) == (25.0, 60)


def test_a_deployment_is_followed_to_its_end(yard: Yard, monkeypatch: pytest.MonkeyPatch) -> None:
    yard.robot("r0", good)
    yard.robot("r1", bad)
    job = deploy(yard)
    looks: list[Look] = []
    steps = yard.service
    reads: list[str] = []
    read = Rollouts.rollout
    monkeypatch.setattr(Rollouts, "rollout", lambda self, arn: reads.append(arn) or read(self, arn))
    slept: list[float] = []

    def sleep(duration_s: float) -> None:
        slept.append(duration_s)
        if len(slept) == 3:
            yard.run(job)

    for look in follow(find_deployment(job, steps), steps, sleep):
        looks.append(look)
        if len(looks) == 2:
            reads.clear()

    assert [look.job.status for look in looks] == ["Pending"] * 3 + ["Succeeded"]
    assert looks[-1].rollout is not None
    assert {robot: state.outcome for robot, state in looks[-1].rollout.robots.items()} != {}
    assert looks[-1].waves == [tuple(looks[-1].rollout.plan.order[:1]), tuple(looks[-1].rollout.plan.order[1:])]
    assert slept == [1.0] * 3


def test_what_has_not_changed_is_not_read_again(yard: Yard, monkeypatch: pytest.MonkeyPatch) -> None:
    yard.robot("r0", slow)
    job = deploy(yard)
    run_for(yard, job, 4)
    reads: list[str] = []
    read = Rollouts.rollout
    monkeypatch.setattr(Rollouts, "rollout", lambda self, arn: reads.append(arn) or read(self, arn))

    looks = follow(find_deployment(job, yard.service), yard.service, lambda _: None)
    seen = [next(looks) for _ in range(5)]

    assert len(reads) <= 2
    assert all(look.rollout == seen[0].rollout for look in seen)
    yard.fleets.cancel(job)
    assert next(looks).job.status == "Canceled"
    assert list(looks) == []


def test_each_deployment_ends_with_a_report(yard: Yard) -> None:
    robots = [yard.robot("r0", good), yard.robot("r1", bad)]
    yard.service.catalog.update(robots[0], RobotInstallation(installed_name="mine", installed_version="0"))
    job = deploy(yard)
    resource = yard.service.catalog.get(job)
    assert not report_path(resource, yard.service).exists()

    yard.run(job)

    page = report_path(resource, yard.service).read_text()
    for word in ("mine 1 to yard", "Succeeded", "PreLaunchFileFailure", "no arm", "mine 0", "r0", "r1"):
        assert word in page
    report = report_of(yard.service.catalog.get(job), yard.service)
    assert report.waves == ((robots[0],), (robots[1],))
    assert report.rollout is not None
    state = report.rollout.robots[robots[0]]
    assert state.offered_s is not None
    assert state.started_s is not None
    assert state.finished_s is not None
    assert state.offered_s <= state.started_s < state.step_times["DownloadingExtracting"] < state.finished_s


def test_a_report_can_be_written_at_any_time(yard: Yard, tmp_path) -> None:
    yard.robot("r0", slow)
    job = deploy(yard)
    pending = write_report(yard.service.catalog.get(job), yard.service, tmp_path / "pending.html")
    assert "Pending" in pending.read_text()
    run_for(yard, job, 4)
    assert "In progress" in write_report(yard.service.catalog.get(job), yard.service).read_text()


def test_a_report_that_cannot_be_written_fails_nothing(yard: Yard, caplog: pytest.LogCaptureFixture) -> None:
    yard.robot("r0", good)
    yard.service.settings.home.joinpath("deployments").write_text("in the way")

    assert yard.run(deploy(yard))["status"] == "Succeeded"
    assert "could not be written" in caplog.text


def test_rows_for_prefect(yard: Yard) -> None:
    robots = [yard.robot("r0", good), yard.robot("r1", bad)]
    job = deploy(yard)
    yard.run(job)
    (rollout,) = [look.rollout for look in follow(yard.service.catalog.get(job), yard.service, lambda _: None)]
    assert rollout is not None

    first, second = robot_rows(rollout, robots)

    assert (first["robot"], first["status"], first["failure code"]) == ("r0", "InSync", None)
    assert isinstance(first["took s"], float)
    assert (second["status"], second["failure code"], second["reason"]) == ("Failed", "PreLaunchFileFailure", "no arm")
    standing = deployment_standing(yard.service.catalog.get(job), rollout, yard.now.timestamp())
    assert standing.counts == {"succeeded": 1, "failed": 1}
    assert open_rollouts(yard.service) == []


def test_a_window_that_is_closed_is_seen(yard: Yard) -> None:
    yard.robot("r0", good)
    opens = yard.now + timedelta(hours=2)
    window = {"startTime": opens.strftime("%H:%M"), "durationInSeconds": 3600}
    job = deploy(yard, maintenanceWindows=[window])
    run_for(yard, job, 5)

    seen = fleet_standing(yard.service.catalog.get(yard.arn), yard.service).deployment
    report = report_of(yard.service.catalog.get(job), yard.service)

    assert seen is not None
    assert [wait.cause for wait in seen.waits] == ["MAINTENANCE_WINDOW"]
    (note,) = report.notes
    assert note.startswith("waits for its maintenance window, which opens at ")
    assert report.rollout is not None
    assert [(each.from_s, each.until_s) for each in report.closed] == [(report.rollout.began_s, yard.now.timestamp())]


def test_both_sides_of_a_rollback_are_seen(yard: Yard) -> None:
    yard.robot("r0", good)
    yard.robot("r1", good)
    first = deploy(yard, "first")
    yard.run(first)
    yard.behaviours = dict.fromkeys(yard.behaviours, bad)
    application = find_application(yard)
    yard.fleets.call(
        "UpdateRobotApplication",
        application=application,
        robotSoftwareSuite={"name": "General"},
        sources=[{"s3Bucket": "apps", "s3Key": "X86_64.tar.gz", "architecture": "X86_64"}],
    )
    yard.fleets.call("CreateRobotApplicationVersion", application=application)
    robots = list(yard.behaviours)
    yard.behaviours[robots[0]] = good
    had = RobotInstallation(installed_name="mine", installed_version="1", installed_by=first)
    yard.service.catalog.update(robots[0], had)
    config = {**HALF, "failureThresholdPercentage": 50, "onThresholdBreached": "ROLLBACK"}
    failed = yard.fleets.deploy(
        yard.arn, application, "second", config={"applicationVersion": "2"}, deploymentConfig=config
    )["arn"]
    yard.run(failed)

    report = report_of(yard.service.catalog.get(failed), yard.service)
    back = last_deployment(yard.arn, yard.service)

    assert back is not None
    assert report.notes == (f"robots go back by {back.id}",)
    assert report_of(back, yard.service).notes == (f"brings robots back after {failed.rpartition('/')[2]} failed",)
