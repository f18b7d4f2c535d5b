"""Outputs of simulation jobs: kept when they cannot be stored, found when a job worker died, cleaned up after."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import (
    BucketNotFoundError,
    ServiceUnavailableException,
    StorageFullError,
    StorageUnavailableError,
)
from prefect_robomaker.tasks.files.untrusted_folders import regular_files
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service, Timing
from prefect_robomaker.tasks.simulations.outputs.run_outputs import RunOutputs
from prefect_robomaker.tasks.storage import publish, read_manifest

Order = Callable[..., dict[str, Any]]
Simulate = Callable[[dict[str, Any]], dict[str, Any]]
RUN = "2026-01-02T03-04-05-000000Z"


def runs_of(service: Service, job: dict[str, Any]) -> Path:
    return service.settings.home / "jobs" / job["name"]


def refuse(service: Service, monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def put_files(*arguments: object, **options: object) -> None:
        raise error

    monkeypatch.setattr(service.store, "put_files", put_files)


@pytest.fixture
def died_publishing(service: Service, order: Order, prefect_server: str) -> dict[str, Any]:
    """A job that ran on this machine to its end, and whose job worker died before the outputs were stored."""
    job = call("CreateSimulationJob", order(seed=3), service)
    service.catalog.transition(job["arn"], "prepare", document_changes={"runId": RUN})
    service.catalog.transition(job["arn"], "start")
    ending = {"status": "Completed", "simulationTimeMillis": 1200}
    service.catalog.transition(job["arn"], "terminate", document_changes={"ending": ending, "finished": True})
    output = service.folder("jobs", job["arn"].rsplit("/", 1)[1], RUN, "output")
    (output / "result.json").write_text("{}")
    return call("DescribeSimulationJob", {"job": job["arn"]}, service)


def perform(service: Service, job: dict[str, Any]) -> dict[str, Any]:
    return registry()["CreateSimulationJob"].perform(job["arn"], service)


def place_of(service: Service, job: dict[str, Any]) -> dict[str, str]:
    return service.catalog.get(job["arn"]).document["outputs"]


def test_nothing_is_left_on_the_machine_of_a_job_whose_outputs_are_stored(
    service: Service, order: Order, prefect_server: str
) -> None:
    job = call("CreateSimulationJob", order(), service)
    name = job["arn"].rsplit("/", 1)[1]
    dead_workers = service.folder("jobs", name, RUN, "output")
    (dead_workers / "half.mcap").touch()

    assert perform(service, job)["status"] == "Completed"
    assert list((service.settings.home / "jobs").iterdir()) == []


def test_nothing_is_left_of_a_job_that_could_not_be_prepared(
    service: Service, order: Order, simulate: Simulate
) -> None:
    request = order()
    service.store.put_bytes("applications", "sleeper.tar.gz", b"something else")

    assert simulate(request)["failureCode"] == "InvalidBundleSimulationApplication"
    assert list((service.settings.home / "jobs").iterdir()) == []


@pytest.mark.parametrize("timing", [Timing(store_patience_s=0.0)], ids=["without patience"])
@pytest.mark.parametrize(
    ("error", "code"),
    [
        (StorageFullError("no space left"), "InternalServiceError"),
        (BucketNotFoundError("there is no bucket"), "BadPermissionsS3Output"),
    ],
)
def test_outputs_that_cannot_be_stored_stay_and_the_reason_says_where(
    service: Service,
    order: Order,
    simulate: Simulate,
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
    code: str,
) -> None:
    request = order()
    refuse(service, monkeypatch, error)

    job = simulate(request)

    assert (job["status"], job["failureCode"]) == ("Failed", code)
    [run] = runs_of(service, job).iterdir()
    assert [path.name for path in run.iterdir()] == ["output"]
    assert str(error) in job["failureReason"]
    assert str(run / "output") in job["failureReason"]
    assert (run / "output" / "result.json").exists()


@pytest.mark.parametrize("timing", [Timing(store_patience_s=0.0)], ids=["without patience"])
def test_a_crash_whose_outputs_cannot_be_stored_keeps_its_code_and_its_log(
    service: Service, order: Order, simulate: Simulate, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = order({"FAIL_AT_STEP": "3"})
    refuse(service, monkeypatch, StorageFullError("no space left"))

    job = simulate(request)

    assert job["failureCode"] == "SimulationApplicationCrash"
    assert "no space left" in job["failureReason"]
    assert "the simulated floor gave way" in job["failureReason"]


def test_outputs_of_a_worker_that_died_are_published_by_the_next(
    service: Service, died_publishing: dict[str, Any]
) -> None:
    job = perform(service, died_publishing)

    assert job["status"] == "Completed"
    assert job["simulationTimeMillis"] == 1200
    manifest = read_manifest(service.store, **place_of(service, job))
    assert [file.path for file in manifest.files] == ["result.json"]
    assert not runs_of(service, job).exists()


def test_uploads_that_a_dead_worker_had_taken_are_published_too(
    service: Service, died_publishing: dict[str, Any]
) -> None:
    folder = runs_of(service, died_publishing) / RUN
    taken = folder / "rolling" / "00000003" / "bags" / "b.bag"
    taken.parent.mkdir(parents=True)
    taken.write_text("taken")
    rolled = {"path": "bags/a.bag", "size_bytes": 6, "sha256": hashlib.sha256(b"stored").hexdigest()}
    (folder / "rolled.jsonl").write_text(json.dumps(rolled) + '\n{"path": "half a li')
    service.store.ensure_bucket("robomaker")
    service.store.put_bytes("robomaker", f"simulation-jobs/{died_publishing['name']}/{RUN}/bags/a.bag", b"stored")

    place = place_of(service, perform(service, died_publishing))

    manifest = read_manifest(service.store, **place)
    assert [file.path for file in manifest.files] == ["bags/a.bag", "bags/b.bag", "result.json"]
    assert service.store.get_bytes("robomaker", f"{place['prefix']}/bags/b.bag") == b"taken"


def test_what_was_rolled_is_no_longer_listed_once_an_output_has_its_name_and_that_is_told(
    service: Service, died_publishing: dict[str, Any]
) -> None:
    folder = runs_of(service, died_publishing) / RUN
    rolled = {"path": "result.json", "size_bytes": 6, "sha256": hashlib.sha256(b"stored").hexdigest()}
    (folder / "rolled.jsonl").write_text(json.dumps(rolled) + "\n")

    place = place_of(service, perform(service, died_publishing))

    note, file = read_manifest(service.store, **place).files
    assert service.store.get_bytes(place["bucket"], f"{place['prefix']}/{note.path}") == (
        b"result.json of an upload was replaced by the run's own output\n"
    )
    assert (
        file.sha256
        == hashlib.sha256(service.store.get_bytes(place["bucket"], f"{place['prefix']}/result.json")).hexdigest()
    )


def test_a_file_that_was_taken_where_a_folder_was_later_is_kept_apart(
    service: Service, died_publishing: dict[str, Any]
) -> None:
    folder = runs_of(service, died_publishing) / RUN
    for name in ("00000001/bags/day", "00000002/bags/day/a.bag"):
        (folder / "rolling" / name).parent.mkdir(parents=True)
        (folder / "rolling" / name).write_text(name)

    job = perform(service, died_publishing)

    assert job["status"] == "Completed", job.get("failureReason")
    place = place_of(service, job)
    assert [file.path for file in read_manifest(service.store, **place).files] == [
        "bags.1/day/a.bag",
        "bags/day",
        "logs/uploads.log",
        "result.json",
    ]
    assert b"bags/day/a.bag is stored as bags.1/day/a.bag, since another file has its name" in service.store.get_bytes(
        place["bucket"], f"{place['prefix']}/logs/uploads.log"
    )


def test_outputs_that_were_stored_just_in_time_are_found_from_another_machine(
    service: Service, died_publishing: dict[str, Any]
) -> None:
    output = runs_of(service, died_publishing) / RUN / "output"
    prefix = f"simulation-jobs/{died_publishing['name']}/{RUN}"
    service.store.ensure_bucket("robomaker")
    publish(service.store, "robomaker", prefix, regular_files(output), about={}, created_at=service.clock())
    runs_of(service, died_publishing).rename(service.folder("elsewhere") / "job")

    job = perform(service, died_publishing)

    assert job["status"] == "Completed"
    assert place_of(service, job) == {"bucket": "robomaker", "prefix": prefix}


def test_a_store_that_does_not_answer_for_a_moment_loses_no_outputs(
    service: Service, died_publishing: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    output = runs_of(service, died_publishing) / RUN / "output"
    service.store.ensure_bucket("robomaker")
    prefix = f"simulation-jobs/{died_publishing['name']}/{RUN}"
    publish(service.store, "robomaker", prefix, regular_files(output), about={}, created_at=service.clock())
    get_bytes, refusals = service.store.get_bytes, iter([StorageUnavailableError("503 Slow Down")])

    def at_first_not(*arguments: Any) -> bytes:
        for refusal in refusals:
            raise refusal
        return get_bytes(*arguments)

    monkeypatch.setattr(service.store, "get_bytes", at_first_not)
    pauses: list[float] = []
    job = service.catalog.get(died_publishing["arn"])

    RunOutputs(job, RUN, output.parent, service, sleep=pauses.append).were_stored()

    assert sum(pauses) == 1.0


def test_a_job_whose_outputs_were_lost_with_their_machine_runs_again(
    service: Service, died_publishing: dict[str, Any]
) -> None:
    runs_of(service, died_publishing).rename(service.folder("elsewhere") / "job")

    job = perform(service, died_publishing)

    assert (job["status"], job.get("failureCode")) == ("Completed", None)
    assert read_manifest(service.store, **place_of(service, job)).files
    [lost] = service.catalog.get(job["arn"]).document["earlierRuns"]
    assert (lost["runId"], lost["status"]) == (RUN, "Failed")
    assert "died before its outputs were stored" in lost["notStored"]


def test_a_job_that_failed_and_whose_outputs_are_lost_does_not_run_again(
    service: Service, died_publishing: dict[str, Any]
) -> None:
    crash = {"status": "Failed", "failureCode": "SimulationApplicationCrash", "failureReason": "the floor gave way"}
    service.catalog.update(died_publishing["arn"], lambda document: {**document, "ending": crash})
    runs_of(service, died_publishing).rename(service.folder("elsewhere") / "job")

    job = perform(service, died_publishing)

    assert (job["status"], job["failureCode"]) == ("Failed", "SimulationApplicationCrash")
    assert "died before its outputs were stored" in job["failureReason"]
    assert "the floor gave way" in job["failureReason"]


def test_a_cancelled_job_whose_outputs_are_lost_does_not_run_again(
    service: Service, died_publishing: dict[str, Any]
) -> None:
    runs_of(service, died_publishing).rename(service.folder("elsewhere") / "job")
    call("CancelSimulationJob", {"job": died_publishing["arn"]}, service)

    assert "earlierRuns" not in service.catalog.get(perform(service, died_publishing)["arn"]).document


@pytest.mark.parametrize(
    "event", ["finish", *(pytest.param(event, marks=pytest.mark.deep) for event in ("prepare", "start", "complete"))]
)
@pytest.mark.parametrize("timing", [Timing(after_kill_s=0.01)], ids=["soon again"])
def test_a_catalog_that_is_away_as_a_job_moves_on_fails_no_job(
    service: Service, order: Order, simulate: Simulate, monkeypatch: pytest.MonkeyPatch, event: str
) -> None:
    request = order()
    transition, get = service.catalog.transition, service.catalog.get
    refusals = iter([ServiceUnavailableException("the database starts again")])
    still_away = iter([ServiceUnavailableException("the database starts again")])

    def at_first_not(arn: str, happened: str, **options: Any) -> Any:
        if happened == event:
            for refusal in refusals:
                monkeypatch.setattr(service.catalog, "get", later)
                raise refusal
        return transition(arn, happened, **options)

    def later(*arguments: Any, **options: Any) -> Any:
        for refusal in still_away:
            raise refusal
        return get(*arguments, **options)

    monkeypatch.setattr(service.catalog, "transition", at_first_not)

    job = simulate(request)

    assert (job["status"], job.get("failureCode")) == ("Completed", None)
    assert next(refusals, None) is None


def test_a_catalog_that_is_away_for_a_moment_ends_no_run(
    service: Service, order: Order, simulate: Simulate, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = order({"DURATION_S": "0.8"})
    asked = []
    standing = service.catalog.standing

    def sometimes(arn: str) -> tuple[str, bool]:
        asked.append(arn)
        if len(asked) in (3, 4):
            raise ServiceUnavailableException("the database starts again")
        return standing(arn)

    monkeypatch.setattr(service.catalog, "standing", sometimes)

    assert simulate(request)["status"] == "Completed"
    assert len(asked) > 4
