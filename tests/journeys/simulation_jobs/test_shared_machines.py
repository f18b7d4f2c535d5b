"""Jobs on a machine that others use as well: they wait with a reason, share with other batches, and are nice."""

import contextvars
import os
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import started, wait_for, working_below

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.inspection.reports import simulation_jobs
from prefect_robomaker.tasks.machine.slot_files import Holder, SlotFiles
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Progress, Service

Order = Callable[..., dict[str, Any]]


def changed(service: Service, **settings: Any) -> Service:
    return replace(service, settings=service.settings.model_copy(update=settings))


def begin(operation: str, arn: str, service: Service) -> threading.Thread:
    """Performs a job in a thread, with the test's own Prefect server."""
    context = contextvars.copy_context()
    thread = threading.Thread(target=context.run, args=(registry()[operation].perform, arn, service), daemon=True)
    thread.start()
    return thread


@pytest.mark.parametrize("operation", ["CreateSimulationJob", "StartSimulationJobBatch"])
def test_a_job_for_which_the_disk_has_no_room_says_so_and_can_be_cancelled(
    service: Service, order: Order, prefect_server: str, operation: str
) -> None:
    request = order() if operation == "CreateSimulationJob" else {"createSimulationJobRequests": [order()]}
    arn = call(operation, request, service)["arn"]
    notes: list[str] = []

    def cancel(note: str) -> None:
        notes.append(note)
        service.catalog.request_cancel(arn)

    full = replace(changed(service, min_free_disk_mb=9_999_999), report_note=cancel)
    ended = registry()[operation].perform(arn, full)

    assert ended["status"] == "Canceled"
    assert working_below(service.settings.home) == set()
    [note] = notes
    assert arn.rpartition("/")[2] in note
    assert note.endswith("a job begins with at least 9999999 MB (ROBOMAKER_MIN_FREE_DISK_MB)")


@pytest.mark.parametrize("operation", ["CreateSimulationJob", "StartSimulationJobBatch"])
def test_what_a_job_waited_for_is_shown_meanwhile_and_in_the_report(
    service: Service, order: Order, prefect_server: str, operation: str
) -> None:
    request = order() if operation == "CreateSimulationJob" else {"createSimulationJobRequests": [order()]}
    arn = call(operation, request, service)["arn"]
    shown: list[Progress] = []
    other = SlotFiles(service.settings.home / "slots", 1)
    slot = other.take([0], Holder(batch="another"))
    assert slot is not None

    def end_other(progress: Progress) -> None:
        nonlocal slot
        shown.append(progress)
        if progress.waits_for == "slots" and slot is not None:
            other.give_back(slot)
            slot = None

    watched = replace(changed(service, max_jobs=1), report_progress=end_other)
    ended = registry()[operation].perform(arn, watched)

    assert ended["status"] == "Completed"
    assert Progress({"pending": 1}, 1, "slots") in [pending(progress) for progress in shown]
    assert shown[-1].waits_for is None
    [job] = simulation_jobs(operation, arn, service)
    assert set(job.waited_s) == {"slots"}
    assert job.waited_s["slots"] >= 2.0


def pending(progress: Progress) -> Progress:
    """Progress without states that nothing is in."""
    return replace(progress, counts={state: count for state, count in progress.counts.items() if count})


def test_simulations_have_the_niceness_that_the_setting_says(
    service: Service, order: Order, prefect_server: str
) -> None:
    own = niceness(os.getpid())
    arn = call("CreateSimulationJob", order({"DURATION_S": "60", "SPAWN": "1"}), service)["arn"]
    performing = begin("CreateSimulationJob", arn, changed(service, nice=7))
    try:
        wait_for(lambda: len(working_below(service.settings.home)) >= 2, "the run and the program it starts")
        found = {niceness(pid) for pid in working_below(service.settings.home)}
    finally:
        service.catalog.request_cancel(arn)
        performing.join(200.0)

    assert found == {7}
    assert niceness(os.getpid()) == own


def niceness(pid: int) -> int:
    return os.getpriority(os.PRIO_PROCESS, pid)


@pytest.mark.deep
def test_an_urgent_batch_gets_the_slots_of_one_that_began_before(
    service: Service, order: Order, prefect_server: str, tmp_path: Path
) -> None:
    """Each batch has a process of its own and could use every slot."""
    slots = SlotFiles(service.settings.home / "slots", 2)
    variables = {
        "ROBOMAKER_HOME": str(service.settings.home),
        "ROBOMAKER_MAX_JOBS": "2",
        "ROBOMAKER_JOB_MEMORY_MB": "0",
        "PREFECT_API_URL": prefect_server,
    }

    def start(count: int, **policy: int) -> tuple[str, list[str]]:
        requests = [order({"DURATION_S": "2"}) for _ in range(count)]
        request = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": 9, **policy}}
        arn = call("StartSimulationJobBatch", request, service)["arn"]
        return arn, [sys.executable, "-m", "prefect_robomaker.deployments.cli.main", "perform", arn]

    def status(arn: str) -> str:
        return service.catalog.get(arn).status

    def begun(arn: str) -> list[datetime]:
        jobs = service.catalog.children(arn, kind="simulation-job")
        return sorted(
            datetime.fromisoformat(each) for job in jobs if (each := SimulationJobDocument.of(job).last_started_at)
        )

    first, perform_first = start(200)  # for minutes: on a busy machine the second process takes as long to begin
    urgent, perform_urgent = start(6, priority=10)
    with (tmp_path / "log").open("w") as log, started(perform_first, variables, stdout=log, stderr=log):
        wait_for(lambda: slots.look().by_batch() == {first: 2}, "both slots to be the first batch's")
        with started(perform_urgent, variables, stdout=log, stderr=log):
            wait_for(lambda: slots.look().by_batch() == {urgent: 2}, "both slots to be the urgent batch's")
            wait_for(lambda: status(urgent) == "Completed", "the urgent batch")
        assert status(first) == "InProgress"
        between = [each for each in begun(first) if begun(urgent)[1] < each < begun(urgent)[-1]]

    assert between == [], "a slot of the urgent batch went to the other while it had requests left"
    described = call("DescribeSimulationJobBatch", {"batch": urgent}, service)
    assert described["batchPolicy"] == {"timeoutInSeconds": 1_209_600, "maxConcurrency": 9, "priority": 10}


def test_a_batch_without_a_priority_is_described_as_the_service_did(service: Service, order: Order) -> None:
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [order()]}, service)

    assert "priority" not in batch["batchPolicy"]


def test_clients_that_know_no_priority_give_it_by_a_tag(service: Service, order: Order) -> None:
    request = {"createSimulationJobRequests": [order()], "tags": {"robomaker:priority": "-5"}}

    assert call("StartSimulationJobBatch", request, service)["batchPolicy"]["priority"] == -5
    with pytest.raises(InvalidParameterException, match=r"priority is 3, but tags\.robomaker:priority is -5"):
        call("StartSimulationJobBatch", {**request, "batchPolicy": {"priority": 3}}, service)
    with pytest.raises(
        InvalidParameterException, match=r"tags\.robomaker:priority is 'soon'; it has to be a whole number from -100"
    ):
        call("StartSimulationJobBatch", {**request, "tags": {"robomaker:priority": "soon"}}, service)
    with pytest.raises(InvalidParameterException, match=r"batchPolicy\.priority: is 101; it may be at most 100"):
        call("StartSimulationJobBatch", {**request, "batchPolicy": {"priority": 101}}, service)
