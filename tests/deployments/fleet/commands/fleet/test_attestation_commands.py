"""fleet attest, fleet verify."""

import json
import os
from pathlib import Path

import pytest
from helpers.deployed_robots import Yard, good
from helpers.tested_batches import Batches, courier, etag

from prefect_robomaker.schemas.documents.applications import ApplicationDocument
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.fleet.attestations.required_batches import envelope_key
from prefect_robomaker.tasks.service.service import Service

NONE = "arn:aws:robomaker:us-east-1:000000000000:deployment-job/deployment-none"


@pytest.fixture
def yard(home: Path) -> Yard:
    """A fleet in the command's data home, with the application `courier`."""
    yard = Yard(Service.open(Settings.from_environment({"ROBOMAKER_HOME": str(home)}), {}))
    courier(yard.service)
    yard.robot("rover", good)
    return yard


def deployed(yard: Yard, batch: str) -> str:
    found = yard.service.catalog.find("robot-application", "courier")
    assert found is not None
    job = yard.fleets.deploy(yard.arn, found.arn, deploymentConfig={"requiresBatch": batch})
    return yard.run(job["arn"])["arn"]


def test_a_deployment_is_verified_with_the_key_of_this_home_or_a_given_one(robomaker, yard: Yard, tmp_path) -> None:
    batches = Batches(yard.service, etag(yard.service))
    batch = batches.batch()
    job = deployed(yard, batch)

    said = robomaker("fleet", "verify", job)
    assert said.code == 0, said.err
    assert said.out.startswith(f"verified: {job}\n  PASSED in {batch}\n")
    assert "worlds 1, requirements arrives\n" in said.out

    key = tmp_path / "copied.pub"
    key.write_bytes((yard.service.folder("robots") / "attestation-key.pub").read_bytes())
    answer = json.loads(robomaker("fleet", "verify", job, "--public-key", key, "-o", "json").out)
    assert (answer["answer"], answer["verdict"], answer["jobs"]) == ("verified", "PASSED", batches.stored)
    assert list(answer["archives"]) == answer["simulated"] == ["courier/1/any"]


def test_a_deployment_whose_attestation_was_changed_is_refuted(robomaker, yard: Yard) -> None:
    job = deployed(yard, Batches(yard.service, etag(yard.service)).batch())
    service = yard.service
    service.store.put_bytes(service.settings.bucket, envelope_key(service.catalog.get(job)), b"{}")

    said = robomaker("fleet", "verify", job)

    assert said.code == 1
    assert "refuted" in said.out
    assert "the attestation is no envelope: payload: Field required" in said.out


def test_a_deployment_that_did_not_begin_has_nothing_to_verify(robomaker, yard: Yard) -> None:
    batches = Batches(yard.service, etag(yard.service))
    robomaker("fleet", "attest", batches.batch(), "--file", yard.service.settings.home / "unused")
    job = deployed(yard, batches.batch({"verdict": "FAIL"}))

    said = robomaker("fleet", "verify", job)

    assert said.code == 3
    assert "it is Failed, and robots have got nothing by it" in said.out


def test_what_cannot_be_verified_is_said(robomaker, yard: Yard) -> None:
    job = deployed(yard, Batches(yard.service, etag(yard.service)).batch())

    assert (
        "names a simulation-job-batch"
        in robomaker("fleet", "verify", "arn:aws:robomaker:us-east-1:000000000000:simulation-job-batch/b").err
    )
    assert robomaker("fleet", "verify", NONE).code == 2
    refused = robomaker("fleet", "verify", job, "--public-key", "nowhere.pub")
    assert (refused.code, "the public key nowhere.pub cannot be read" in refused.err) == (2, True)
    (yard.service.folder("robots") / "attestation-key").unlink()
    refused = robomaker("fleet", "verify", job)
    assert (refused.code, "give --public-key" in refused.err) == (2, True)


def test_a_batch_is_attested_without_a_deployment(robomaker, yard: Yard, tmp_path) -> None:
    batches = Batches(yard.service, etag(yard.service))
    batch, path = batches.batch(), tmp_path / "attestation.json"

    assert robomaker("fleet", "attest", batch, "--application-version", "1", "--file", path).code == 0
    shown = robomaker("fleet", "attest", batch, "--application-version", "1").out

    assert json.loads(path.read_bytes())["payloadType"] == "application/vnd.in-toto+json"
    assert shown.encode() == path.read_bytes() + b"\n"
    assert robomaker("fleet", "attest", batch).out != shown, "it is about what the application is now"


@pytest.mark.parametrize("version", [(), ("--application-version", "1")], ids=["latest", "numbered"])
def test_an_archive_that_was_overwritten_in_place_after_the_batch_is_not_attested(
    robomaker, yard: Yard, tmp_path, version: tuple[str, ...]
) -> None:
    batch, path = Batches(yard.service, etag(yard.service)).batch(), tmp_path / "attestation.json"
    assert robomaker("fleet", "attest", batch, *version).code == 0
    courier = yard.service.catalog.find("robot-application", "courier")
    assert courier is not None
    [source] = ApplicationDocument.of(courier).sources or []
    archive = yard.service.store.local_path(source.s3_bucket, source.s3_key)
    assert archive is not None
    before = archive.stat()
    with archive.open("r+b") as content:
        content.seek(-1, os.SEEK_END)
        last = content.read(1)
        content.seek(-1, os.SEEK_END)
        content.write(bytes([last[0] ^ 1]))
    os.utime(archive, ns=(before.st_atime_ns, before.st_mtime_ns))

    refused = robomaker("fleet", "attest", batch, *version, "--file", path)

    assert (refused.code, path.exists()) == (3, False)
    assert f"{source.s3_key} has changed since" in refused.err


@pytest.mark.parametrize(
    ("job", "status", "says"),
    [
        ({"verdict": "FAIL", "verdict_reason": "arrives: late"}, "Completed", "has the verdict FAIL: arrives: late"),
        ({}, "InProgress", "is InProgress; attest it when it has ended"),
    ],
)
def test_a_batch_that_did_not_pass_is_not_attested(robomaker, yard: Yard, tmp_path, job, status, says) -> None:
    batch = Batches(yard.service, etag(yard.service)).batch(job, status=status)

    said = robomaker("fleet", "attest", batch, "--file", tmp_path / "attestation.json")

    assert said.code != 0
    assert says in said.err
    assert not (tmp_path / "attestation.json").exists()
