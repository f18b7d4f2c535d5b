from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.deployments.endpoint.calling.authentication import Replays, is_repeatable
from prefect_robomaker.deployments.endpoint.protocol_errors import InvalidSignatureException
from prefect_robomaker.schemas.wire.errors import ThrottlingException

VALID = timedelta(minutes=5)
NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)
ONE, OTHER = "1" * 64, "2" * 64


def seconds(count: float) -> timedelta:
    return timedelta(seconds=count)


def test_a_signature_is_used_once() -> None:
    replays = Replays(VALID)
    replays.check(ONE, NOW, NOW, repeatable=False)
    replays.check(OTHER, NOW, NOW, repeatable=False)

    with pytest.raises(ThrottlingException, match="sign again"):  # which SDKs do when they try again
        replays.check(ONE, NOW, NOW + seconds(1), repeatable=False)
    for later in (3, 299):
        for repeatable in (False, True):
            with pytest.raises(InvalidSignatureException, match="served already"):
                replays.check(ONE, NOW, NOW + seconds(later), repeatable=repeatable)


def test_a_retry_in_the_same_second_is_served_where_it_does_no_harm() -> None:
    replays = Replays(VALID)
    for later in (0, 0.5, 2):
        replays.check(ONE, NOW, NOW + seconds(later), repeatable=True)


@given(st.floats(-300, 300), st.floats(0, 700))
def test_a_signature_that_is_still_valid_is_remembered(skew_s: float, later_s: float) -> None:
    replays = Replays(VALID)
    signed_at, later = NOW + seconds(skew_s), NOW + seconds(later_s)
    replays.check(ONE, signed_at, NOW, repeatable=False)
    replays.check(OTHER, later, later, repeatable=False)  # which forgets what is not valid any more

    if later - signed_at <= VALID:
        with pytest.raises((InvalidSignatureException, ThrottlingException)):
            replays.check(ONE, signed_at, later, repeatable=False)


def test_old_signatures_are_forgotten() -> None:
    replays = Replays(VALID)
    for number in range(100):
        now = NOW + seconds(60 * number)
        replays.check(f"{number:064x}"[::-1], now, now, repeatable=False)

    assert len(replays) < 10


@pytest.mark.parametrize(
    ("operation", "members", "expected"),
    [
        ("ListWorlds", {}, True),
        ("CancelSimulationJob", {}, True),
        ("CreateSimulationJob", {"clientRequestToken": "a"}, True),
        ("CreateSimulationJob", {}, False),
        ("CreateFleet", {}, False),
        ("RestartSimulationJob", {}, False),
        ("SyncDeploymentJob", {}, False),
    ],
)
def test_what_may_come_twice(operation: str, members: dict[str, str], expected: bool) -> None:
    assert is_repeatable(operation, members) is expected
