"""Runs of deployment jobs: what becomes true of the job and of its robots, in simulated time."""

from dataclasses import replace
from typing import Any

import pytest
from helpers.deployed_robots import Yard, bad, deployable, good, silent, slow

from prefect_robomaker.schemas.fleet.rollouts.rollout_plan import Artifact
from prefect_robomaker.schemas.wire.errors import ConcurrentDeploymentException
from prefect_robomaker.tasks.catalog import Catalog
from prefect_robomaker.tasks.execution.leases.giving_up import MAX_LOST_WORKERS
from prefect_robomaker.tasks.fleet.catalog_rollouts import Rollouts
from prefect_robomaker.tasks.fleet.control.deployment_decisions import approve, pause, resume
from prefect_robomaker.tasks.fleet.kept_rollouts import open_rollouts
from prefect_robomaker.tasks.service.service import Service

BOTH = ("X86_64", "ARM64")
ALL_AT_ONCE = {"concurrentDeploymentPercentage": 100, "failureThresholdPercentage": 100}
SHORT = {**ALL_AT_ONCE, "robotDeploymentTimeoutInSeconds": 60}


@pytest.fixture
def yard(service: Service) -> Yard:
    return Yard(service)


def deployed(yard: Yard, config: dict[str, Any] | None = None, token: str = "once") -> str:
    """Makes a deployment and returns its ARN."""
    members = {} if config is None else {"deploymentConfig": config}
    found = yard.fleets.service.catalog.find("robot-application", "mine")
    application = deployable(yard.fleets, *BOTH) if found is None else found.arn
    return yard.fleets.deploy(yard.arn, application, token, **members)["arn"]


def summary(job: dict[str, Any]) -> dict[str, tuple[str | None, str | None]]:
    """Status and failure code of each robot, by name."""
    return {
        robot["arn"].split("/")[1]: (robot.get("status"), robot.get("failureCode"))
        for robot in job["robotDeploymentSummary"]
    }


def test_a_deployment_reaches_each_robot_in_waves(yard: Yard) -> None:
    robots = [yard.robot(f"r{number}", good, architecture=BOTH[number % 2]) for number in range(5)]

    job = yard.run(deployed(yard, {"concurrentDeploymentPercentage": 40}))

    assert job["status"] == "Succeeded"
    assert "failureCode" not in job
    assert job["deploymentConfig"] == {
        "concurrentDeploymentPercentage": 40,
        "failureThresholdPercentage": 20,
        "robotDeploymentTimeoutInSeconds": 18000,
    }
    assert summary(job) == {f"r{number}": ("InSync", None) for number in range(5)}
    assert all("deploymentFinishTime" in robot for robot in job["robotDeploymentSummary"])
    assert yard.statuses() == dict.fromkeys(["r0", "r1", "r2", "r3", "r4"], "InSync")
    assert yard.most_open == 2
    assert yard.offered == robots, "in the order in which they were registered"
    assert open_rollouts(yard.service) == []
    assert Rollouts(yard.service.catalog).events(job["arn"]) == ()


def test_what_is_under_way_is_described(yard: Yard) -> None:
    yard.robot("r0", good)
    yard.robot("r1", good)
    arn = deployed(yard, {"concurrentDeploymentPercentage": 50})
    seen: list[dict[str, Any]] = []
    yard.at_look[3] = lambda: seen.append(yard.fleets.described(arn))

    yard.run(arn)

    (job,) = seen
    assert job["status"] == "InProgress"
    assert summary(job) == {"r0": ("Deploying", None), "r1": ("PendingNewDeployment", None)}
    detail = job["robotDeploymentSummary"][0]["progressDetail"]
    assert (detail["currentProgress"], detail["percentDone"]) == ("DownloadingExtracting", 25.0)
    assert detail["targetResource"] == arn


def test_failures_below_the_threshold_are_borne(yard: Yard) -> None:
    for number in range(4):
        yard.robot(f"r{number}", bad if number == 2 else good)

    job = yard.run(deployed(yard, {"concurrentDeploymentPercentage": 50, "failureThresholdPercentage": 50}))

    assert job["status"] == "Succeeded"
    assert summary(job)["r2"] == ("Failed", "PreLaunchFileFailure")
    assert job["robotDeploymentSummary"][2]["failureReason"] == "no arm"
    assert yard.statuses() == {"r0": "InSync", "r1": "InSync", "r2": "Failed", "r3": "InSync"}


def test_at_the_threshold_no_robot_gets_an_order_any_more(yard: Yard) -> None:
    robots = [yard.robot(f"r{number}", bad) for number in range(4)]

    job = yard.run(deployed(yard, {"concurrentDeploymentPercentage": 25, "failureThresholdPercentage": 50}))

    assert (job["status"], job["failureCode"]) == ("Failed", "FailureThresholdBreached")
    assert "2 of 4 robots failed" in job["failureReason"]
    assert yard.offered == robots[:2]
    assert yard.statuses() == {"r0": "Failed", "r1": "Failed", "r2": "Registered", "r3": "Registered"}


def test_a_robot_that_is_away_times_out_and_returns_later(yard: Yard) -> None:
    yard.robot("r0", good)
    away = yard.robot("r1", silent)

    job = yard.run(deployed(yard, SHORT), yard.stride)

    assert job["status"] == "Succeeded"
    assert summary(job)["r1"] == ("NoResponse", "RobotDeploymentNoResponse")
    assert yard.statuses() == {"r0": "InSync", "r1": "NoResponse"}

    yard.behaviours[away] = good
    for _ in range(8):
        yard.act()

    assert yard.statuses() == {"r0": "InSync", "r1": "InSync"}
    assert open_rollouts(yard.service) == []
    assert yard.fleets.described(job["arn"])["status"] == "Succeeded"


def test_a_robot_that_falls_silent_fails(yard: Yard) -> None:
    yard.robot("r0", slow)

    job = yard.run(deployed(yard, SHORT), yard.stride)

    assert (job["status"], job["failureCode"]) == ("Failed", "FailureThresholdBreached")
    assert summary(job) == {"r0": ("Failed", "RobotAgentConnectionTimeout")}


def test_a_cancel_ends_the_job_at_once_and_robots_give_up_their_orders(yard: Yard) -> None:
    yard.robot("r0", slow)
    yard.robot("r1", slow)
    arn = deployed(yard, {"concurrentDeploymentPercentage": 50})
    at_once: list[str] = []

    def cancel() -> None:
        yard.fleets.cancel(arn)
        at_once.append(yard.fleets.described(arn)["status"])

    yard.at_look[4] = cancel

    job = yard.run(arn)

    assert at_once == [job["status"]] == ["Canceled"]
    assert yard.looks <= 6, "the run ends soon after"
    assert summary(job) == {"r0": ("Failed", "RobotDeploymentAborted"), "r1": ("Registered", None)}
    yard.act()
    yard.act()
    assert open_rollouts(yard.service) == [], "the robot has answered"


def test_an_interrupted_run_cancels_what_it_did(yard: Yard) -> None:
    yard.robot("r0", slow)
    arn = deployed(yard)
    yard.at_look[4] = lambda: yard.service.catalog.request_cancel(arn)

    assert yard.run(arn)["status"] == "Canceled"


def test_another_run_goes_on_where_one_died(yard: Yard) -> None:
    robots = [yard.robot(f"r{number}", good) for number in range(6)]
    arn = deployed(yard, {"concurrentDeploymentPercentage": 34})

    class Killed(BaseException):
        pass

    def kill() -> None:
        raise Killed

    for look in (1, 4, 7, 10, 11, 15):
        yard.at_look[look] = kill
        with pytest.raises(Killed):
            yard.run(arn)

    assert yard.run(arn)["status"] == "Succeeded"
    assert yard.offered == robots, "each once"
    assert yard.most_open == 2


def test_time_outs_stand_still_while_nothing_is_served(yard: Yard) -> None:
    yard.robot("r0", silent)
    arn = deployed(yard, SHORT)

    def night(_: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        yard.run(arn, sleep=night)
    yard.now = yard.now.replace(hour=13)
    yard.behaviours = dict.fromkeys(yard.behaviours, good)

    assert yard.run(arn)["status"] == "Succeeded"


def test_robots_that_depart_are_waited_for_no_longer(yard: Yard) -> None:
    kept, left, deleted = (yard.robot(name, slow) for name in ("kept", "left", "deleted"))
    arn = deployed(yard, ALL_AT_ONCE)
    yard.at_look[3] = lambda: yard.fleets.deregister(yard.arn, left)

    def delete() -> None:
        yard.fleets.call("DeleteRobot", robot=deleted)
        del yard.behaviours[deleted]

    yard.at_look[5] = delete
    yard.at_look[7] = lambda: yard.behaviours.update({kept: good})

    job = yard.run(arn)

    assert job["status"] == "Succeeded"
    assert summary(job) == {
        "kept": ("InSync", None),
        "left": ("Available", "RobotDeploymentAborted"),
        "deleted": (None, "RobotDeploymentAborted"),
    }
    yard.act()
    assert open_rollouts(yard.service) == [], "a robot that was deleted answers no more"


@pytest.mark.parametrize(
    ("gone", "code"), [("fleet", "DeploymentFleetDoesNotExist"), ("application", "RobotApplicationDoesNotExist")]
)
def test_what_is_deleted_under_way_fails_the_job(yard: Yard, gone: str, code: str) -> None:
    robot = yard.robot("r0", slow)
    arn = deployed(yard)
    application = yard.service.catalog.find("robot-application", "mine")
    assert application is not None
    deletions = {
        "fleet": lambda: yard.fleets.call("DeleteFleet", fleet=yard.arn),
        "application": lambda: yard.fleets.call("DeleteRobotApplication", application=application.arn),
    }
    yard.at_look[3] = deletions[gone]

    job = yard.run(arn)

    assert (job["status"], job["failureCode"]) == ("Failed", code)
    expected = "Available" if gone == "fleet" else "Failed"
    assert yard.fleets.described(robot)["status"] == expected
    yard.act()
    assert open_rollouts(yard.service) == []


def test_an_application_that_is_gone_before_fails_the_job(yard: Yard) -> None:
    yard.robot("r0", good)
    arn = deployed(yard)
    found = yard.service.catalog.find("robot-application", "mine")
    assert found is not None
    yard.fleets.call("DeleteRobotApplication", application=found.arn)

    job = yard.run(arn)

    assert (job["status"], job["failureCode"]) == ("Failed", "RobotApplicationDoesNotExist")
    assert yard.statuses() == {"r0": "Registered"}


def test_robots_that_are_not_asked_the_condition_fail_alone(yard: Yard) -> None:
    agent = yard.robot("r0", good)
    yard.fleets.let_agents_in(yard.arn)
    yard.robot("r1", good)
    yard.service.store.ensure_bucket("apps")
    yard.service.store.put_bytes("apps", "may.sh", b"exit 0")
    condition = {"downloadConditionFile": {"bucket": "apps", "key": "may.sh"}}

    job = yard.run(deployed(yard, {**ALL_AT_ONCE, **condition}))

    assert summary(job) == {"r0": ("InSync", None), "r1": ("Failed", "DownloadConditionFailed")}
    assert "only agents ask" in job["robotDeploymentSummary"][1]["failureReason"]
    assert yard.offered == [agent]


def test_a_condition_of_an_older_release_that_no_robot_is_asked_is_not_ignored(yard: Yard) -> None:
    yard.robot("r0", good)
    arn = deployed(yard)
    yard.fleets.give_condition(arn, {"bucket": "robomaker", "key": "may.sh"})

    job = yard.run(arn)

    assert (job["status"], job["failureCode"]) == ("Failed", "DownloadConditionFailed")
    assert yard.offered == []


def test_agents_and_updaters_of_others_each_get_their_own_files(yard: Yard) -> None:
    agent = yard.robot("r0", good)
    yard.fleets.let_agents_in(yard.arn)
    other = yard.robot("r1", good)
    seen: dict[str, Artifact] = {}
    yard.at_look[1] = lambda: seen.update(open_rollouts(yard.service)[0].artifacts)

    job = yard.run(deployed(yard, ALL_AT_ONCE))

    assert summary(job) == {"r0": ("InSync", None), "r1": ("InSync", None)}
    assert (seen[agent].target, seen[other].target) == (
        f"applications/mine/deployments/{job['arn'].rpartition('/')[2]}.json",
        None,
    )
    assert (seen[agent].key.endswith(".tar.gz"), seen[other].key.endswith(".swu")) == (True, True)


def test_nothing_is_wrapped_where_all_robots_have_agents(yard: Yard) -> None:
    yard.robot("r0", good)
    yard.fleets.let_agents_in(yard.arn)

    job = yard.run(deployed(yard))

    assert job["status"] == "Succeeded"
    assert not [info for info in yard.service.store.list("robomaker", "robots/") if info.key.endswith(".swu")]


def test_an_archive_that_is_gone_fails_the_job(yard: Yard) -> None:
    yard.robot("r0", good)
    arn = deployed(yard)
    yard.service.store.delete("apps", "X86_64.tar.gz")

    job = yard.run(arn)

    assert (job["status"], job["failureCode"]) == ("Failed", "ResourceNotFound")
    assert "X86_64.tar.gz" in job["failureReason"]


def test_robots_that_cannot_run_it_fail_alone(yard: Yard) -> None:
    yard.robot("r0", good)
    yard.robot("r1", good, architecture="ARMHF")
    seen: list[dict[str, str]] = []
    yard.at_look[2] = lambda: seen.append(yard.statuses())

    job = yard.run(deployed(yard))

    assert seen == [{"r0": "Deploying", "r1": "Failed"}]
    assert job["status"] == "Succeeded"
    assert summary(job) == {"r0": ("InSync", None), "r1": ("Failed", "MissingRobotApplicationArchitecture")}


def test_a_sync_reaches_robots_that_are_not_in_sync_and_no_others(yard: Yard) -> None:
    done, failed = yard.robot("r0", good), yard.robot("r1", bad)
    yard.run(deployed(yard, ALL_AT_ONCE))
    late = yard.robot("r2", good)
    yard.behaviours[failed] = good
    yard.offered.clear()

    sync = yard.fleets.call("SyncDeploymentJob", fleet=yard.arn, clientRequestToken="sync")
    waiting = {"r0": "InSync", "r1": "PendingNewDeployment", "r2": "PendingNewDeployment"}
    assert yard.statuses() == waiting
    assert sorted(summary(yard.fleets.described(sync["arn"]))) == ["r1", "r2"]
    job = yard.run(sync["arn"])

    assert job["status"] == "Succeeded"
    assert yard.offered == [failed, late]
    assert done not in yard.offered
    assert yard.statuses() == dict.fromkeys(("r0", "r1", "r2"), "InSync")

    again = yard.fleets.call("SyncDeploymentJob", fleet=yard.arn, clientRequestToken="again")
    nothing = yard.run(again["arn"])
    assert (nothing["status"], nothing["robotDeploymentSummary"]) == ("Succeeded", [])
    assert yard.statuses() == dict.fromkeys(("r0", "r1", "r2"), "InSync")


def test_a_fleet_has_one_deployment_at_a_time(yard: Yard) -> None:
    yard.robot("r0", slow)
    arn = deployed(yard)
    refused: list[str] = []

    def another() -> None:
        with pytest.raises(ConcurrentDeploymentException, match="InProgress") as error:
            deployed(yard, token="another")
        refused.append(str(error.value))
        yard.fleets.cancel(arn)

    yard.at_look[3] = another

    yard.run(arn)

    assert len(refused) == 1


def test_an_order_of_an_earlier_deployment_is_given_up_first(yard: Yard) -> None:
    robot = yard.robot("r0", slow)
    first = deployed(yard)

    def cancel() -> None:
        yard.fleets.cancel(first)
        yard.behaviours[robot] = silent

    yard.at_look[3] = cancel
    yard.run(first)
    before = Rollouts(yard.service.catalog).rollout(first)
    assert before is not None
    number = before.rollout["robots"][robot]["actionId"]

    told: list[int | None] = []
    yard.at_look[yard.looks + 1] = lambda: told.extend(
        each.rollout.robots[robot].earlier_action_id for each in open_rollouts(yard.service)
    )
    yard.behaviours[robot] = good
    job = yard.run(deployed(yard, token="second"))

    assert told == [number]
    assert job["status"] == "Succeeded"
    assert open_rollouts(yard.service) == []


def test_a_job_whose_workers_keep_dying_fails_and_its_robots_are_told(yard: Yard) -> None:
    yard.robot("r0", slow)
    arn = deployed(yard)
    catalog = yard.service.catalog

    def kill() -> None:
        raise KeyboardInterrupt

    yard.at_look[2] = kill
    with pytest.raises(KeyboardInterrupt):
        yard.run(arn)
    for number in range(MAX_LOST_WORKERS + 1):
        _die(catalog, arn, f"worker-{number}")

    job = yard.run(arn)

    assert (job["status"], job["failureCode"]) == ("Failed", "InternalServerError")
    yard.behaviours = dict.fromkeys(yard.behaviours, good)
    for _ in range(3):
        yard.act()
    assert yard.statuses() == {"r0": "Failed"}
    assert open_rollouts(yard.service) == []


def _die(catalog: Catalog, arn: str, owner: str) -> None:
    assert catalog.claim(arn, owner, -1)


def test_what_a_job_waits_for_is_said_once_each_time(yard: Yard) -> None:
    yard.robot("r0", good)
    arn = deployed(yard, {**ALL_AT_ONCE, "requiresApproval": True})
    notes: list[str] = []
    yard.service = replace(yard.service, report_note=notes.append)
    yard.at_look[5] = lambda: pause(arn, "ada", yard.service)
    yard.at_look[15] = lambda: resume(arn, yard.service)
    yard.at_look[25] = lambda: approve(arn, "ada", yard.service)

    assert yard.run(arn)["status"] == "Succeeded"

    said = [note.partition(": ")[2].partition(";")[0] for note in notes]
    assert said == ["waits for approval", "paused by ada", "waits for approval", "goes on"]
