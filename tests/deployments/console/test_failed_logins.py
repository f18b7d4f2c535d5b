"""Ten logins of an address may fail within a minute; other addresses do not notice."""

import pytest

from prefect_robomaker.deployments.console.failed_logins import FailedLogins
from prefect_robomaker.schemas.wire.errors import ThrottlingException


def failed(times: int, client: str = "") -> FailedLogins:
    found = FailedLogins()
    for second in range(times):
        found.note(client, float(second))
    return found


def test_the_tenth_failure_within_a_minute_closes_the_door() -> None:
    failed(9).check("", 9.0)
    with pytest.raises(ThrottlingException, match="10 logins failed within a minute; try again in a minute"):
        failed(10).check("", 9.0)


def test_a_minute_after_the_oldest_of_ten_it_opens() -> None:
    with pytest.raises(ThrottlingException):
        failed(30).check("", 79.0)
    failed(30).check("", 80.0)


def test_each_address_has_failures_of_its_own() -> None:
    failed(10, "192.0.2.1").check("192.0.2.2", 9.0)


def test_of_very_many_addresses_the_one_that_failed_longest_ago_is_forgotten() -> None:
    found = failed(10, "first")
    for number in range(10_000):
        found.note(f"address {number}", 10.0)
    found.check("first", 11.0)
