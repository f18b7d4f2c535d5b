"""How flow runs ended, by what their processes wrote down: only of the process that wrote it, and of no dead one."""

from collections.abc import Callable
from typing import Any
from unittest.mock import Mock
from uuid import uuid4

import pytest
from helpers.night_records import FIRST_NIGHT, make_night, store_night
from prefect.client.schemas.objects import FlowRun
from prefect.states import Crashed, Running

from prefect_robomaker.deployments.dead_run_sweeper import RecordedEnds
from prefect_robomaker.tasks.execution.dead_flow_runs import _NO_SIGN
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

SEEN_TO_DIE = Crashed(message="its Prefect worker has died, so that it ended itself")


def flow_run(**members: Any) -> FlowRun:
    given = {"flow_id": uuid4(), "name": "job", "state": Running(), "start_time": FIRST_NIGHT, **members}
    return FlowRun.model_validate(given)


def ends_of(service: Service, *others: FlowRun) -> RecordedEnds:
    client = Mock()
    client.read_flow_runs.return_value = list(others)
    client.read_flow.return_value.name = "PerformSimulationJob"
    return RecordedEnds(service.settings, client)


@pytest.mark.parametrize(
    ("state", "word", "end"),
    [
        ("succeeded", "passed", "Completed"),
        ("broken", "broken", "Failed"),
        ("canceled", "canceled", "Cancelled"),
    ],
)
def test_the_flow_run_that_wrote_a_record_ended_as_that_says_and_one_before_it_did_not(
    service: Service, state: Any, word: str, end: str
) -> None:
    wrote, died_before = flow_run(state=SEEN_TO_DIE), flow_run()
    record = make_night("PPP", runs=service.settings.home / "runs")
    store_night(record.model_copy(update={"flow_run": wrote.id, "state": state}))
    ends = ends_of(service)

    told = ends.end_of(wrote)
    assert told is not None
    assert (told.name, (told.message or "").partition(":")[0]) == (end, word)
    assert ends.end_of(died_before) is None


@pytest.fixture
def ended_job(service: Service, order: Callable[..., dict[str, Any]]) -> str:
    """ARN of a job that has ended."""
    arn = call("CreateSimulationJob", order(), service)["arn"]
    call("CancelSimulationJob", {"job": arn}, service)
    return str(arn)


def test_a_flow_run_that_was_only_silent_ended_as_its_job_unless_another_went_on_with_that(
    service: Service, ended_job: str
) -> None:
    silent = flow_run(parameters={"arn": ended_job}, state=Crashed(message=_NO_SIGN))
    died = flow_run(parameters={"arn": ended_job}, state=SEEN_TO_DIE)
    later = flow_run(start_time=FIRST_NIGHT.replace(hour=3))

    told = ends_of(service, silent).end_of(silent)
    assert told is not None
    assert told.name == "Cancelled"
    assert ends_of(service, silent, later).end_of(silent) is None
    assert ends_of(service, died).end_of(died) is None


def test_a_job_that_has_not_ended_or_is_another_homes_says_nothing(
    service: Service, order: Callable[..., dict[str, Any]]
) -> None:
    waiting = call("CreateSimulationJob", order(), service)["arn"]
    for arn in (waiting, f"{waiting}0"):
        run = flow_run(parameters={"arn": arn})
        assert ends_of(service, run).end_of(run) is None
