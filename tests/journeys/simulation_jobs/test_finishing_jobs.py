"""Jobs that draw and store after their programs have ended: they hold up no other job, and no timeout ends them."""

import re
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta
from typing import Any

import pytest
from helpers.swing_fixtures import outputs_of

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.runs.stops import StopReason
from prefect_robomaker.tasks.inspection.reports import report_of_job
from prefect_robomaker.tasks.jobs.job_runs import JobRun, perform_job
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.reporting import view_report
from prefect_robomaker.tasks.service.service import Service

Simulate = Callable[..., dict[str, Any]]
FAILS = {"video": "on-failure", "requirements": [{"name": "quick", "kind": "time_limit", "limit_s": 0.05}]}


@pytest.mark.parametrize("reason", [StopReason.BATCH_TIMED_OUT, StopReason.CANCELED])
def test_a_timeout_of_the_batch_ends_no_job_that_draws(reason: StopReason, service: Service, swing: Simulate) -> None:
    """A cancellation does, as ever."""
    job = swing(perform=False, job=FAILS)
    reasons: list[StopReason] = []
    perform_job(
        job["arn"], service, lambda: reasons[0] if reasons else None, on_simulated=lambda: reasons.append(reason)
    )
    ended = call("DescribeSimulationJob", {"job": job["arn"]}, service)
    assert ended["status"] == ("Completed" if reason is StopReason.BATCH_TIMED_OUT else "Canceled")
    assert (outputs_of(service, job) / "last-10s.mp4").exists() == (reason is StopReason.BATCH_TIMED_OUT)


def test_the_next_job_begins_while_one_draws(service: Service, swing: Simulate, prefect_server: str) -> None:
    request = service.catalog.get(swing(perform=False, job=FAILS)["arn"]).document["request"]
    requests = [{**request, "seed": seed} for seed in (1, 2, 3)]
    policy = {"maxConcurrency": 1, "timeoutInSeconds": 600}
    batch = call("StartSimulationJobBatch", {"batchPolicy": policy, "createSimulationJobRequests": requests}, service)
    registry()["StartSimulationJobBatch"].perform(batch["arn"], service)
    jobs = sorted(service.catalog.children(batch["arn"], kind="simulation-job"), key=lambda job: job.created_at)
    assert [job.status for job in jobs] == ["Completed"] * 3
    assert all((outputs_of(service, {"arn": job.arn}) / "last-10s.mp4").exists() for job in jobs)
    assert [SimulationJobDocument.of(job).request_index for job in jobs] == [0, 1, 2], "in the order of the requests"
    first, second, third = jobs
    assert second.created_at < first.updated_at, "the slot is free while the first one is drawn"
    assert third.created_at >= min(first.updated_at, second.updated_at), "at most twice as many as slots"
    # The report says where the time went.
    documents = [SimulationJobDocument.of(job) for job in jobs]
    assert all(document.video_s and document.upload_s for document in documents)
    page = view_report(report_of_job(first.arn, service))
    assert re.fullmatch(r"(simulation .*, )?videos of failures [^,]*(, uploads .*)?", page.times)


def test_slots_that_cannot_be_given_back_cost_no_result(service: Service, swing: Simulate) -> None:
    """The disk of the machine is full."""

    def full() -> None:
        raise OSError(28, "No space left on device")

    job = swing(perform=False, job=FAILS)
    perform_job(job["arn"], service, on_simulated=full)
    ended = SimulationJobDocument.of(service.catalog.get(job["arn"]))
    assert (ended.verdict, ended.failure_code) == ("FAIL", None)


def test_a_timeout_that_comes_when_all_jobs_only_draw_ends_no_batch(
    service: Service, swing: Simulate, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = service.catalog.get(swing(perform=False, job=FAILS)["arn"]).document["request"]
    batch = call(
        "StartSimulationJobBatch",
        {"batchPolicy": {"timeoutInSeconds": 600}, "createSimulationJobRequests": [request]},
        service,
    )
    late: list[float] = []

    def note_simulated(run: JobRun) -> None:
        note(run)
        late.append(601.0)

    note = JobRun._note_simulated
    monkeypatch.setattr(JobRun, "_note_simulated", note_simulated)
    shifted = replace(service, clock=lambda: service.clock() + timedelta(seconds=sum(late)))
    ended = registry()["StartSimulationJobBatch"].perform(batch["arn"], shifted)
    assert ended["status"] == "Completed"
    assert [each["status"] for each in ended["createdRequests"]] == ["Completed"]
