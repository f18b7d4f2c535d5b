"""Generation, simulation and export with everything on a real S3 server."""

import json
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from helpers.s3_server import S3Server
from helpers.small_flat import ROLE

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import read_manifest

pytestmark = pytest.mark.usefixtures("known_worlds")
Order = Callable[..., dict[str, Any]]
Simulate = Callable[[dict[str, Any]], dict[str, Any]]
Generate = Callable[..., dict[str, Any]]


@pytest.fixture
def bucket() -> str:
    """The configured bucket, which does not exist yet."""
    return f"home-{uuid4().hex[:12]}"


@pytest.fixture
def settings(tmp_path: Path, s3_server: S3Server, bucket: str) -> Settings:
    """Everything below the test's folder, but objects on S3."""
    home = {"ROBOMAKER_HOME": str(tmp_path / "home"), "ROBOMAKER_BUCKET": bucket}
    return Settings.from_environment({**home, **s3_server.environ()})


@pytest.fixture
def service(settings: Settings, s3_server: S3Server) -> Service:
    """A service of somebody who may do everything."""
    return Service.open(settings, s3_server.environ())


@pytest.fixture
def limited(settings: Settings, s3_server: S3Server, bucket: str) -> Iterator[Service]:
    """The same service with keys that may read and write objects of the configured bucket, and nothing else."""
    iam = s3_server.client("iam")
    name = f"limited-{uuid4().hex[:8]}"
    iam.create_user(UserName=name)
    keys = iam.create_access_key(UserName=name)["AccessKey"]
    actions = ["s3:PutObject", "s3:GetObject", "s3:AbortMultipartUpload"]
    allowed = {"Effect": "Allow", "Action": actions, "Resource": f"arn:aws:s3:::{bucket}/*"}
    policy = json.dumps({"Version": "2012-10-17", "Statement": [allowed]})
    iam.put_user_policy(UserName=name, PolicyName="objects", PolicyDocument=policy)
    environ = {"AWS_ACCESS_KEY_ID": keys["AccessKeyId"], "AWS_SECRET_ACCESS_KEY": keys["SecretAccessKey"]}
    yield Service.open(settings, environ)
    iam.delete_access_key(UserName=name, AccessKeyId=keys["AccessKeyId"])
    iam.delete_user(UserName=name)


def buckets(server: S3Server) -> set[str]:
    return {found["Name"] for found in server.client("s3").list_buckets()["Buckets"]}


def export(service: Service, world: str, bucket: str) -> dict[str, Any]:
    request = {"worlds": [world], "outputLocation": {"s3Bucket": bucket, "s3Prefix": "exports"}, "iamRole": ROLE}
    job = call("CreateWorldExportJob", request, service)
    return registry()["CreateWorldExportJob"].perform(job["arn"], service)


def perform_drive(service: Service, world: str) -> dict[str, Any]:
    """Drives the built-in robot through a world."""
    simulation = {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": world}]}
    request = {
        "maxJobDurationInSeconds": 120,
        "iamRole": ROLE,
        "robotApplications": [{"application": "scout", "launchConfig": {}}],
        "simulationApplications": [simulation],
    }
    job = call("CreateSimulationJob", request, service)
    return registry()["CreateSimulationJob"].perform(job["arn"], service)


def test_worlds_are_generated_driven_through_and_exported(
    service: Service, generate: Generate, s3_server: S3Server, bucket: str, tmp_path: Path
) -> None:
    generated = generate()
    [world] = generated["finishedWorldsSummary"]["succeededWorlds"]

    driven = perform_drive(service, world)
    exported = export(service, world, bucket)

    assert [job["status"] for job in (generated, driven, exported)] == ["Completed"] * 3
    place = service.catalog.get(driven["arn"]).document["outputs"]
    assert place["bucket"] == bucket
    keys = {
        entry["Key"]
        for page in s3_server.client("s3").get_paginator("list_objects_v2").paginate(Bucket=bucket)
        for entry in page["Contents"]
    }
    assert {f"{place['prefix']}/{file.path}" for file in read_manifest(service.store, **place).files} < keys
    number = exported["arn"].split("/export-")[1]
    service.store.get_file(bucket, f"exports/aws-robomaker-worldforge-export-{number}.zip", tmp_path / "export.zip")
    with zipfile.ZipFile(tmp_path / "export.zip") as archive:
        assert archive.testzip() is None


def test_a_misspelt_bucket_is_not_created_and_the_error_names_it(
    service: Service, order: Order, simulate: Simulate, generate: Generate, s3_server: S3Server
) -> None:
    [world] = generate()["finishedWorldsSummary"]["succeededWorlds"]
    request = order(outputLocation={"s3Bucket": "misspelt-results"})
    before = buckets(s3_server)

    job = simulate(request)
    exported = export(service, world, "misspelt-exports")

    assert (job["status"], job["failureCode"]) == ("Failed", "BadPermissionsS3Output")
    assert "misspelt-results" in job["failureReason"]
    assert "lastStartedAt" not in job, "found out before it ran"
    assert (exported["status"], exported["failureCode"]) == ("Failed", "ResourceNotFound")
    assert "misspelt-exports" in exported["failureReason"]
    assert buckets(s3_server) == before


def test_an_archive_in_a_bucket_that_does_not_exist_is_refused(service: Service) -> None:
    request = {
        "name": "nowhere",
        "sources": [{"s3Bucket": "misspelt-sources", "s3Key": "robot.tar.gz"}],
        "robotSoftwareSuite": {"name": "General"},
    }
    with pytest.raises(InvalidParameterException, match=r"sources\[0\].*misspelt-sources"):
        call("CreateRobotApplication", request, service)


@pytest.mark.deep
def test_keys_for_objects_only_are_enough(service: Service, limited: Service, generate: Generate, bucket: str) -> None:
    [world] = generate()["finishedWorldsSummary"]["succeededWorlds"]

    exported = export(limited, world, bucket)
    driven = perform_drive(limited, world)

    assert exported["status"] == "Completed", exported["failureReason"]
    assert driven["status"] == "Completed", driven["failureReason"]
    assert read_manifest(service.store, **service.catalog.get(driven["arn"]).document["outputs"]).files


def test_keys_that_may_not_write_end_jobs_with_the_code_for_that(
    service: Service, limited: Service, generate: Generate, s3_server: S3Server
) -> None:
    [world] = generate()["finishedWorldsSummary"]["succeededWorlds"]
    s3_server.client("s3").create_bucket(Bucket=f"foreign-{uuid4().hex[:8]}")
    foreign = next(name for name in buckets(s3_server) if name.startswith("foreign-"))

    exported = export(limited, world, foreign)

    assert (exported["status"], exported["failureCode"]) == ("Failed", "AccessDenied")
    assert foreign in exported["failureReason"]


@pytest.mark.parametrize(
    ("part", "code"),
    [
        pytest.param("data", "BadPermissionsS3Object", marks=pytest.mark.deep),
        ("robot", "BadPermissionsRobotApplication"),
        pytest.param("simulation", "BadPermissionsSimulationApplication", marks=pytest.mark.deep),
        pytest.param("output", "BadPermissionsS3Output", marks=pytest.mark.deep),
    ],
)
def test_a_job_of_somebody_who_may_not_reach_a_part_of_it_says_which(
    service: Service, limited: Service, order: Order, s3_server: S3Server, part: str, code: str
) -> None:
    foreign = f"foreign-{uuid4().hex[:8]}"
    s3_server.client("s3").create_bucket(Bucket=foreign)
    service.store.put_bytes(foreign, "there", b"there")
    request = order()
    # The keys may read nothing of the bucket that the applications' archive is in; here the rest has to be theirs.
    builtin = {"robot": "scout", "simulation": "indoor-navigation"}
    for role, name in builtin.items():
        if role != part:
            request[f"{role}Applications"] = [{"application": name, "launchConfig": {}}]
    if part == "data":
        request["dataSources"] = [{"name": "x", "s3Bucket": foreign, "s3Keys": ["there"]}]
    if part == "output":
        request["outputLocation"] = {"s3Bucket": foreign}
        request["robotApplications"] = [{"application": "scout", "launchConfig": {"command": ["true"]}}]
        del request["simulationApplications"]
    arn = call("CreateSimulationJob", request, service)["arn"]

    perform_job(arn, limited)

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert (job["status"], job["failureCode"]) == ("Failed", code), job["failureReason"]
