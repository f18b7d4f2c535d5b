"""Whether a batch has passed with a version: what refuses it, and what has to be waited for."""

from typing import Any

import pytest
from helpers.tested_batches import Batches, courier, etag

from prefect_robomaker.schemas.documents.simulation_jobs import MadeOf
from prefect_robomaker.schemas.wire.errors import DeploymentError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.fleet.attestations.passed_batch import (
    PassedBatch,
    RunningBatch,
    StoredBatch,
    application_of,
    judge,
)
from prefect_robomaker.tasks.service.service import Service

OTHER = {"robotApplications": [{"application": "mower", "launchConfig": {}}]}


@pytest.fixture
def application(service: Service) -> Resource:
    return courier(service)


@pytest.fixture
def batches(service: Service, application: Resource) -> Batches:
    return Batches(service, etag(service))


def judged(batches: Batches, arn: str, application: Resource) -> PassedBatch | RunningBatch:
    return judge(StoredBatch.of(arn, batches.service), application)


def test_a_batch_passes_if_each_job_did(batches: Batches, application: Resource) -> None:
    arn = batches.batch({}, {"trials": {"seeds": 3, "axes": {"WIND": {"kind": "variable", "values": ["0", "1"]}}}})

    found = judged(batches, arn, application)

    assert isinstance(found, PassedBatch)
    assert found.arn == arn
    assert [job.id for job in found.jobs] == batches.stored
    assert [job.trials for job in found.jobs] == [0, 6]
    assert {job.etag for job in found.jobs} == {etag(batches.service)}


@pytest.mark.parametrize(
    ("job", "code", "says"),
    [
        ({"verdict": "FAIL", "verdict_reason": "arrives: 12 s"}, "", "has the verdict FAIL: arrives: 12 s"),
        ({"verdict": "ERROR"}, "", "has the verdict ERROR"),
        ({"verdict": "NONE"}, "", "has no verdict; give it requirements"),
        ({"verdict": None}, "", "has no verdict; give it requirements"),
        ({"status": "Failed", "failure_reason": "it crashed"}, "", "is Failed: it crashed"),
        ({"status": "Canceled"}, "", "is Canceled"),
        ({"request": OTHER}, "", "ran mower, not arn:"),
        ({"request": {}}, "", "ran no robot application"),
        ({"made_of": None}, "", "ran no archive of courier"),
        ({"made_of": MadeOf(robot="package 12")}, "", "ran no archive of courier"),
        (
            {"made_of": MadeOf(robot="archive 12")},
            "EtagMismatch",
            "ran another archive of courier, with ETag 12; version 1 has",
        ),
    ],
)
def test_one_job_that_did_not_pass_is_named(
    batches: Batches, application: Resource, job: dict[str, Any], code: str, says: str
) -> None:
    arn = batches.batch({}, job, {})

    with pytest.raises(DeploymentError) as refused:
        judged(batches, arn, application)

    assert f"job {batches.stored[1]} of the required batch {arn} {says}" in str(refused.value)
    assert refused.value.failure_code == (code or "MissingRobotDeploymentResource")


@pytest.mark.parametrize(
    ("batch", "says"),
    [
        ({"failed": 1}, r"request 1 of the required batch .* never became a job: no such world"),
        ({"missing": 1}, r"has 1 job of 2 requests"),
        ({"status": "TimedOut"}, r"is TimedOut"),
        ({"status": "Canceled"}, r"is Canceled"),
        ({"status": "Failed"}, r"is Failed"),
    ],
)
def test_a_batch_that_did_not_complete_is_refused(
    batches: Batches, application: Resource, batch: dict[str, Any], says: str
) -> None:
    with pytest.raises(DeploymentError, match=says):
        judged(batches, batches.batch(**batch), application)


def test_a_batch_without_jobs_is_refused(batches: Batches, application: Resource) -> None:
    with pytest.raises(DeploymentError, match="has 0 jobs of 0 requests"):
        judged(batches, batches.of(), application)


@pytest.mark.parametrize("batch", [{"status": "Pending"}, {"status": "InProgress"}, {"status": "Completing"}])
def test_a_batch_under_way_is_waited_for(batches: Batches, application: Resource, batch: dict[str, Any]) -> None:
    found = judged(batches, batches.batch(missing=1, **batch), application)

    assert isinstance(found, RunningBatch)
    assert batch["status"] in found.why


def test_a_job_that_was_restarted_is_waited_for(batches: Batches, application: Resource) -> None:
    found = judged(batches, batches.batch({}, {"status": "Restarting", "verdict": None}), application)

    assert isinstance(found, RunningBatch)
    assert f"job {batches.stored[1]}" in found.why


def test_jobs_are_in_the_order_of_their_requests(batches: Batches, application: Resource) -> None:
    arn = batches.batch({"request_index": 1}, {"request_index": 0})

    found = judged(batches, arn, application)

    assert isinstance(found, PassedBatch)
    assert [job.id for job in found.jobs] == batches.stored[::-1]


def test_one_failure_refuses_a_batch_under_way_at_once(batches: Batches, application: Resource) -> None:
    with pytest.raises(DeploymentError, match="has the verdict FAIL"):
        judged(batches, batches.batch({"verdict": "FAIL"}, status="InProgress", missing=5), application)


def test_a_batch_that_is_gone_is_said_to_be(batches: Batches, application: Resource) -> None:
    arn = batches.batch()
    batches.service.catalog.delete(arn)

    with pytest.raises(DeploymentError, match="the required batch is gone") as refused:
        judged(batches, arn, application)

    assert refused.value.failure_code == "MissingRobotDeploymentResource"


def test_it_is_known_which_application_a_batch_tested(batches: Batches) -> None:
    versioned = {"robotApplications": [{"application": "courier", "applicationVersion": "7", "launchConfig": {}}]}
    service = batches.service

    assert application_of(StoredBatch.of(batches.batch(), service)) == ("courier", "$LATEST")
    assert application_of(StoredBatch.of(batches.batch({"request": versioned}), service)) == ("courier", "7")
    with pytest.raises(DeploymentError, match="no job that ran a robot application"):
        application_of(StoredBatch.of(batches.batch({"request": {}}), service))
