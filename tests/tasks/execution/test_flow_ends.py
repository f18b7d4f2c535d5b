"""Ends of flows in Prefect's log."""

import logging

import pytest

from prefect_robomaker.schemas.reports.run_states import FlowResult
from prefect_robomaker.schemas.wire.errors import RobomakerError
from prefect_robomaker.tasks.execution.flow_ends import RunNotSucceeded

RESULT = FlowResult(state="failed", message="failed: 0 of 6 jobs passed")


@pytest.mark.parametrize(
    ("logger", "error", "told"),
    [
        ("prefect.engine", RunNotSucceeded(RESULT, {}), "RunNotSucceeded: failed; the reasons are above"),
        ("prefect.flow_runs", RunNotSucceeded(RESULT, {}), "RunNotSucceeded: failed: 0 of 6 jobs passed"),
        ("prefect.engine", RobomakerError("no such world"), "RobomakerError: no such world"),
    ],
)
def test_reasons_that_the_state_has_told_are_not_logged_again(
    caplog: pytest.LogCaptureFixture, logger: str, error: Exception, told: str
) -> None:
    with caplog.at_level(logging.ERROR, logger=logger):
        logging.getLogger(logger).addHandler(caplog.handler)
        logging.getLogger(logger).error("crashed", exc_info=error)
        logging.getLogger(logger).removeHandler(caplog.handler)

    assert caplog.messages[0] == told
