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
from prefect_robomaker.schemas.specs.yaml_nodes import plain
from prefect_robomaker.schemas.wire.errors import (
    Place,
    Problem,
    SpecError,
    StorageAccessDeniedError,
    StorageError,
)
from prefect_robomaker.tasks.backends.backend import BackendError, open_backend
from prefect_robomaker.tasks.inspection.forecasting import keep_forecast
from prefect_robomaker.tasks.inspection.pipeline_parts import refusal_in_words
from prefect_robomaker.tasks.inspection.preflight import (
    await_store,
    check_disk,
    check_preconditions,
    check_templates,
    with_all_found,
)
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service, Timing
from prefect_robomaker.tasks.storage.directory import DirectoryStore

SUITE = {"name": "General"}
WORLD = "arn:aws:robomaker:us-east-1:000000000000:world/import-1/world-1"


def spec(robot: str, *, location: Any = None, **steps: Any) -> Any:
    request = {
        **({"outputLocation": location} if location else {}),
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "robotApplications": [{"application": robot, "launchConfig": {}}],
        "simulationApplications": [
            {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": WORLD}]}
        ],
    }
    drive = {"operation": "CreateSimulationJob", "input": request}
    return load_spec(json.dumps({"version": 1, "name": "check", "steps": {"drive": drive, **steps}}), "check.yaml")


def test_a_misspelt_application_is_found_before_anything_runs(service: Service) -> None:
    with pytest.raises(SpecError, match=r"robotApplications\[0\]\.application.*'scot'.*'scout'"):
        check_preconditions(spec("scot"), service)

    check_preconditions(spec("scout"), service)


def test_all_applications_and_worlds_that_do_not_exist_are_named_at_once(service: Service) -> None:
    request = {
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "robotApplications": [{"application": "my-robot", "launchConfig": {}}],
        "simulationApplications": [
            {"application": "my-yard", "launchConfig": {}, "worldConfigs": [{"world": "gone"}]}
        ],
    }  # fmt: skip
    drive = {"operation": "CreateSimulationJob", "input": request}
    checked = load_spec(json.dumps({"version": 1, "name": "check", "steps": {"drive": drive}}, indent=1), "check.yaml")

    with pytest.raises(SpecError) as refused:
        with_all_found(checked, service)

    told = [each.message for each in refused.value.problems]
    assert [each[: each.index("' ") + 1 if "' " in each else None] for each in told] == [
        "there is no robot application 'my-robot'", "there is no simulation application 'my-yard'", "'gone'",
    ]  # fmt: skip
    words = refusal_in_words(refused.value)
    assert words.startswith("there is no robot application 'my-robot'")
    assert "(check.yaml:12:22); there is no simulation application 'my-yard'" in words
    assert "\n" not in words


def test_a_reason_that_does_not_name_its_object_keeps_the_path() -> None:
    problem = Problem(Place("night.yaml", 3, 5), "parameters.height", "is not known")
    assert refusal_in_words(SpecError([problem, problem])) == "parameters.height: is not known (night.yaml:3:5)"


def test_an_application_that_a_step_makes_counts_as_existing(service: Service) -> None:
    uri = {"uri": "python://my_robot"}
    make = {
        "operation": "CreateRobotApplication",
        "input": {"name": "mine", "environment": uri, "robotSoftwareSuite": SUITE},
    }

    check_preconditions(spec("mine", make=make), service)


ARCHIVE = {"s3Bucket": "robomaker", "s3Key": "applications/mine.tar.gz"}
MAKE = {
    "operation": "CreateRobotApplication",
    "input": {"name": "mine", "sources": [ARCHIVE], "robotSoftwareSuite": SUITE},
}


def test_an_archive_that_is_not_in_the_store_is_found_before_anything_runs(service: Service) -> None:
    service.store.ensure_bucket("robomaker")
    service.store.put_bytes("robomaker", "applications/mine.tar.gz.old", b"its name begins so")

    with pytest.raises(SpecError) as refused:
        check_preconditions(spec("mine", make=MAKE), service)

    (problem,) = refused.value.problems
    assert problem.path == "steps.make.input.sources[0].s3Key"
    assert refusal_in_words(refused.value).startswith(
        "there is no object 's3://robomaker/applications/mine.tar.gz' in the object store (check.yaml:1:"
    )

    service.store.put_bytes("robomaker", "applications/mine.tar.gz", b"packed")
    check_preconditions(spec("mine", make=MAKE), service)


def test_data_below_a_place_that_a_step_writes_to_may_come_later(service: Service) -> None:
    service.store.ensure_bucket("maps")
    data = {"name": "maps", "s3Bucket": "maps", "s3Keys": ["nightly/"]}

    def wanted(prefix: str) -> Any:
        made = spec("scout", location={"s3Bucket": "maps", "s3Prefix": prefix})
        request = {**plain(made.steps["drive"].input), "dataSources": [data]}
        read = {"operation": "CreateSimulationJob", "input": request}
        return load_spec(json.dumps({"version": 1, "name": "check", "steps": {"read": read}}), "check.yaml")

    check_preconditions(wanted("nightly"), service)
    with pytest.raises(SpecError, match=r"dataSources\[0\]\.s3Keys\[0\].*there is no object 's3://maps/nightly/'"):
        check_preconditions(wanted("weekly"), service)
    service.store.put_bytes("maps", "nightly/flat.yaml", b"a map")
    check_preconditions(wanted("weekly"), service)


def test_an_object_that_may_not_be_read_is_left_to_the_step(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """A job may have a role that may read it."""

    def head(*_: object) -> Any:
        raise StorageAccessDeniedError("cannot read robomaker/applications/mine.tar.gz: 403")

    monkeypatch.setattr(DirectoryStore, "head", head)
    check_preconditions(spec("mine", make=MAKE), service)


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
