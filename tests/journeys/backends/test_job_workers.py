"""Batches whose jobs run in job workers with homes of their own; only catalog and object store are common."""

import contextvars
import re
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.job_worker_backend import HomesBackend
from helpers.processes import wait_for
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobBatchDocument
from prefect_robomaker.tasks.backends.backend import BackendError
from prefect_robomaker.tasks.inspection.reports import simulation_jobs
from prefect_robomaker.tasks.jobs.batch_workers import WorkerWait
from prefect_robomaker.tasks.machine.machine_slots import jobs_that_wait
from prefect_robomaker.tasks.machine.slot_files import Holder, SlotFiles
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Progress, Service

Order = Callable[..., dict[str, Any]]
MEET = """
import os, pathlib, time
meeting = pathlib.Path({folder!r}, "meeting")
meeting.mkdir(exist_ok=True)
(meeting / os.environ["AWS_ROBOMAKER_SIMULATION_JOB_ID"]).touch()
while len(list(meeting.iterdir())) < {count}:
    time.sleep(0.1)
"""
"""Has jobs begin at the same time: each machine has room for one."""


@pytest.fixture
def homes(service: Service, tmp_path: Path) -> HomesBackend:
    """Two machines with room for one job each."""
    variables = {
        "ROBOMAKER_CATALOG_URL": service.settings.catalog_url,
        "ROBOMAKER_OBJECT_STORE": service.settings.object_store,
        "ROBOMAKER_MAX_JOBS": "1",
    }
    return HomesBackend([tmp_path / "first", tmp_path / "second"], variables)


class NoMachine:
    """A backend none of whose machines can run jobs, as it turns out after a while."""

    def __init__(self) -> None:
        self._looks = 0

    @contextmanager
    def job_workers(self, batch: str, wanted: int) -> Iterator["NoMachine"]:
        """Has none."""
        del batch, wanted
        yield self

    def look(self) -> str:
        """Gives up at the fourth look."""
        self._looks += 1
        if self._looks > 3:
            raise BackendError("no machine of the cluster can run jobs: hal: its catalog does not have the batch")
        return "no job worker yet"


@pytest.fixture
def run_batch(service: Service, prefect_server: str, homes: HomesBackend) -> Callable[..., dict[str, Any]]:
    """Runs a batch on the homes and returns its description."""

    def run(requests: list[dict[str, Any]], notes: list[str], **policy: Any) -> dict[str, Any]:
        request = {"createSimulationJobRequests": requests, "batchPolicy": policy}
        batch = call("StartSimulationJobBatch", request, service)
        watched = replace(service, backend=homes, report_note=notes.append)
        return registry()["StartSimulationJobBatch"].perform(batch["arn"], watched)

    return run


def counts(homes: HomesBackend) -> list[int]:
    """How many jobs each worker says it ran."""
    return [int(re.search(r"ran (\d+) jobs?", ended.last_words)[1]) for ended in homes.ended]  # type: ignore[index]


@pytest.mark.deep
def test_jobs_of_a_batch_run_on_both_machines_and_nothing_of_it_here(
    order: Order,
    homes: HomesBackend,
    run_batch: Callable[..., dict[str, Any]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROBOMAKER_SANDBOX", "off")  # the jobs meet in a folder
    notes: list[str] = []
    homes.patience_s = 120
    meet = {"DO": MEET.format(folder=str(tmp_path), count=2)}

    batch = run_batch([order(meet, maxJobDurationInSeconds=300) for _ in range(2)], notes, maxConcurrency=2)

    assert batch["status"] == "Completed"
    assert [job["status"] for job in batch["createdRequests"]] == ["Completed"] * 2
    assert [ended.exit_code for ended in homes.ended] == [0, 0], homes.ended
    assert counts(homes) == [1, 1]
    assert any("2 job workers on this machine" in note for note in notes)


def test_a_batch_that_no_machine_can_run_fails_and_says_why(
    service: Service, order: Order, prefect_server: str
) -> None:
    request = {"createSimulationJobRequests": [order() for _ in range(9)], "batchPolicy": {"maxConcurrency": 2}}
    batch = call("StartSimulationJobBatch", request, service)

    ended = registry()["StartSimulationJobBatch"].perform(batch["arn"], replace(service, backend=NoMachine()))

    assert (ended["status"], ended["failureCode"]) == ("Failed", "InternalServiceError")
    assert "hal: its catalog does not have the batch" in ended["failureReason"]
    assert {job["status"] for job in ended["createdRequests"]} <= {"Canceled"}
    assert len(ended["createdRequests"]) + len(ended["failedRequests"]) == 9
    assert ended["pendingRequests"] == []


class LateMachine:
    """A backend whose only machine comes once somebody has been told that jobs wait for one."""

    def __init__(self, homes: HomesBackend) -> None:
        self._homes = homes
        self.is_wanted = threading.Event()

    @contextmanager
    def job_workers(self, batch: str, wanted: int) -> Iterator["LateMachine"]:
        """Has none at first."""

        def come() -> None:
            self.is_wanted.wait(120)
            with self._homes.job_workers(batch, wanted):
                pass

        coming = threading.Thread(target=come)
        coming.start()
        yield self
        coming.join()

    def look(self) -> str:
        """Says nothing new."""
        return "no machine yet"


@pytest.mark.deep
def test_who_watches_a_batch_is_told_that_its_jobs_wait_for_a_job_worker(
    service: Service, order: Order, prefect_server: str, homes: HomesBackend
) -> None:
    del homes.homes[1:]
    homes.patience_s = 120
    late, seen = LateMachine(homes), list[Progress]()

    def watch(progress: Progress) -> None:
        seen.append(progress)
        if progress.waits_for == "worker":
            late.is_wanted.set()

    request = {"createSimulationJobRequests": [order()], "batchPolicy": {"maxConcurrency": 1}}
    batch = call("StartSimulationJobBatch", request, service)
    watched = replace(service, backend=late).watched_by(watch)

    assert registry()["StartSimulationJobBatch"].perform(batch["arn"], watched)["status"] == "Completed"
    assert late.is_wanted.is_set()
    assert seen[0].waits_for is None
    assert seen[-1].waits_for is None


@given(seen=st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.floats(0, 2)), max_size=20))
def test_a_job_worker_is_waited_for_once_jobs_wait_and_none_runs_for_a_while(seen: Any) -> None:
    wait, now_s, since_s = WorkerWait(), 0.0, None
    for pending, running, passed_s in seen:
        now_s += passed_s
        since_s = (now_s if since_s is None else since_s) if pending and not running else None
        expected = since_s is not None and now_s - since_s >= 3.0
        assert wait.lasts(pending, running, now_s) == expected


@pytest.mark.deep
def test_a_limit_that_is_lowered_in_prefect_is_followed(
    service: Service, order: Order, homes: HomesBackend, prefect_server: str
) -> None:
    from prefect.client.orchestration import get_client

    homes.patience_s = 120
    requests = [order({"DURATION_S": "6"}) for _ in range(4)]
    request = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": 2}}
    batch = call("StartSimulationJobBatch", request, service)["arn"]
    perform, there = registry()["StartSimulationJobBatch"].perform, replace(service, backend=homes)

    def running() -> int:
        return service.catalog.count_children(batch, "simulation-job").get("Running", 0)

    with ThreadPoolExecutor(1) as pool:
        ending = pool.submit(contextvars.copy_context().run, perform, batch, there)  # with Prefect's settings
        wait_for(lambda: running() == 2, "two jobs to run", 120)
        with get_client(sync_client=True) as client:
            client.upsert_global_concurrency_limit_by_name(f"robomaker-{batch.rpartition('/')[2]}", 1)
        allowed = lambda: SimulationJobBatchDocument.of(service.catalog.get(batch)).concurrency  # noqa: E731
        wait_for(lambda: allowed() == 1 and running() == 1, "one job to run alone", 120)
        most = 0
        while not ending.done():
            most = max(most, running())
            time.sleep(0.2)

    assert most == 1
    assert ending.result()["status"] == "Completed"
    assert service.catalog.count_children(batch, "simulation-job") == {"Completed": 4}


@pytest.mark.deep
def test_a_job_has_how_long_its_job_worker_waited_for_room(
    service: Service, order: Order, homes: HomesBackend, run_batch: Callable[..., dict[str, Any]]
) -> None:
    del homes.homes[1:]  # a second machine's job worker may take the job when it has not waited for long
    machine = service.settings.model_copy(update={"home": homes.homes[0]})
    slots = SlotFiles(machine.home / "slots", 1)
    slot = slots.take([0], Holder(batch="another"))
    assert slot is not None

    def make_room() -> None:
        has_waited = lambda: any(time.time() - each.since_s > 2.0 for each in jobs_that_wait(machine))  # noqa: E731
        wait_for(has_waited, "a job worker to wait for room", 120.0)
        slots.give_back(slot)

    helper = threading.Thread(target=make_room, daemon=True)
    helper.start()
    batch = run_batch([order()], [], maxConcurrency=1)
    helper.join(120.0)

    assert batch["status"] == "Completed"
    [job] = simulation_jobs("StartSimulationJobBatch", batch["arn"], service)
    assert set(job.waited_s) == {"slots"}
    assert job.waited_s["slots"] >= 1.5
