"""Files for robots go when no deployment and no robot needs them, and not before."""

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest
from helpers.deployed_robots import Yard, good, silent
from helpers.fleet_calls import Fleets
from helpers.trusting_robots import TrustingRobot

from prefect_robomaker.schemas.reports.retention import GcReport, RetentionPolicy
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.fleet.trust.publishing import publisher_of
from prefect_robomaker.tasks.fleet.trust.roles import TIMESTAMPS
from prefect_robomaker.tasks.retention.collection import collect, plan_collection
from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def yard(service: Service) -> Yard:
    """A fleet of an agent and a robot with another updater, which have had two deployments."""
    yard = Yard(service, datetime.now(UTC))
    yard.robot("agent", good)
    yard.fleets.let_agents_in(yard.arn)
    yard.robot("other", good)
    for name in ("first", "second"):
        application = archive_of(yard.fleets, name)
        assert yard.run(yard.fleets.deploy(yard.arn, application, name)["arn"])["status"] == "Succeeded"
    return yard


def archive_of(fleets: Fleets, name: str) -> str:
    """An application with an archive of its own."""
    fleets.service.store.ensure_bucket("apps")
    fleets.service.store.put_bytes("apps", name, f"archive of {name}".encode())
    return fleets.application(name, sources=[{"s3Bucket": "apps", "s3Key": name}])


def collected(yard: Yard, keep: int, *, act: bool = True) -> GcReport:
    return (collect if act else plan_collection)(RetentionPolicy(keep_deployments=keep), yard.service)


def keys(yard: Yard) -> list[str]:
    return [info.key for info in yard.service.store.list("robomaker", "robots/")]


def robot(yard: Yard, folder: Path) -> TrustingRobot:
    publisher = publisher_of(yard.service)
    return TrustingRobot(publisher.files, publisher.files.metadata("root", 1), folder)


def documents(yard: Yard) -> list[str]:
    """Paths of the documents that the repository names."""
    publisher = publisher_of(yard.service)
    repository = publisher.read(publisher.root(), None)
    assert repository is not None
    named = [path for each in repository.applications.values() for path in each.signed.targets]
    return [path for path in named if "/deployments/" in path]


def test_files_of_old_deployments_go(yard: Yard, tmp_path: Path) -> None:
    before = keys(yard)
    planned = collected(yard, 1, act=False)
    assert keys(yard) == before
    (item,) = planned.items
    assert (item.kind, item.action, item.problem) == ("robot-files", "remove", None)

    report = collected(yard, 1)

    assert [each.objects for each in report.items] == [item.objects]
    (left,) = documents(yard)
    assert left.startswith("applications/second/")
    document = json.loads(robot(yard, tmp_path).content(left) or b"")
    assert robot(yard, tmp_path).content(document["bundles"]["X86_64"])
    assert len([key for key in keys(yard) if key.endswith(".swu")]) == 1
    assert not [key for key in keys(yard) if "targets/applications/first/" in key]
    assert not [each for each in collected(yard, 1).items if each.problem]


def test_what_robots_run_stays_without_any_rule(yard: Yard) -> None:
    collected(yard, 0)
    (left,) = documents(yard)
    assert left.startswith("applications/second/"), "the last deployment of both robots"
    assert len([key for key in keys(yard) if key.endswith(".swu")]) == 1


def test_what_an_absent_robot_still_gets_stays(yard: Yard) -> None:
    robot = yard.robot("absent", silent)
    yard.fleets.let_agents_in(yard.arn)
    config = {"robotDeploymentTimeoutInSeconds": 60, "failureThresholdPercentage": 100}
    yard.run(
        yard.fleets.deploy(yard.arn, archive_of(yard.fleets, "third"), "third", deploymentConfig=config)["arn"],
        yard.stride,
    )
    assert yard.fleets.described(robot)["status"] == "NoResponse"
    collected(yard, 0)
    assert [each for each in documents(yard) if each.startswith("applications/third/")]


def test_while_a_deployment_prepares_nothing_goes(yard: Yard) -> None:
    before = keys(yard)
    yard.fleets.deploy(yard.arn, archive_of(yard.fleets, "third"), "third")

    report = collected(yard, 0)

    assert keys(yard) == before
    assert "is Pending, and may need them" in report.notes[-1]


def test_old_timestamps_and_what_they_led_to_go(yard: Yard, tmp_path: Path) -> None:
    for _ in range(20):
        yard.sleep(18 * 3600)
        publisher_of(yard.service).keep_up()
    numbers = [key for key in keys(yard) if key.startswith(TIMESTAMPS)]
    assert len(numbers) >= 20

    collected(yard, 1)

    left = [key for key in keys(yard) if key.startswith(TIMESTAMPS)]
    assert 5 < len(left) < 15
    repository = publisher_of(yard.service).read(publisher_of(yard.service).root(), None)
    assert repository is not None
    assert not [key for key in keys(yard) if key.endswith("/1.snapshot.json")]
    assert [key for key in keys(yard) if key.endswith("/1.root.json")]


def test_a_rule_is_needed() -> None:
    with pytest.raises(ConfigurationError, match="nothing says what is to be removed"):
        RetentionPolicy().check()
    RetentionPolicy(keep_deployments=3).check()
