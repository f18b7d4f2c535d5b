import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import ResourceAlreadyExistsException, SpecError, StorageError
from prefect_robomaker.tasks.backends.backend import BackendError
from prefect_robomaker.tasks.backends.opening import open_backend
from prefect_robomaker.tasks.inspection.preflight import check_preconditions
from prefect_robomaker.tasks.operations.applications.records import update_application
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

SUITE = {"name": "General"}


def spec(robot: str, **steps: Any) -> Any:
    request = {
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "robotApplications": [{"application": robot, "launchConfig": {}}],
    }
    drive = {"operation": "CreateSimulationJob", "input": request}
    return load_spec(json.dumps({"version": 1, "name": "check", "steps": {"drive": drive, **steps}}), "check.yaml")


def test_a_misspelt_application_is_found_before_anything_runs(service: Service) -> None:
    with pytest.raises(SpecError, match=r"robotApplications\[0\]\.application.*'scot'.*'scout'"):
        check_preconditions(spec("scot"), service)

    check_preconditions(spec("scout"), service)


def test_an_application_that_a_step_makes_counts_as_existing(service: Service) -> None:
    uri = {"uri": "python://my_robot"}
    make = {
        "operation": "CreateRobotApplication",
        "input": {"name": "mine", "environment": uri, "robotSoftwareSuite": SUITE},
    }

    check_preconditions(spec("mine", make=make), service)


def test_an_object_store_that_cannot_be_used_is_found_before_anything_runs(settings: Settings, tmp_path: Path) -> None:
    (tmp_path / "store").write_text("a file where a folder should be")
    values = {"ROBOMAKER_HOME": str(settings.home), "ROBOMAKER_OBJECT_STORE": str(tmp_path / "store")}

    with pytest.raises(StorageError):
        check_preconditions(spec("scout"), Service.open(Settings.from_environment(values), {}))


def test_an_application_is_updated_to_its_archive_as_it_is_now(service: Service) -> None:
    service.store.ensure_bucket("applications")
    service.store.put_bytes("applications", "mine.zip", b"one")
    source = [{"s3Bucket": "applications", "s3Key": "mine.zip"}]
    request = {"name": "mine", "sources": source, "robotSoftwareSuite": SUITE, "tags": {"team": "blue"}}
    made = call("CreateRobotApplication", request, service)
    service.store.put_bytes("applications", "mine.zip", b"two")

    updated = update_application("robot", {**request, "tags": {"night": "1"}}, service)

    assert updated is not None
    assert updated["arn"] == made["arn"]
    assert updated["revisionId"] != made["revisionId"]
    assert updated["sources"][0]["etag"] != made["sources"][0]["etag"]
    assert updated["tags"] == {"team": "blue", "night": "1"}
    assert update_application("robot", {**request, "name": "other"}, service) is None


def test_a_built_in_application_is_not_updated(service: Service) -> None:
    request = {"name": "scout", "environment": {"uri": "python://mine"}, "robotSoftwareSuite": SUITE}

    with pytest.raises(ResourceAlreadyExistsException, match="built in"):
        update_application("robot", request, service)


@pytest.mark.parametrize("kind", ["dask", "ray"])
def test_a_cluster_that_is_not_there_is_found_before_anything_runs(service: Service, kind: str) -> None:
    with pytest.raises(BackendError, match=r"127\.0\.0\.1:1 does not answer .*check the address"):
        check_preconditions(spec("scout"), replace(service, backend=open_backend(f"{kind}:127.0.0.1:1")))


def test_a_work_pool_that_is_not_there_is_found_before_anything_runs(service: Service, prefect_server: str) -> None:
    with pytest.raises(BackendError, match="has no work pool 'nowhere'"):
        check_preconditions(spec("scout"), replace(service, backend=open_backend("workers:nowhere")))
