"""Robot and simulation applications: made, described, listed, changed and removed."""

from functools import partial
from typing import Any

import pytest
from helpers.application_calls import BUCKET, PACKAGE, Applications, at_once

from prefect_robomaker.schemas.wire.errors import (
    InvalidParameterException,
    ResourceAlreadyExistsException,
    ResourceNotFoundException,
)
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

BUILTIN = {"Robot": ("walker", "scout"), "Simulation": ("indoor-navigation", "recorded-run")}
OGRE = {"name": "OGRE", "version": "1.x"}
DIGEST = "sha256:" + "0123456789abcdef" * 4


@pytest.fixture(params=["Robot", "Simulation"])
def applications(request: pytest.FixtureRequest, service: Service) -> Applications:
    return Applications.of(request.param, service)


# Creating and describing


def test_what_was_made_is_answered_and_described_in_full(applications: Applications) -> None:
    image = "012345678901.dkr.ecr.us-west-2.amazonaws.com/my-app:latest"

    made = applications.create(environment={"uri": image}, tags={"team": "blue"})

    role = applications.role.lower()
    assert made["arn"].startswith(f"arn:aws:robomaker:us-east-1:000000000000:{role}-application/mine/")
    assert made == {
        "arn": made["arn"],
        "name": "mine",
        "version": "$LATEST",
        "environment": {"uri": image},
        **applications.suites,
        "lastUpdatedAt": made["lastUpdatedAt"],
        "revisionId": made["revisionId"],
        "tags": {"team": "blue"},
    }
    assert applications.describe(made["arn"]) == applications.describe("mine") == made
    assert applications.describe("mine", "$LATEST") == made


def test_sources_are_echoed_as_they_were_sent_with_the_etags_of_their_archives(applications: Applications) -> None:
    [plain] = applications.stored("mine.tar")
    [built] = applications.stored("arm/mine.tar", b"other")
    sources = [plain, {**built, "architecture": "ARM64"}]

    made = applications.create(sources=sources, environment={})

    etags = [applications.service.store.head(BUCKET, source["s3Key"]).etag for source in sources]
    assert made["sources"] == [{**source, "etag": etag} for source, etag in zip(sources, etags, strict=True)]
    assert "environment" not in made
    assert applications.describe("mine")["sources"] == made["sources"]


@pytest.mark.parametrize(
    ("robot", "simulation", "engine"),
    [
        ({"name": "ROS", "version": "Kinetic"}, {"name": "Gazebo", "version": "7"}, OGRE),
        ({"name": "ROS", "version": "Kinetic"}, {"name": "Gazebo", "version": "9"}, OGRE),
        ({"name": "ROS", "version": "Melodic"}, {"name": "Gazebo", "version": "9"}, OGRE),
        ({"name": "ROS2", "version": "Dashing"}, {"name": "Gazebo", "version": "9"}, OGRE),
        ({"name": "ROS2", "version": "Foxy"}, {"name": "Gazebo", "version": "11"}, OGRE),
        ({"name": "ROS", "version": "Melodic"}, {"name": "RosbagPlay", "version": "Melodic"}, None),
        ({"name": "General"}, {"name": "SimulationRuntime"}, None),
        ({}, {}, {}),
    ],
)
def test_suites_of_all_times_are_accepted_and_echoed(
    service: Service, robot: dict[str, str], simulation: dict[str, str], engine: dict[str, str] | None
) -> None:
    simulations = Applications.of("Simulation", service)
    suites: dict[str, Any] = {"robotSoftwareSuite": robot, "simulationSoftwareSuite": simulation}
    suites |= {} if engine is None else {"renderingEngine": engine}

    simulations.create(**suites, sources=simulations.stored("ros.tar"))
    Applications.of("Robot", service).create(robotSoftwareSuite=robot, sources=simulations.stored("ros.tar"))

    described = simulations.describe("mine")
    assert {key: described[key] for key in suites} == suites
    assert ("renderingEngine" in described) == (engine is not None)
    assert Applications.of("Robot", service).describe("mine")["robotSoftwareSuite"] == robot


def test_the_digest_in_an_images_name_is_described(applications: Applications) -> None:
    applications.create(environment={"uri": f"registry.example.com/my-app@{DIGEST}"})

    assert applications.describe("mine")["imageDigest"] == DIGEST


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({"sources": []}, "exactly one of sources and environment has to be given, but neither is"),
        ({"environment": {}}, "but neither is"),
        ({**PACKAGE, "sources": [{"s3Bucket": BUCKET, "s3Key": "k"}]}, "but both are"),
        ({"sources": [{"s3Bucket": "nowhere", "s3Key": "k"}]}, r"sources\[0\]: s3://nowhere/k cannot be read"),
        ({"environment": {"uri": "python://not-a-package"}}, "environment.uri: 'python://not-a-package' is no env"),
        ({"environment": {"uri": "python://"}}, "environment.uri"),
        ({"environment": {"uri": "https://example.com/app"}}, "environment.uri: 'https://example.com/app'"),
        ({"environment": {"uri": "my app"}}, "environment.uri: 'my app'"),
        ({**PACKAGE, "tags": {"aws:team": "blue"}}, "reserved"),
    ],
)
def test_an_application_of_nothing_is_refused_and_not_stored(
    applications: Applications, members: dict[str, Any], words: str
) -> None:
    with pytest.raises(InvalidParameterException, match=words):
        applications.create(**members)
    assert applications.listed(filters=[{"name": "name", "values": ["mine"]}]) == []


def test_a_name_is_taken_within_its_kind_until_it_is_deleted(service: Service) -> None:
    robots, simulations = Applications.of("Robot", service), Applications.of("Simulation", service)
    first = robots.create()
    simulations.create()

    with pytest.raises(ResourceAlreadyExistsException, match=first["arn"]):
        robots.create()
    robots.delete("mine")
    assert robots.create()["revisionId"] != first["revisionId"]


def test_of_simultaneous_creators_one_wins(applications: Applications) -> None:
    answers = at_once([partial(applications.create, tags={"caller": str(number)}) for number in range(6)])

    made = [answer for answer in answers if isinstance(answer, dict)]
    assert len(made) == 1
    assert [type(answer) for answer in answers if answer not in made] == [ResourceAlreadyExistsException] * 5
    assert applications.describe("mine")["tags"] == made[0]["tags"]


@pytest.mark.parametrize(
    "application",
    [
        "nobody",
        "arn:aws:robomaker:us-east-1:000000000000:robot-application/mine/1",
        "arn:aws:robomaker:us-east-1:000000000000:simulation-applicationMine",
        "arn:nothing",
    ],
)
def test_what_is_not_there_is_not_found(applications: Applications, application: str) -> None:
    applications.create()
    for missing in (applications.describe, partial(applications.update, **PACKAGE)):
        with pytest.raises(ResourceNotFoundException):
            missing(application)


def test_the_arn_of_the_other_kind_is_not_found(service: Service) -> None:
    robots, simulations = Applications.of("Robot", service), Applications.of("Simulation", service)
    with pytest.raises(ResourceNotFoundException, match="give the ARN of a simulation-application"):
        simulations.describe(robots.create()["arn"])


# Changing


def test_an_update_replaces_everything_but_name_arn_and_tags(applications: Applications) -> None:
    made = applications.create(tags={"team": "blue"}, environment={"uri": f"my-app@{DIGEST}"})
    sources = applications.stored("mine.zip")
    suite = {"robotSoftwareSuite": {"name": "ROS2", "version": "Foxy"}}

    updated = applications.update(made["arn"], **suite, sources=sources)

    assert (updated["arn"], updated["name"], updated["version"]) == (made["arn"], "mine", "$LATEST")
    assert updated["revisionId"] != made["revisionId"]
    assert updated["lastUpdatedAt"] > made["lastUpdatedAt"]
    assert updated["robotSoftwareSuite"] == suite["robotSoftwareSuite"]
    assert updated["sources"][0]["etag"]
    assert not {"environment", "tags", "imageDigest"} & updated.keys()
    assert applications.describe("mine") == {**updated, "tags": {"team": "blue"}}


def test_an_update_leaves_out_what_the_request_leaves_out(service: Service) -> None:
    simulations = Applications.of("Simulation", service)
    simulations.create(renderingEngine={"name": "OGRE", "version": "1.x"})

    simulations.update("mine", **PACKAGE)

    assert "renderingEngine" not in simulations.describe("mine")


def test_an_update_to_nothing_changes_nothing(applications: Applications) -> None:
    made = applications.create()
    for members in ({}, {"sources": []}, {"sources": [{"s3Bucket": BUCKET, "s3Key": "gone"}]}):
        with pytest.raises(InvalidParameterException):
            applications.update("mine", **members)
    assert applications.describe("mine") == made


def test_an_update_of_an_old_revision_is_refused_with_the_current_one(applications: Applications) -> None:
    first = applications.create()
    second = applications.update("mine", **PACKAGE, currentRevisionId=first["revisionId"])

    with pytest.raises(InvalidParameterException, match=f"currentRevisionId.*{second['revisionId']}"):
        applications.update("mine", environment={"uri": "other"}, currentRevisionId=first["revisionId"])
    assert applications.describe("mine") == {**second, "tags": {}}


def test_of_simultaneous_updates_of_one_revision_one_wins(applications: Applications) -> None:
    revision = applications.create()["revisionId"]
    change = partial(applications.update, "mine", currentRevisionId=revision)

    answers = at_once([partial(change, environment={"uri": f"python://robot_{number}"}) for number in range(6)])

    [won] = [answer for answer in answers if isinstance(answer, dict)]
    assert applications.describe("mine") == {**won, "tags": {}}
    assert sum(isinstance(answer, InvalidParameterException) for answer in answers) == 5


# Removing


def test_deleting_is_of_no_effect_on_what_is_not_there(applications: Applications) -> None:
    made = applications.create()
    for _ in range(2):
        applications.delete(made["arn"])
        applications.delete("mine")
        applications.delete(made["arn"], "7")
    with pytest.raises(ResourceNotFoundException):
        applications.describe(made["arn"])


def test_an_application_goes_with_its_versions_tags_and_count(applications: Applications) -> None:
    made = applications.create(tags={"team": "blue"})
    applications.version("mine")
    applications.delete(made["arn"])

    again = applications.create()

    assert again["tags"] == applications.describe("mine")["tags"] == {}
    assert applications.listed(versionQualifier="ALL", filters=[{"name": "name", "values": ["mine"]}]) == [
        ("mine", "$LATEST")
    ]
    assert applications.version("mine")["version"] == "1"


@pytest.mark.parametrize(
    ("application", "version", "words"),
    [
        ("mine", "$LATEST", "applicationVersion"),
        ("arn:aws:robomaker:us-east-1:000000000000:fleet/mine", None, "names a 'fleet'"),
        ("arn:aws:robomaker:us-east-1:000000000000:world/generation-1/world-1", None, "it has to name a"),
        ("arn:nothing", None, "has to look like"),
        ("mine", "one", "applicationVersion"),
    ],
)
def test_a_delete_that_makes_no_sense_is_refused(
    applications: Applications, application: str, version: str | None, words: str
) -> None:
    applications.create()
    with pytest.raises(InvalidParameterException, match=words):
        applications.delete(application, version)
    assert applications.describe("mine")["version"] == "$LATEST"


# Lists


def test_lists_have_one_entry_per_application_newest_first_or_all_versions(applications: Applications) -> None:
    applications.create("one")
    made = applications.create("two")
    applications.version("one")
    applications.version("one")

    assert applications.listed() == [("two", "$LATEST"), ("one", "$LATEST")]  # built-in ones only by name
    everything = [("one", "2"), ("one", "1"), *applications.listed()]
    assert applications.listed(versionQualifier="ALL") == everything
    assert applications.listed(versionQualifier="ALL", maxResults=2) == everything
    named = [{"name": "name", "values": ["one"]}]
    assert applications.listed(filters=named) == [("one", "$LATEST")]
    assert applications.listed(filters=named, versionQualifier="ALL") == [
        ("one", "2"),
        ("one", "1"),
        ("one", "$LATEST"),
    ]
    [entry], token = applications.page(filters=[{"name": "name", "values": ["two"]}], maxResults=1)
    assert entry == {key: made[key] for key in ("name", "arn", "version", "lastUpdatedAt", *applications.suites)}
    assert token is None
    assert {entry["arn"] for entry in applications.page(filters=named, versionQualifier="ALL")[0]} == {
        applications.describe("one")["arn"]
    }


def test_a_page_token_is_good_for_its_list_only(service: Service) -> None:
    robots = Applications.of("Robot", service)
    for name in ("one", "two"):
        robots.create(name)
        Applications.of("Simulation", service).create(name)
    _, token = robots.page(maxResults=1)

    assert robots.page(maxResults=1, nextToken=token)[0][0]["name"] == "one"
    for members in ({"versionQualifier": "ALL"}, {"filters": [{"name": "name", "values": ["one"]}]}):
        with pytest.raises(InvalidParameterException, match="nextToken"):
            robots.page(**members, nextToken=token)
    with pytest.raises(InvalidParameterException, match="nextToken"):
        Applications.of("Simulation", service).page(nextToken=token)


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({"versionQualifier": "LATEST"}, "versionQualifier"),
        ({"maxResults": 0}, "maxResults"),
        ({"maxResults": 101}, "maxResults"),
        ({"filters": [{"name": "nam", "values": ["x"]}]}, "did you mean 'name'"),
        ({"filters": [{"name": "name", "values": ["x", "y"]}]}, "values"),
    ],
)
def test_a_list_of_the_impossible_is_refused(applications: Applications, members: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidParameterException, match=words):
        applications.page(**members)


# What is built in


def test_what_is_built_in_can_be_versioned_but_stays(applications: Applications) -> None:
    name = BUILTIN[applications.role][0]
    before = applications.describe(name)

    assert applications.version(name)["environment"] == before["environment"]
    for refused in (partial(applications.update, name, **PACKAGE), partial(applications.delete, before["arn"])):
        with pytest.raises(InvalidParameterException, match="is built in and"):
            refused()
    with pytest.raises(ResourceAlreadyExistsException):
        applications.create(name)
    assert applications.describe(name) == before
    assert applications.describe(name, "1")["version"] == "1"
    applications.delete(name, "1")


def test_an_own_application_may_have_the_name_of_a_built_in_one_of_the_other_kind(service: Service) -> None:
    simulations = Applications.of("Simulation", service)
    simulations.create("scout")

    simulations.update("scout", environment={"uri": "python://other"})
    simulations.delete("scout")

    assert call("DescribeRobotApplication", {"application": "scout"}, service)["name"] == "scout"
