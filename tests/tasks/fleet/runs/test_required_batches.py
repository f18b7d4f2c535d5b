"""Deployments that require a batch: held back while it runs, refused if it did not pass, attested if it did."""

from dataclasses import replace
from typing import Any

import pytest
from helpers.deployed_robots import Yard, good
from helpers.fleet_calls import LAUNCH
from helpers.tested_batches import Batches, courier, etag

from prefect_robomaker.schemas.fleet.operations.deployment_jobs import DeploymentLaunchConfig
from prefect_robomaker.schemas.fleet.rollouts.rollout_plan import Delivery
from prefect_robomaker.schemas.wire.errors import (
    DeploymentError,
    InvalidParameterException,
    ResourceNotFoundException,
)
from prefect_robomaker.tasks.fleet.attestations.envelopes import attestation_key, known_public_key
from prefect_robomaker.tasks.fleet.attestations.required_batches import (
    LONGEST_WAIT,
    DeploymentCheck,
    attestations_of,
    check_delivered,
    check_deployment,
    envelope_key,
)
from prefect_robomaker.tasks.fleet.catalog_rollouts import Rollouts
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

TAG = "robomaker:requiresBatch"


@pytest.fixture
def yard(service: Service) -> Yard:
    """A fleet with one robot, and version 1 of the application `courier`."""
    yard = Yard(service)
    courier(yard.service)
    yard.robot("rover", good)
    return yard


@pytest.fixture
def batches(yard: Yard) -> Batches:
    return Batches(yard.service, etag(yard.service))


def ordered(yard: Yard, batch: str, token: str = "once", **members: Any) -> str:
    found = yard.service.catalog.find("robot-application", "courier")
    assert found is not None
    config = {"deploymentConfig": {"requiresBatch": batch}, **members}
    return yard.fleets.deploy(yard.arn, found.arn, token, **config)["arn"]


def checked(yard: Yard, job: str) -> DeploymentCheck:
    service = yard.service
    return check_deployment(service.catalog.get(job), known_public_key(service), service)


def test_a_version_that_passed_reaches_the_robot_and_is_verified(yard: Yard, batches: Batches) -> None:
    batch = batches.batch({}, {})

    job = yard.run(ordered(yard, batch))

    assert job["status"] == "Succeeded"
    assert job["deploymentConfig"]["requiresBatch"] == batch
    assert yard.statuses() == {"rover": "InSync"}
    check = checked(yard, job["arn"])
    assert (check.answer, check.reason, check.verdict, check.batch) == ("verified", None, "PASSED", batch)
    assert (check.jobs, check.seeds, check.worlds) == (batches.stored, 2, 1)
    assert (check.requirements, check.simulated) == (["arrives"], ["courier/1/any"])
    assert f"PASSED in {batch}" in str(check)
    stored = yard.service.store.get_bytes(
        yard.service.settings.bucket, envelope_key(yard.service.catalog.get(job["arn"]))
    )
    assert attestations_of(yard.service.catalog.get(job["arn"]), yard.service) == (stored,)


def test_a_batch_with_one_failing_job_stops_the_deployment_before_any_order(yard: Yard, batches: Batches) -> None:
    batch = batches.batch({}, {"verdict": "FAIL", "verdict_reason": "arrives: 12 s is over 9 s"})

    job = yard.run(ordered(yard, batch))

    assert (job["status"], job["failureCode"]) == ("Failed", "MissingRobotDeploymentResource")
    assert f"job {batches.stored[1]} of the required batch {batch}" in job["failureReason"]
    assert "arrives: 12 s is over 9 s" in job["failureReason"]
    assert yard.offered == []
    assert yard.statuses() == {"rover": "Registered"}
    assert checked_without_key(yard, job["arn"]).answer == "nothing to verify"


def checked_without_key(yard: Yard, job: str) -> DeploymentCheck:
    key = attestation_key(yard.service).public_key
    return check_deployment(yard.service.catalog.get(job), key, yard.service)


def test_a_deployment_waits_for_a_batch_that_runs(yard: Yard, batches: Batches) -> None:
    batch = batches.batch({"status": "Running", "verdict": None}, status="InProgress")
    (running,) = yard.service.catalog.children(batch, "simulation-job")
    job = ordered(yard, batch)
    seen: list[str] = []

    def passes() -> None:
        seen.append(yard.fleets.described(job)["status"])
        catalog = yard.service.catalog
        catalog.transition(running.arn, "finish", document_changes={"verdict": "PASS"})
        catalog.transition(running.arn, "complete")
        catalog.transition(batch, "complete")

    yard.at_look[3] = passes
    notes: list[str] = []
    yard.service = replace(yard.service, report_note=notes.append)

    assert yard.run(job)["status"] == "Succeeded"
    assert seen == ["Preparing"]
    assert len(notes) == 1
    assert f"batch {batch} is InProgress" in notes[0]


def test_a_deployment_does_not_wait_for_ever(yard: Yard, batches: Batches) -> None:
    job = ordered(yard, batches.batch(status="Pending"))
    created_at = yard.service.catalog.get(job).created_at
    yard.at_look[2] = lambda: setattr(yard, "now", created_at + LONGEST_WAIT)

    ended = yard.run(job)

    assert (ended["status"], ended["failureCode"]) == ("Failed", "FleetDeploymentTimeout")
    assert "is Pending 14 days after the deployment" in ended["failureReason"]


def test_a_deployment_that_waits_can_be_cancelled(yard: Yard, batches: Batches) -> None:
    job = ordered(yard, batches.batch(status="InProgress"))
    yard.at_look[2] = lambda: yard.fleets.cancel(job)

    assert yard.run(job)["status"] == "Canceled"
    assert yard.looks == 2
    assert yard.offered == []


def test_a_cancelled_flow_run_ends_a_deployment_that_waits(yard: Yard, batches: Batches) -> None:
    job = ordered(yard, batches.batch(status="InProgress"))
    yard.at_look[2] = lambda: yard.service.catalog.request_cancel(job)

    assert yard.run(job)["status"] == "Canceled"
    assert yard.looks == 2


def test_a_batch_that_goes_meanwhile_fails_the_deployment(yard: Yard, batches: Batches) -> None:
    batch = batches.of(status="InProgress")
    job = ordered(yard, batch)
    yard.at_look[2] = lambda: yard.service.catalog.delete(batch)

    ended = yard.run(job)

    assert (ended["status"], ended["failureCode"]) == ("Failed", "MissingRobotDeploymentResource")
    assert "the required batch is gone" in ended["failureReason"]


def test_an_archive_that_changed_since_the_simulations_is_not_deployed(yard: Yard, batches: Batches) -> None:
    job = ordered(yard, batches.batch())
    yard.service.store.put_bytes("apps", "any", b"another")

    ended = yard.run(job)

    assert (ended["status"], ended["failureCode"]) == ("Failed", "EtagMismatch")
    assert yard.offered == []


def test_a_version_other_than_the_one_simulated_is_not_deployed(yard: Yard, batches: Batches) -> None:
    batch = batches.batch()
    service = yard.service
    found = service.catalog.find("robot-application", "courier")
    assert found is not None
    service.store.put_bytes("apps", "any", b"another")
    sources = [{"s3Bucket": "apps", "s3Key": "any"}]
    suite = {"name": "General"}
    yard.fleets.call("UpdateRobotApplication", application=found.arn, sources=sources, robotSoftwareSuite=suite)
    yard.fleets.call("CreateRobotApplicationVersion", application=found.arn)

    job = yard.run(ordered(yard, batch, config={"applicationVersion": "2"}))

    assert (job["status"], job["failureCode"]) == ("Failed", "EtagMismatch")
    assert "ran another archive of courier" in job["failureReason"]


def test_the_tag_says_the_same(yard: Yard, batches: Batches) -> None:
    batch = batches.batch()

    job = yard.run(ordered(yard, batch, deploymentConfig={}, tags={TAG: batch}))

    assert job["status"] == "Succeeded"
    assert job["deploymentConfig"]["requiresBatch"] == batch
    again = call("SyncDeploymentJob", {"fleet": yard.arn, "clientRequestToken": "sync"}, yard.service)
    assert again["deploymentConfig"]["requiresBatch"] == batch


@pytest.mark.parametrize(
    ("config", "tag", "says"),
    [
        ("arn:aws:robomaker:x:000000000000:world/a", None, r"^deploymentConfig\.requiresBatch: .* names a world"),
        (None, "batch-1", r"^tags\.robomaker:requiresBatch: 'batch-1' is no ARN"),
        (
            "arn:aws:robomaker:x:000000000000:simulation-job-batch/a",
            "arn:aws:robomaker:x:000000000000:simulation-job-batch/b",
            r"^deploymentConfig\.requiresBatch is .*/a', but tags\.robomaker:requiresBatch is .*/b'; leave one",
        ),
    ],
)
def test_what_names_no_batch_is_refused(yard: Yard, config: str | None, tag: str | None, says: str) -> None:
    asked = {"requiresBatch": config} if config else {}

    with pytest.raises(InvalidParameterException, match=says):
        ordered(yard, "", deploymentConfig=asked, tags={TAG: tag} if tag else {})


def test_a_batch_that_is_not_there_is_refused(yard: Yard) -> None:
    with pytest.raises(ResourceNotFoundException, match="batch-1"):
        ordered(yard, "arn:aws:robomaker:us-east-1:000000000000:simulation-job-batch/batch-1")


# Verifying


def test_a_deployment_that_requires_nothing_has_nothing_to_verify(yard: Yard) -> None:
    job = yard.run(ordered(yard, "", deploymentConfig={}))

    check = checked_without_key(yard, job["arn"])
    assert (check.answer, check.reason) == ("nothing to verify", "it requires no batch")
    assert attestations_of(yard.service.catalog.get(job["arn"]), yard.service) == ()


def test_an_attestation_that_was_changed_or_is_gone_is_refuted(yard: Yard, batches: Batches) -> None:
    job = yard.run(ordered(yard, batches.batch()))["arn"]
    store, resource = yard.service.store, yard.service.catalog.get(job)
    bucket, key = yard.service.settings.bucket, envelope_key(resource)
    envelope = store.get_bytes(bucket, key)

    store.put_bytes(bucket, key, envelope.replace(b'"sig":"', b'"sig":"A'))
    assert checked(yard, job).answer == "refuted"
    with pytest.raises(DeploymentError):
        attestations_of(resource, yard.service)

    store.delete(bucket, key)
    gets = Delivery(artifacts={}, architectures={}, launch=DeploymentLaunchConfig.model_validate(LAUNCH))
    assert (checked(yard, job).answer, checked(yard, job).reason) == ("refuted", "its attestation is gone")
    with pytest.raises(DeploymentError, match="the attestation is gone"):
        check_delivered(resource, gets, yard.service)


def test_the_attestation_of_another_deployment_is_refuted(yard: Yard, batches: Batches) -> None:
    service = yard.service
    first, second = batches.batch(), batches.batch()
    jobs = [yard.run(ordered(yard, batch, batch[-12:]))["arn"] for batch in (first, second)]
    envelopes = [envelope_key(service.catalog.get(job)) for job in jobs]
    service.store.put_bytes(
        service.settings.bucket, envelopes[1], service.store.get_bytes(service.settings.bucket, envelopes[0])
    )

    check = checked(yard, jobs[1])

    assert check.answer == "refuted"
    assert check.reason == f"the attestation is about the batch {first}, {second} is required"
    assert checked(yard, jobs[0]).answer == "verified"


def test_what_is_delivered_has_to_be_what_was_attested(yard: Yard, batches: Batches) -> None:
    job = yard.service.catalog.get(yard.run(ordered(yard, batches.batch()))["arn"])
    stored = Rollouts(yard.service.catalog).rollout(job.arn)
    assert stored is not None
    gets = Delivery.of_json(dict(stored.delivery))
    check_delivered(job, gets, yard.service)
    other = {name: each.model_copy(update={"archive_sha256": "0" * 64}) for name, each in gets.artifacts.items()}

    with pytest.raises(DeploymentError, match=r"robot/rover/.* gets an archive with the SHA-256 0000") as refused:
        check_delivered(job, gets.model_copy(update={"artifacts": other}), yard.service)

    assert refused.value.failure_code == "EtagMismatch"
