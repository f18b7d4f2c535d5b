"""A robot carries out only deployments newer than its last one; to be asked for the one that runs is no mistake."""

import pytest

from prefect_robomaker.tasks.fleet.agent.deployment import Deployment, File, Launch, Version
from prefect_robomaker.tasks.fleet.agent.newer_deployments import is_newer, why_refused


def version(job: str) -> Version:
    return Version("courier", "1.0", f"{1:064x}", Launch("courier", "drive"), job)


def deployment(number: int) -> Deployment:
    return Deployment(version(f"job-{number}"), File("x", 1, f"{number:064x}"), None, number)


@pytest.mark.parametrize(("number", "newer"), [(2, False), (3, False), (4, True)])
def test_only_a_larger_number_is_newer(number: int, newer: bool) -> None:
    assert is_newer(deployment(number), 3) is newer


def test_the_reason_names_the_deployment_its_number_and_the_last_one() -> None:
    reason = "job-2 has number 2, and the robot has carried out number 3: only newer deployments count"
    assert why_refused(deployment(2), 3, version("job-3")) == reason
    assert why_refused(deployment(2), 3, None) == reason


def test_the_deployment_of_the_good_version_is_not_refused() -> None:
    assert why_refused(deployment(3), 3, version("job-3")) is None
