"""Steps of a run as its page shows them."""

import pytest

from prefect_robomaker.deployments.console.orders.ordered_runs import _look
from prefect_robomaker.deployments.spec_runs.spec_runs import StepStanding


@pytest.mark.parametrize(
    ("status", "going", "ended"),
    [
        ("waiting", "waiting", "never begun"),
        ("running", "running", "broke off"),
        ("Completed", "Completed", "Completed"),
        ("Failed", "Failed", "Failed"),
        ("Skipped", "Skipped", "Skipped"),
    ],
)
def test_a_step_of_a_run_that_goes_on_and_of_one_that_broke_off(status: str, going: str, ended: str) -> None:
    step = StepStanding(name="drive", operation="StartSimulationJobBatch", status=status)
    assert [_look(step, is_going=is_going).value for is_going in (True, False)] == [going, ended]
