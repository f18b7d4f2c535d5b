"""Applications that exist already: a step takes the one that is there, with its archive as it is now."""

import pytest

from prefect_robomaker.schemas.wire.errors import ResourceAlreadyExistsException
from prefect_robomaker.tasks.operations.existing_resources import update_application
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

SUITE = {"name": "General"}


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
