"""Runs that could not be started: what they left is stored, and never looks like a run that came to its end."""

import socket
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError, StorageFullError
from prefect_robomaker.tasks.service.service import Service, Timing
from prefect_robomaker.tasks.storage import read_manifest

Simulate = Callable[..., dict[str, Any]]


@pytest.fixture
def unstartable(swing: Simulate) -> Iterator[Simulate]:
    """Orders a job with a note in its log, about a screen that cannot be shown, and a port that is taken."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        ports = {"portMappings": [{"jobPort": taken.getsockname()[1], "applicationPort": 4000}]}

        def run(**members: Any) -> dict[str, Any]:
            launch = {"command": ["true"], "streamUI": True, "portForwardingConfig": ports}
            program = {"launchConfig": {"command": ["true"]}}
            return swing(simulation=program, robot={"launchConfig": launch}, **members)

        yield run


def test_what_a_run_that_could_not_be_started_left_is_stored_without_a_manifest(
    service: Service, unstartable: Simulate
) -> None:
    job = unstartable()

    assert job["status"] == "Failed"
    assert "port" in job["failureReason"]
    place = service.catalog.get(job["arn"]).document["outputs"]
    log = service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/stderr.log")
    assert b"streamUI: the screen of a program cannot be shown here" in log
    with pytest.raises(ObjectNotFoundError):
        read_manifest(service.store, **place)
    assert not (service.settings.home / "jobs" / job["name"]).exists()


@pytest.mark.parametrize("timing", [Timing(store_patience_s=0.0)], ids=["without patience"])
def test_its_reason_is_kept_where_that_cannot_be_stored(
    service: Service, unstartable: Simulate, monkeypatch: pytest.MonkeyPatch
) -> None:
    def put_files(*arguments: object, **options: object) -> None:
        raise StorageFullError("no space left")

    monkeypatch.setattr(service.store, "put_files", put_files)
    job = unstartable()

    assert job["failureCode"] == "InvalidInput", "of why it could not be started"
    assert "no space left" in job["failureReason"]
    assert "port" in job["failureReason"]
    [run] = (service.settings.home / "jobs" / job["name"]).iterdir()
    assert str(run / "output") in job["failureReason"]
    assert (run / "output" / "logs" / "stderr.log").exists()
