"""Jobs that are cancelled while what their run before left cannot be stored."""

import threading
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.schemas.wire.errors import StorageUnavailableError
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.outputs.run_outputs import RunOutputs

Order = Callable[..., dict[str, Any]]
RUN = "2026-01-02T03-04-05-000000Z"


class Away:
    """A store that does not answer, until it does."""

    def __init__(self, service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked = 0
        self._put_files = service.store.put_files
        self._monkeypatch, self._store = monkeypatch, service.store
        monkeypatch.setattr(service.store, "put_files", self._refuse)

    def _refuse(self, *arguments: object, **options: object) -> None:
        self.asked += 1
        raise StorageUnavailableError("503 Slow Down")

    def come_back(self) -> None:
        self._monkeypatch.setattr(self._store, "put_files", self._put_files)


def has_left(status: str, arn: str, service: Service) -> bool:
    return service.catalog.get(arn).status != status


def cancelled(arn: str, service: Service, away: Away, status: str) -> Mapping[str, Any]:
    """Cancels a job that is performed and whose outputs cannot be stored; returns how it ended once they can be."""
    wait_for(lambda: away.asked, "the store to be asked")
    assert not has_left(status, arn, service)
    call("CancelSimulationJob", {"job": arn}, service)
    wait_for(partial(has_left, status, arn, service), "the cancellation to be heard")
    away.come_back()
    wait_for(lambda: service.catalog.get(arn).status == "Canceled", "the outputs to be stored")
    return service.catalog.get(arn).document


@pytest.fixture
def left_by_a_dead_worker(service: Service, order: Order) -> str:
    arn = call("CreateSimulationJob", order(), service)["arn"]
    service.catalog.transition(arn, "prepare", document_changes={"runId": RUN})
    service.catalog.transition(arn, "start", document_changes={"lastStartedAt": "2026-01-02T03:04:05+00:00"})
    output = service.folder("jobs", arn.rpartition("/")[2], RUN, "output")
    (output / "map.pgm").write_text("a map")
    return arn


def test_a_job_whose_dead_run_cannot_be_stored_hears_that_it_is_cancelled(
    service: Service, left_by_a_dead_worker: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    arn = left_by_a_dead_worker
    away = Away(service, monkeypatch)
    worker = threading.Thread(target=perform_job, args=(arn, service), daemon=True)
    worker.start()

    document = cancelled(arn, service, away, "Running")

    worker.join(120)
    assert "earlierRuns" not in document  # it is the job's last run after all
    place = document["outputs"]
    assert service.store.get_bytes(place["bucket"], f"{place['prefix']}/map.pgm") == b"a map"
    assert not list((service.settings.home / "jobs").iterdir())


def test_a_job_that_is_restarted_hears_that_it_is_cancelled(
    service: Service, order: Order, monkeypatch: pytest.MonkeyPatch
) -> None:
    arn = call("CreateSimulationJob", order({"DURATION_S": "200"}), service)["arn"]
    worker = threading.Thread(target=perform_job, args=(arn, service), daemon=True)
    worker.start()
    wait_for(lambda: service.catalog.get(arn).status == "Running", "the run to begin")
    away = Away(service, monkeypatch)
    call("RestartSimulationJob", {"job": arn}, service)

    document = cancelled(arn, service, away, "Restarting")

    worker.join(120)
    assert "earlierRuns" not in document
    place = document["outputs"]
    assert place["prefix"].endswith(document["runId"])
    assert service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/stdout.log") is not None


def test_a_pause_ends_when_it_is_to_stop(
    service: Service, left_by_a_dead_worker: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    Away(service, monkeypatch)
    job = service.catalog.get(left_by_a_dead_worker)
    folder = Path(service.settings.home / "jobs" / job.id / RUN)
    pauses: list[float] = []
    outputs = RunOutputs(job, RUN, folder, service, sleep=pauses.append)

    with pytest.raises(StorageUnavailableError):
        outputs.store({}, finished=False, stopped=lambda: sum(pauses) > 15)

    # In the midst of the fifth, which would be sixteen seconds long.
    assert 15 < sum(pauses) < 16
    assert max(pauses) <= 0.5
