"""Deployments as agents get them: everything signed, from the very files that were there when they were ordered."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.deployed_robots import archive, deployable
from helpers.fleet_calls import LAUNCH, Fleets
from helpers.tested_batches import Batches
from helpers.trusting_robots import TrustingRobot

from prefect_robomaker.schemas.wire.errors import DeploymentError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.fleet.attestations.envelopes import attestation_key
from prefect_robomaker.tasks.fleet.trust.ceremonies import AttestedChange, renew_root
from prefect_robomaker.tasks.fleet.trust.deployments import publish
from prefect_robomaker.tasks.fleet.trust.metadata import EVERY_APPLICATION
from prefect_robomaker.tasks.fleet.trust.publishing import publisher_of
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.planning.applications import find_application


class Site:
    """A fleet with an agent, and a deployment to it."""

    def __init__(self, service: Service, folder: Path) -> None:
        self.service, self.folder = service, folder
        self.fleets = Fleets(service)
        self.fleet = self.fleets.fleet()
        self.fleets.robot("rover", self.fleet)
        self.fleets.let_agents_in(self.fleet)

    def job(self, application: str, **members: Any) -> Resource:
        return self.service.catalog.get(self.fleets.deploy(self.fleet, application, **members)["arn"])

    def publish(self, job: Resource, *architectures: str, attestations: tuple[bytes, ...] = ()) -> Any:
        application = find_application("mine", "robot", "1", self.service)
        return publish(job, application, architectures, self.service, attestations)

    def robot(self) -> TrustingRobot:
        publisher = publisher_of(self.service)
        root = publisher.files.metadata("root", publisher.root().signed.version)
        (self.folder / "robot").mkdir(exist_ok=True)
        return TrustingRobot(publisher.files, root, self.folder / "robot")


@pytest.fixture
def site(service: Service, tmp_path: Path) -> Site:
    return Site(service, tmp_path)


def test_the_document_says_what_is_launched_and_names_what_is_downloaded(site: Site) -> None:
    job = site.job(deployable(site.fleets, "X86_64", "ARM64"), tags={"why": "test"})

    envelope = signed_by(attestation_key(site.service).public_key.keyid)

    made = site.publish(job, "X86_64", attestations=(envelope,))

    robot, artifact = site.robot(), made["X86_64"]
    assert artifact.target == f"applications/mine/deployments/{job.id}.json"
    document = json.loads(robot.content(artifact.target) or b"")
    bundle, (attestation,) = document["bundles"]["X86_64"], document.pop("attestations")
    assert document == {
        "format": 1,
        "number": int(job.created_at.timestamp() * 1000),
        "job": job.arn,
        "fleet": site.fleet,
        "application": "mine",
        "version": "1",
        "bundles": {"X86_64": f"applications/mine/bundles/{artifact.sha256}.tar.gz"},
        "condition": None,
        "batch": None,
        "launch": LAUNCH,
        "tags": {"why": "test"},
    }
    content = robot.content(bundle) or b""
    assert content == site.service.store.get_bytes("apps", "X86_64.tar.gz")
    assert len(content) == artifact.size_bytes
    assert robot.content(attestation) == envelope
    assert site.service.store.get_bytes(artifact.bucket, artifact.key) == content


def signed_by(keyid: str) -> bytes:
    """An envelope, as far as the service looks at one before it publishes it."""
    return json.dumps({"payload": "", "signatures": [{"keyid": keyid}]}).encode()


def test_what_agents_would_refuse_is_not_published(site: Site) -> None:
    application, own = deployable(site.fleets, "X86_64"), attestation_key(site.service).public_key
    batch = Batches(site.service, "etag").batch()
    tested = site.job(application, deploymentConfig={"requiresBatch": batch})
    with pytest.raises(DeploymentError, match="is signed by abc, and agents believe") as refused:
        site.publish(tested, "X86_64", attestations=(signed_by("abc"),))
    assert refused.value.failure_code == "MissingRobotDeploymentResource"
    assert publisher_of(site.service).files.newest_timestamp() is None

    site.fleets.cancel(tested.arn)
    job = site.job(application, token="again")
    site.publish(job, "X86_64")
    site.publish(job, "X86_64", attestations=(signed_by("abc"),))  # robots that go back, where none is needed
    for name in ("another", "mine", EVERY_APPLICATION):
        renew_root(publisher_of(site.service), [], [], None, AttestedChange(add=(name,)))
        if name == "another":
            site.publish(job, "X86_64")
            continue
        with pytest.raises(DeploymentError, match="was not attested, and this deployment requires no batch"):
            site.publish(job, "X86_64")
        with pytest.raises(DeploymentError, match="is signed by abc, and agents believe"):
            site.publish(job, "X86_64", attestations=(signed_by("abc"),))
        site.publish(job, "X86_64", attestations=(signed_by(own.keyid),))
        renew_root(publisher_of(site.service), [], [], None, AttestedChange(remove=(name,)))
    site.publish(job, "X86_64")


def test_the_document_says_which_batch_is_required(site: Site) -> None:
    batch = Batches(site.service, "etag").batch()
    job = site.job(deployable(site.fleets, "X86_64"), deploymentConfig={"requiresBatch": batch})
    made = site.publish(job, "X86_64")
    assert json.loads(site.robot().content(made["X86_64"].target) or b"")["batch"] == batch


def test_a_second_run_of_the_job_publishes_nothing_new(site: Site) -> None:
    job = site.job(deployable(site.fleets, "X86_64"))
    assert site.publish(job, "X86_64") == site.publish(job, "X86_64")
    newest = publisher_of(site.service).files.newest_timestamp()
    assert newest is not None
    assert newest[0] == 1


def test_a_condition_is_published_as_it_was(site: Site) -> None:
    application = deployable(site.fleets, "X86_64")
    site.service.store.put_bytes("apps", "may.sh", b"exit 0")
    config = {"downloadConditionFile": {"bucket": "apps", "key": "may.sh"}}
    job = site.job(application, deploymentConfig=config)

    made = site.publish(job, "X86_64")

    document = json.loads(site.robot().content(made["X86_64"].target) or b"")
    assert site.robot().content(document["condition"]) == b"exit 0"
    site.service.store.put_bytes("apps", "may.sh", b"exit 1")
    with pytest.raises(DeploymentError, match=r"downloadConditionFile: s3://apps/may.sh has changed since") as refused:
        site.publish(job, "X86_64")
    assert refused.value.failure_code == "EtagMismatch"


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda store: store.delete("apps", "X86_64.tar.gz"), "ResourceNotFound"),
        (lambda store: store.put_bytes("apps", "X86_64.tar.gz", b"another"), "EtagMismatch"),
    ],
)
def test_an_archive_that_is_not_there_any_more_is_named(site: Site, change: Callable[[Any], object], code: str) -> None:
    job = site.job(deployable(site.fleets, "X86_64"))
    change(site.service.store)
    with pytest.raises(DeploymentError, match=r"s3://apps/X86_64.tar.gz ") as refused:
        site.publish(job, "X86_64")
    assert refused.value.failure_code == code


def test_architectures_without_an_archive_are_absent(site: Site) -> None:
    job = site.job(deployable(site.fleets, "X86_64"))
    assert list(site.publish(job, "ARMHF", "X86_64")) == ["X86_64"]
    assert site.publish(job, "ARMHF") == {}


@pytest.mark.parametrize(
    ("content", "suffix"),
    [(archive(), "tar.gz"), (b"PK\3\4", "zip"), (b"plain", "tar")],
    ids=["gzip", "zip", "tar"],  # bytes with the time in them are no names
)
def test_the_name_of_a_bundle_says_how_it_is_unpacked(site: Site, content: bytes, suffix: str) -> None:
    site.service.store.ensure_bucket("apps")
    site.service.store.put_bytes("apps", "archive", content)
    application = site.fleets.application("mine", sources=[{"s3Bucket": "apps", "s3Key": "archive"}])
    made = site.publish(site.job(application), "X86_64")
    assert made["X86_64"].file_name == f"{made['X86_64'].sha256}.{suffix}"
