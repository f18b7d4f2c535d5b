"""Parts of a job as task runs: one for each, or one for all."""

import threading
from collections.abc import Callable
from dataclasses import replace

import pytest

from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException
from prefect_robomaker.tasks.execution.task_pool import run_tasks
from prefect_robomaker.tasks.service.service import Service, Timing

AS_EACH_AND_AS_ONE = pytest.mark.parametrize("summary", [None, lambda: "so it went"], ids=["each", "one"])
JOB = "arn:aws:robomaker:us-east-1:000000000000:simulation-job-batch/batch-0000"


@AS_EACH_AND_AS_ONE
def test_calls_that_have_not_begun_are_left_out_once_the_job_stops(
    summary: Callable[[], str] | None, service: Service, prefect_server: str
) -> None:
    begun: list[int] = []
    stopped = threading.Event()

    def part(index: int) -> None:
        begun.append(index)
        stopped.wait(120)

    def look() -> bool:
        if begun:
            threading.Timer(1.0, stopped.set).start()
        return bool(begun)

    calls = [{"index": index} for index in range(20)]
    run_tasks("p", part, calls, run_name="{index}", workers=2, job_arn=JOB, service=service, look=look, summary=summary)

    assert 1 <= len(begun) <= 4


@AS_EACH_AND_AS_ONE
def test_what_a_call_raises_is_raised_once_all_have_ended(
    summary: Callable[[], str] | None, service: Service, prefect_server: str
) -> None:
    ended: list[int] = []

    def part(index: int) -> None:
        if index == 1:
            raise LookupError("no such world")
        ended.append(index)

    calls = [{"index": index} for index in range(5)]
    with pytest.raises(LookupError, match="no such world"):
        run_tasks("part", part, calls, run_name="{index}", workers=2, job_arn=JOB, service=service, summary=summary)

    assert sorted(ended) == [0, 2, 3, 4]


@AS_EACH_AND_AS_ONE
def test_an_interruption_asks_for_the_jobs_end_and_is_raised_once_its_parts_have_ended(
    summary: Callable[[], str] | None, service: Service, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = threading.Event()
    begun: list[int] = []
    ended: list[int] = []
    tries = iter((False, True))  # the catalog is away at first
    service = replace(service, timing=Timing(after_outage_s=0.01))

    def request_cancel(_catalog: object, _arn: str) -> None:
        if not next(tries):
            raise ServiceUnavailableException("the catalog does not answer")
        asked.set()

    monkeypatch.setattr(type(service.catalog), "request_cancel", request_cancel)

    def part(index: int) -> None:
        begun.append(index)
        assert asked.wait(120)
        ended.append(index)

    def look() -> None:
        if len(begun) == 3 and not asked.is_set():
            raise KeyboardInterrupt

    calls = [{"index": index} for index in range(3)]
    with pytest.raises(KeyboardInterrupt):
        run_tasks(
            "part",
            part,
            calls,
            run_name="{index}",
            workers=3,
            job_arn=JOB,
            service=service,
            look=look,
            summary=summary,
        )

    assert sorted(ended) == [0, 1, 2]
