"""Where outputs go."""

from datetime import UTC, datetime
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.outputs.output_places import check_output_location, output_place


def job(location: dict[str, str] | None) -> Resource:
    now = datetime(2026, 1, 2, tzinfo=UTC)
    document: dict[str, Any] = {"request": {"outputLocation": location} if location else {}, "seed": 1}
    return Resource(
        arn="arn", kind="simulation-job", id="sim-1", document=document, created_at=now, updated_at=now, revision=1
    )


@pytest.mark.parametrize(
    ("location", "place"),
    [
        (None, ("robomaker", "simulation-jobs/sim-1/run")),
        ({"s3Bucket": "mine"}, ("mine", "sim-1/run")),
        ({"s3Bucket": "mine", "s3Prefix": "/nightly/flats/"}, ("mine", "nightly/flats/sim-1/run")),
        ({"s3Prefix": "nightly"}, ("robomaker", "nightly/sim-1/run")),
    ],
)
def test_outputs_go_where_the_request_says(
    service: Service, location: dict[str, str] | None, place: tuple[str, str]
) -> None:
    assert output_place(job(location), "run", service) == place


@pytest.mark.parametrize(
    ("location", "member"),
    [
        ({"s3Bucket": "mine", "s3Prefix": "a//b"}, "s3Prefix"),
        ({"s3Bucket": "mine", "s3Prefix": "../b"}, "s3Prefix"),
        ({"s3Bucket": "192.168.0.1", "s3Prefix": "b"}, "s3Bucket"),
    ],
)
def test_a_place_that_no_store_can_hold_is_refused(location: dict[str, str], member: str) -> None:
    with pytest.raises(InvalidParameterException, match=rf"outputLocation\.{member}: .*{location[member]}"):
        check_output_location(location)
