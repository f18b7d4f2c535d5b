"""Jobs that draw and store after their programs have ended: they hold up no other job, and no timeout ends them."""

import contextvars
import re
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any, Self

import pytest
from helpers.processes import wait_for
from helpers.swing_fixtures import outputs_of

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.runs.programs import StopReason
from prefect_robomaker.tasks.backends.backend import Backend
from prefect_robomaker.tasks.inspection.reports import report_of_job
from prefect_robomaker.tasks.jobs.batch_workers import BatchWorker
from prefect_robomaker.tasks.jobs.job_runs import JobRun, perform_job
from prefect_robomaker.tasks.jobs.simulation_places import Place
from prefect_robomaker.tasks.machine.machine_slots import MachineSlots, Turn
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.reporting import view_report
from prefect_robomaker.tasks.runtime.supervision import launcher as launchers
from prefect_robomaker.tasks.service.service import Progress, Service

Simulate = Callable[..., dict[str, Any]]
FAILS = {"video": "on-failure", "requirements": [{"name": "quick", "kind": "time_limit", "limit_s": 0.05}]}


class WatchedPlace(Place):
    """A place that is free at once, and says what it is told."""

    def __init__(self, on_finish: Callable[[], object]) -> None:
        super().__init__(self._note_turn, lambda _: True)
        self._on_finish = on_finish
        self.turns = 0

    def __enter__(self) -> Self:
        return self

    def _note_turn(self, _: object) -> Turn:
        self.turns += 1
        return Turn({})

    def finish(self) -> None:
        """Tells it first."""
        self._on_finish()
        super().finish()


class WorkerHere(Backend):
    """A job worker in a thread of this process."""

    def __init__(self, service: Service) -> None:
        self._service = service

    def check(self) -> None:
        """Finds itself."""

    @contextmanager
    def job_workers(self, batch: str, wanted: int) -> Generator[Self]:
        """Runs one."""
        with ThreadPoolExecutor(1) as pool:
            worker = BatchWorker(batch, self._service)
            running = pool.submit(contextvars.copy_context().run, worker.run)
            yield self
            worker.stop()
            running.result()

    def look(self) -> str:
        """Says that it is there."""
        return "a job worker here"


@pytest.mark.parametrize("reason", [StopReason.BATCH_TIMED_OUT, StopReason.CANCELED])
def test_a_timeout_of_the_batch_ends_no_job_that_draws(reason: StopReason, service: Service, swing: Simulate) -> None:
    """A cancellation does, as ever."""
    job = swing(perform=False, job=FAILS)
    reasons: list[StopReason] = []
    place = WatchedPlace(lambda: reasons.append(reason))
    perform_job(job["arn"], service, lambda: reasons[0] if reasons else None, place=place)
    ended = call("DescribeSimulationJob", {"job": job["arn"]}, service)
    assert ended["status"] == ("Completed" if reason is StopReason.BATCH_TIMED_OUT else "Canceled")
    assert (outputs_of(service, job) / "last-10s.mp4").exists() == (reason is StopReason.BATCH_TIMED_OUT)


def test_the_next_job_begins_while_one_draws(service: Service, swing: Simulate, prefect_server: str) -> None:
    seen: list[Progress] = []
    watched = service.watched_by(seen.append)
    request = service.catalog.get(swing(perform=False, job=FAILS)["arn"]).document["request"]
    requests = [{**request, "seed": seed} for seed in (1, 2, 3)]
    policy = {"maxConcurrency": 1, "timeoutInSeconds": 600}
    batch = call("StartSimulationJobBatch", {"batchPolicy": policy, "createSimulationJobRequests": requests}, service)
    registry()["StartSimulationJobBatch"].perform(batch["arn"], watched)
    jobs = sorted(service.catalog.children(batch["arn"], kind="simulation-job"), key=lambda job: job.created_at)
    assert any(progress.counts.get("drawing") for progress in seen)
    assert all(sum(progress.counts.values()) == 3 and min(progress.counts.values()) >= 0 for progress in seen)
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


def test_progress_says_that_the_only_job_runs_and_then_that_it_draws(
    service: Service, swing: Simulate, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing else happens in its batch that would be a reason to tell of it."""
    seen: list[Progress] = []

    def after(name: str, state: str) -> None:
        """Lets a method of the job return when the progress has shown a state."""
        method = getattr(JobRun, name)

        def watched(*arguments: Any) -> None:
            method(*arguments)
            wait_for(lambda: any(progress.counts == {state: 1} for progress in seen), f"the progress to say {state}")

        monkeypatch.setattr(JobRun, name, watched)

    after("_note_begin", "running")
    after("_note_simulated", "drawing")
    request = service.catalog.get(swing(perform=False, job=FAILS)["arn"]).document["request"]
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [request]}, service)
    ended = registry()["StartSimulationJobBatch"].perform(batch["arn"], service.watched_by(seen.append))
    assert ended["status"] == "Completed"
    assert seen[-1].counts == {"failed": 1}, "that it completed says nothing of its verdict"


@pytest.mark.deep
def test_a_job_worker_takes_the_next_job_while_one_draws(
    service: Service, swing: Simulate, prefect_server: str
) -> None:
    """Although the batch and the machine let one job run at once."""
    request = service.catalog.get(swing(perform=False, job=FAILS)["arn"]).document["request"]
    requests = [{**request, "seed": seed} for seed in (1, 2)]
    order = {"batchPolicy": {"maxConcurrency": 1}, "createSimulationJobRequests": requests}
    batch = call("StartSimulationJobBatch", order, service)
    narrow = replace(service, settings=service.settings.model_copy(update={"max_jobs": 1}))
    there = replace(service, backend=WorkerHere(narrow))
    assert registry()["StartSimulationJobBatch"].perform(batch["arn"], there)["status"] == "Completed"
    jobs = service.catalog.children(batch["arn"], kind="simulation-job")
    times = {job.arn: SimulationJobDocument.of(job) for job in jobs}
    # By their beginnings, since either may be the first whose pictures are done.
    first, second = sorted(jobs, key=lambda job: times[job.arn].started_at or job.updated_at)
    began, drawn = times[second.arn].started_at, times[first.arn].simulated_at
    assert began is not None
    assert drawn is not None
    assert datetime.fromisoformat(drawn) < began < first.updated_at
    assert all((outputs_of(service, {"arn": job.arn}) / "last-10s.mp4").exists() for job in (first, second))


@pytest.mark.deep
def test_a_job_that_is_restarted_while_it_draws_waits_for_its_place_again(service: Service, swing: Simulate) -> None:
    job = swing(perform=False, job=FAILS)
    restarts = [1]

    def restart() -> None:
        if restarts:
            restarts.pop()
            call("RestartSimulationJob", {"job": job["arn"]}, service)

    class Restarted(WatchedPlace):
        def finish(self) -> None:
            super().finish()
            restart()

    with Restarted(lambda: None) as place:
        perform_job(job["arn"], service, place=place)
    document = SimulationJobDocument.of(service.catalog.get(job["arn"]))
    assert (place.turns, len(document.earlier_runs), document.verdict) == (2, 1, "FAIL")


def test_a_single_job_gives_back_its_slot_of_the_machine_while_it_draws(service: Service, swing: Simulate) -> None:
    job = swing(perform=False, job=FAILS)
    narrow = replace(service, settings=service.settings.model_copy(update={"max_jobs": 1}))
    free: list[bool] = []

    def look(*_: object) -> None:
        slots = MachineSlots(narrow.settings)
        if (slot := slots.take()) is not None:
            slots.give_back(slot)
        slots.leave()
        free.append(slot is not None)

    film = launchers.record_failure_videos
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(launchers, "record_failure_videos", lambda *given, **more: (look(), film(*given, **more)))
        registry()["CreateSimulationJob"].perform(job["arn"], narrow)
    assert free == [True]


def test_slots_that_cannot_be_given_back_cost_no_result(service: Service, swing: Simulate) -> None:
    """The disk of the machine is full."""

    def full() -> None:
        raise OSError(28, "No space left on device")

    job = swing(perform=False, job=FAILS)
    perform_job(job["arn"], service, place=WatchedPlace(full))
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

    def note_simulated(run: JobRun, is_drawn: bool) -> None:
        note(run, is_drawn)
        late.append(601.0)

    note = JobRun._note_simulated
    monkeypatch.setattr(JobRun, "_note_simulated", note_simulated)
    shifted = replace(service, clock=lambda: service.clock() + timedelta(seconds=sum(late)))
    ended = registry()["StartSimulationJobBatch"].perform(batch["arn"], shifted)
    assert ended["status"] == "Completed"
    assert [each["status"] for each in ended["createdRequests"]] == ["Completed"]
