"""ARNs and ids."""

import random
import re
from datetime import UTC, datetime
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.arns import (
    IdPrefix,
    Kind,
    ResourceArn,
    application_arn,
    new_id,
    resource_arn,
    world_id,
)
from prefect_robomaker.schemas.wire.errors import InvalidParameterException


@pytest.mark.parametrize(
    ("arn", "kind", "name"),
    [
        ("arn:aws:robomaker:us-east-1:1" + 11 * "0" + ":simulation-job/sim-g0959w53813w", "simulation-job", None),
        ("arn:aws:robomaker:us-west-2:111122223333:world/generation-05wq8sybdcn2/world-1", "world", None),
        (
            "arn:aws:robomaker:us-east-1:111122223333:simulation-application/MySimulationApplication/1551203427605",
            "simulation-application",
            "MySimulationApplication",
        ),
        ("arn:aws-us-gov:robomaker:us-gov-west-1:111122223333:robot/R2/1", "robot", "R2"),
    ],
)
def test_published_arns_are_taken_apart_and_put_together(arn: str, kind: str, name: str | None) -> None:
    parsed = ResourceArn.parse(arn)

    assert (str(parsed), parsed.kind) == (arn, kind)
    assert parsed.name == (name or parsed.id)


@pytest.mark.parametrize(
    ("arn", "expected"),
    [
        ("my-app", "'my-app' is no ARN of a resource; it has to look like arn:aws:robomaker:"),
        ("arn:aws:robomaker:us-east-1:111122223333:simulation-applicationMyApp", "is no ARN"),
        ("arn:aws:s3:us-east-1:111122223333:bucket/b", "is no ARN"),
        ("arn:aws:robomaker:us-east-1:123:world/w", "is no ARN"),
        ("arn:aws:robomaker:us-east-1:111122223333:world/", "is no ARN"),
        ("arn:aws:robomaker:us-east-1:111122223333:simulationjob/sim-1", "did you mean 'simulation-job'"),
        ("arn:aws:robomaker:us-east-1:111122223333:robot/r/1", "names a robot; it has to name a world"),
    ],
)
def test_what_is_no_arn_of_the_kind_is_refused(arn: str, expected: str) -> None:
    with pytest.raises(InvalidParameterException, match=expected):
        ResourceArn.parse(arn, "world")


@given(
    st.sampled_from(get_args(Kind)),
    st.from_regex(r"[a-z0-9-]{1,20}", fullmatch=True),
    st.from_regex(r"[0-9]{12}", fullmatch=True).filter(str.isascii),
    st.text(st.characters(exclude_characters="\n\r", codec="ascii"), min_size=1, max_size=30),
)
def test_every_arn_that_is_built_can_be_taken_apart(kind: Kind, region: str, account: str, resource_id: str) -> None:
    arn = resource_arn(region, account, kind, resource_id)

    assert ResourceArn.parse(arn, kind) == ResourceArn(region, account, kind, resource_id)


def test_an_applications_arn_ends_with_the_millisecond_it_was_created() -> None:
    created = datetime(2019, 2, 26, 17, 50, 27, 605_000, tzinfo=UTC)

    arn = application_arn("us-east-1", "111122223333", "robot-application", "MyApp", created)

    assert arn == "arn:aws:robomaker:us-east-1:111122223333:robot-application/MyApp/1551203427605"


def test_an_unknown_kind_cannot_be_built() -> None:
    with pytest.raises(ValueError, match="'worlds'; did you mean 'world'"):
        resource_arn("us-east-1", "111122223333", "worlds", "w")


@given(st.sampled_from(get_args(IdPrefix)), st.integers())
def test_ids_look_like_the_services(prefix: IdPrefix, seed: int) -> None:
    first, again = (new_id(prefix, random.Random(seed)) for _ in range(2))

    assert re.fullmatch(rf"{prefix}-[0-9a-z]{{12}}", first)
    assert first == again


def test_worlds_are_counted_from_one() -> None:
    assert world_id("generation-05wq8sybdcn2", 1) == "generation-05wq8sybdcn2/world-1"
    with pytest.raises(ValueError, match="world number is 0"):
        world_id("generation-05wq8sybdcn2", 0)
