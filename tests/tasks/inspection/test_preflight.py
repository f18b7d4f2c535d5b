import errno
import json
import socket
import threading
from contextlib import nullcontext
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.reports.forecast import Forecast, Places
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import (
    SpecError,
    StorageAccessDeniedError,
    StorageError,
)
from prefect_robomaker.tasks.backends.backend import BackendError, open_backend
from prefect_robomaker.tasks.inspection.forecasting import keep_forecast
from prefect_robomaker.tasks.inspection.preflight import await_store, check_disk, check_preconditions, check_templates
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service, Timing
from prefect_robomaker.tasks.storage.directory import DirectoryStore

SUITE = {"name": "General"}


def spec(robot: str, *, location: Any = None, **steps: Any) -> Any:
    request = {
        **({"outputLocation": location} if location else {}),
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "robotApplications": [{"application": robot, "launchConfig": {}}],
    }
    drive = {"operation": "CreateSimulationJob", "input": request}
    return load_spec(json.dumps({"version": 1, "name": "check", "steps": {"drive": drive, **steps}}), "check.yaml")


def test_a_misspelt_application_is_found_before_anything_runs(service: Service) -> None:
    with pytest.raises(SpecError, match=r"robotApplications\[0\]\.application.*'scot'.*'scout'"):
        check_preconditions(spec("scot"), service)

    check_preconditions(spec("scout"), service)


def test_an_application_that_a_step_makes_counts_as_existing(service: Service) -> None:
    uri = {"uri": "python://my_robot"}
    make = {
        "operation": "CreateRobotApplication",
        "input": {"name": "mine", "environment": uri, "robotSoftwareSuite": SUITE},
    }

    check_preconditions(spec("mine", make=make), service)


def test_an_application_is_no_world_template(service: Service) -> None:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    scout = next(iter(service.catalog.list("robot-application").resources)).arn
    made = call("CreateWorldTemplate", {"templateBody": "{}"}, service)["arn"]

    def steps(template: str) -> Any:
        return spec("scout", worlds={
            "operation": "CreateWorldGenerationJob", "input": {"template": template, "worldCount": count}
        })  # fmt: skip

    check_templates(steps(made), service)
    with pytest.raises(SpecError, match=r"steps\.worlds\.input\.template.*there is no world template"):
        check_templates(steps(scout), service)


def test_an_object_store_that_cannot_be_used_is_found_before_anything_runs(settings: Settings, tmp_path: Path) -> None:
    (tmp_path / "store").write_text("a file where a folder should be")
    values = {"ROBOMAKER_HOME": str(settings.home), "ROBOMAKER_OBJECT_STORE": str(tmp_path / "store")}

    with pytest.raises(StorageError):
        check_preconditions(spec("scout"), Service.open(Settings.from_environment(values), {}))


@pytest.mark.parametrize("location", [None, {"s3Bucket": "results", "s3Prefix": "nightly"}])
def test_a_store_that_cannot_be_written_to_is_found_before_anything_runs(
    service: Service, location: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = DirectoryStore._written

    def read_only(store: DirectoryStore, bucket: str, *arguments: Any) -> Any:
        if bucket == (location or {}).get("s3Bucket", service.settings.bucket):
            raise OSError(errno.EROFS, "Read-only file system", "/store")
        return written(store, bucket, *arguments)

    monkeypatch.setattr(DirectoryStore, "_written", read_only)
    wanted = spec("scout", location=location)
    with pytest.raises(SpecError if location else StorageAccessDeniedError, match="Read-only file system") as refused:
        check_preconditions(wanted, service)
    if location:
        assert "steps.drive.input.outputLocation.s3Bucket" in str(refused.value)


def test_nothing_is_left_in_the_store_of_what_was_tried(service: Service) -> None:
    check_preconditions(spec("scout", location={"s3Bucket": "results"}), service)

    root = service.store.local_path("results", "any").parents[1]  # type: ignore[union-attr]
    assert [path for path in root.rglob("*") if path.is_file()] == []


def test_outputs_that_do_not_fit_on_the_disk_by_the_forecast_are_found_before_anything_runs(service: Service) -> None:
    wanted = spec("scout")
    check_disk(wanted, service)
    for size_bytes, fits in ((10**6, True), (10**18, False)):
        forecast = Forecast(
            name="check", made_at=datetime(2026, 3, 1, tzinfo=UTC), backend="local",
            places=Places(machines=1, jobs_per_machine=2, cpus=2), steps=[], wall_time_s=1.0, size_bytes=size_bytes,
            assumed=[], probes=[],
        )  # fmt: skip
        keep_forecast(forecast, wanted, service.settings)
        with nullcontext() if fits else pytest.raises(StorageError, match=r"1000000000\.0 GB by the forecast of 2026"):
            check_disk(wanted, service)


@pytest.mark.parametrize("kind", ["dask", "ray"])
def test_a_cluster_that_is_not_there_is_found_before_anything_runs(service: Service, kind: str) -> None:
    with pytest.raises(BackendError, match=r"127\.0\.0\.1:1 does not answer .*check the address"):
        check_preconditions(spec("scout"), replace(service, backend=open_backend(f"{kind}:127.0.0.1:1")))


def test_a_work_pool_that_is_not_there_is_found_before_anything_runs(service: Service, prefect_server: str) -> None:
    with pytest.raises(BackendError, match="has no work pool 'nowhere'"):
        check_preconditions(spec("scout"), replace(service, backend=open_backend("workers:nowhere")))


@pytest.fixture
def notes() -> list[str]:
    """What a person who watches is told."""
    return []


def on_s3(settings: Settings, endpoint: str) -> Service:
    values = {"ROBOMAKER_HOME": str(settings.home), "ROBOMAKER_OBJECT_STORE": endpoint}
    keys = {"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret"}
    return Service.open(Settings.from_environment(values), keys)


def test_a_store_whose_host_does_not_exist_is_not_waited_for(
    settings: Settings, notes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_such_host(*_: object, **__: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    service = replace(on_s3(settings, "http://sotre.example:8333"), timing=Timing(store_patience_s=0.0))
    monkeypatch.setattr(socket, "getaddrinfo", no_such_host)
    with pytest.raises(StorageError, match=r"sotre\.example.*: there is no such host; check ROBOMAKER_OBJECT_STORE"):
        await_store(service, notes.append)
    assert notes == []


def test_a_store_that_answers_later_is_waited_for_and_that_is_said_at_once(
    settings: Settings, notes: list[str]
) -> None:
    requests: list[bytes] = []
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        port = listener.getsockname()[1]
        service = on_s3(settings, f"http://127.0.0.1:{port}")

        def note(text: str) -> None:
            notes.append(text)
            if len(notes) == 1:
                listener.listen()
                threading.Thread(target=_refuse, args=(listener, requests), daemon=True).start()

        await_store(service, note)

    assert notes[0].startswith(
        "the object store does not answer; the run waits for it, at most 30 min (ROBOMAKER_STORE_PATIENCE_MIN); Ctrl-C "
        f"ends the wait: cannot look for the bucket robomaker at http://127.0.0.1:{port}: Could not connect"
    )
    assert notes[1:] == ["the object store answers"]
    [request] = requests
    assert request.startswith(b"HEAD /robomaker")


def _refuse(listener: socket.socket, requests: list[bytes]) -> None:
    """Answers one request as a server does that does not know the keys: an answer all the same."""
    client, _ = listener.accept()
    with client:
        requests.append(client.recv(65536))
        client.sendall(b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
