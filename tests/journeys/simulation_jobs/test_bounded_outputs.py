"""Outputs without end: a run that leaves them holds no machine, and cancelling ends its upload."""

import itertools
import json
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.runs.programs import StopReason
from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError, TransferStoppedError
from prefect_robomaker.tasks.execution.leases.leased_runs import run_under_lease
from prefect_robomaker.tasks.jobs.batch_runs import BatchRun
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service, Timing
from prefect_robomaker.tasks.simulations.outputs import upload_cancellation
from prefect_robomaker.tasks.simulations.outputs.run_outputs import RunOutputs
from prefect_robomaker.tasks.simulations.outputs.upload_cancellation import UploadEnd
from prefect_robomaker.tasks.storage import read_manifest

Order = Callable[..., dict[str, Any]]

SPARSE = """
import os
with open(os.path.join(os.environ["ROBOMAKER_OUTPUT_DIR"], "huge.bin"), "wb") as file:
    file.truncate(1 << 38)
"""
MANY = """
import os, pathlib
folder = pathlib.Path(os.environ["ROBOMAKER_OUTPUT_DIR"], "many")
folder.mkdir()
for number in range({count}):
    (folder / str(number)).touch()
"""
NEAR_GB = """
import os
with open(os.path.join(os.environ["ROBOMAKER_OUTPUT_DIR"], "large.bin"), "wb") as file:
    file.truncate(1 << 36)
"""


def limited(service: Service, **limits: int) -> Service:
    return replace(service, settings=service.settings.model_copy(update=limits))


def manifest_of(service: Service, arn: str) -> tuple[dict[str, Any], set[str], SimulationJobDocument]:
    document = SimulationJobDocument.of(service.catalog.get(arn))
    assert document.outputs is not None
    manifest = read_manifest(service.store, document.outputs.bucket, document.outputs.prefix)
    return dict(manifest.about), {file.path for file in manifest.files}, document


def test_what_is_beyond_the_limits_is_named_in_the_manifest_and_beside_the_verdict(
    service: Service, order: Order
) -> None:
    request = order({"DO": SPARSE + MANY.format(count=500), "VERDICT": "PASS"})
    arn = call("CreateSimulationJob", request, service)["arn"]

    perform_job(arn, limited(service, max_output_files=100))

    about, names, document = manifest_of(service, arn)
    assert (document.verdict, document.failure_code) == ("PASS", None)
    assert {"result.json", "logs/stdout.log", "logs/uploads.log"} <= names
    assert len(names) <= 101, "uploads.log comes besides"
    left = about["leftOut"]
    assert left["sizeBytes"] == 1 << 38
    assert left["files"] == left["beyondLimits"]
    assert "huge.bin" in {each["path"] for each in left["named"]}
    place = document.outputs
    assert place is not None
    result = json.loads(service.store.get_bytes(place.bucket, f"{place.prefix}/result.json"))
    assert any("outputs are not stored" in note for note in result["notes"])


@pytest.mark.parametrize("timing", [Timing(upload_every_s=0.1)], ids=["often"])
def test_files_that_are_uploaded_while_a_job_runs_are_bounded_too(service: Service, order: Order) -> None:
    write = """
import os, pathlib
folder = pathlib.Path(os.environ["HOME"], "bags")
folder.mkdir()
for number in range(50):
    (folder / f"{number:02}").touch()
"""
    request = order({"DO": write, "DURATION_S": "1"}, outputLocation={"s3Bucket": "results", "s3Prefix": "nightly"})
    request["simulationApplications"][0]["uploadConfigurations"] = [
        {"name": "bags", "path": "/home/robomaker/bags/*", "uploadBehavior": "UPLOAD_ROLLING_AUTO_REMOVE"}
    ]
    arn = call("CreateSimulationJob", request, service)["arn"]

    perform_job(arn, limited(service, max_output_files=20))

    about, names, _ = manifest_of(service, arn)
    bags = {name for name in names if name.startswith("bags/")}
    assert len(bags) <= 20
    assert about["leftOut"]["files"] >= 30, "own outputs that found no room are among them"


@pytest.mark.parametrize("again", [False, True], ids=["after it ended", "again, after it was cancelled as it ran"])
def test_cancelling_ends_an_upload_at_once(service: Service, order: Order, again: bool) -> None:
    """A file of 64 GB without blocks is within the limits, and takes a minute to go through at least."""
    duration_s = "1000" if again else "0.1"
    request = order({"DO": NEAR_GB + MANY.format(count=10), "DURATION_S": duration_s})
    arn = call("CreateSimulationJob", request, service)["arn"]
    worker = threading.Thread(target=perform_job, args=(arn, service), daemon=True)
    worker.start()

    def status() -> str:
        return service.catalog.get(arn).status

    if again:
        wait_for(lambda: any(service.settings.home.glob("jobs/*/*/output/many/9")), "the files")
        call("CancelSimulationJob", {"job": arn}, service)
    wait_for(lambda: status() == "Terminating", "the upload to begin")
    time.sleep(1.0)
    assert status() == "Terminating", "it is under way"
    asked_s = time.process_time()

    call("CancelSimulationJob", {"job": arn}, service)

    worker.join(200)
    assert status() == "Canceled"
    assert time.process_time() - asked_s < 5.0, "it did not go through the file"
    about, names, document = manifest_of(service, arn)
    assert about["partial"] is True
    assert about["leftOut"]["named"], "what is missing is named"
    assert "large.bin" not in names
    assert "result.json" in names
    assert "storing outputs was cancelled" in (document.failure_reason or "")
    assert document.failure_code is None
    assert not list((service.settings.home / "jobs").iterdir())


def test_cancelling_ends_the_upload_of_a_run_that_crashed(service: Service, order: Order) -> None:
    arn = call("CreateSimulationJob", order({"DO": NEAR_GB + "os._exit(3)"}), service)["arn"]
    worker = threading.Thread(target=perform_job, args=(arn, service), daemon=True)
    worker.start()
    wait_for(lambda: service.catalog.get(arn).status == "Terminating", "the upload to begin")
    time.sleep(1.0)

    call("CancelSimulationJob", {"job": arn}, service)

    worker.join(200)
    document = SimulationJobDocument.of(service.catalog.get(arn))
    assert service.catalog.get(arn).status == "Failed", "one that failed stays so"
    assert document.failure_code == "SimulationApplicationCrash"
    place = document.outputs
    assert place is not None
    assert b"was cancelled" in service.store.get_bytes(place.bucket, f"{place.prefix}/logs/partial.log")
    with pytest.raises(ObjectNotFoundError):
        read_manifest(service.store, place.bucket, place.prefix)


@pytest.mark.deep
def test_a_job_that_stores_holds_no_slot_of_the_machine(
    service: Service, order: Order, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = limited(service, max_jobs=1)
    perform = registry()["CreateSimulationJob"].perform
    first = call("CreateSimulationJob", order({"DO": NEAR_GB}), service)["arn"]
    second = call("CreateSimulationJob", order(), service)["arn"]
    worker = threading.Thread(target=perform, args=(first, one), daemon=True)
    worker.start()
    wait_for(lambda: service.catalog.get(first).status == "Terminating", "the upload to begin")

    ended = perform(second, one)

    assert ended["status"] == "Completed"
    assert service.catalog.get(first).status == "Terminating"
    call("CancelSimulationJob", {"job": first}, service)
    worker.join(200)
    assert service.catalog.get(first).status == "Canceled"


@pytest.mark.parametrize("again", [False, True], ids=["after it ended", "the job, after its batch as it ran"])
def test_cancelling_a_batch_ends_the_uploads_of_its_jobs(service: Service, order: Order, again: bool) -> None:
    job = order({"DO": NEAR_GB + MANY.format(count=10), "DURATION_S": "1000" if again else "0.1", "VERDICT": "PASS"})
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [job]}, service)["arn"]
    made = lambda lease: BatchRun(lease, service).create_job(0)  # noqa: E731
    run_under_lease(batch, "simulation-job-batch", service, made)
    [arn] = [job.arn for job in service.catalog.list("simulation-job").resources]

    def why_stop() -> StopReason | None:
        return StopReason.BATCH_CANCELED if service.catalog.cancel_requested(batch) else None

    worker = threading.Thread(target=perform_job, args=(arn, service, why_stop), daemon=True)
    worker.start()
    if again:
        wait_for(lambda: any(service.settings.home.glob("jobs/*/*/output/many/9")), "the files")
        service.catalog.request_cancel(batch)
    wait_for(lambda: service.catalog.get(arn).status == "Terminating", "the upload to begin")
    time.sleep(1.0)
    assert service.catalog.get(arn).status == "Terminating", "it is under way"
    asked_s = time.process_time()

    if again:
        call("CancelSimulationJob", {"job": arn}, service)
    else:
        service.catalog.request_cancel(batch)

    worker.join(200)
    assert time.process_time() - asked_s < 5.0, "it did not go through the file"
    job = service.catalog.get(arn)
    about, names, document = manifest_of(service, job.arn)
    # A good end whose outputs are missing would be no good end.
    assert (job.status, document.verdict, document.failure_code) == ("Canceled", None, "BatchCanceled")
    assert about["partial"] is True
    assert "large.bin" not in names


@pytest.mark.parametrize("reason", [StopReason.BATCH_TIMED_OUT, StopReason.BATCH_CANCELED])
def test_uploads_go_on_when_the_batch_was_not_cancelled(
    service: Service, order: Order, reason: StopReason, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A batch whose time is over lets them finish, and one that lost its lease has another process by now."""
    job = order()
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [job]}, service)["arn"]
    reasons: list[StopReason | None] = [None]
    monkeypatch.setattr(upload_cancellation, "_ASK_EVERY_S", 0.0)
    ended = UploadEnd("none", batch, service.catalog, lambda: reasons[-1])
    reasons.append(reason)

    assert not any(ended() for _ in range(5))


def test_cancelling_is_heard_while_very_many_outputs_are_listed(service: Service, order: Order) -> None:
    """Listing 200,000 files took three quarters of a minute, and nothing heard the cancellation meanwhile."""
    arn = call("CreateSimulationJob", order(), service)["arn"]
    job = service.catalog.get(arn)
    output = service.folder("jobs", job.id, "run", "output")
    for number in range(500):
        (output / str(number)).touch()
    (output / "result.json").write_text("{}")
    outputs = RunOutputs(job, "run", output.parent, service)
    asked = itertools.count()

    with pytest.raises(TransferStoppedError):
        outputs.store({}, finished=True, ended=lambda: next(asked) > 100)

    assert next(asked) < 200, "it ended in the midst of the first list"
    place, words = outputs.conclude({}, finished=True)
    assert words is not None
    assert "while they were listed" in words
    manifest = read_manifest(service.store, place.bucket, place.prefix)
    assert manifest.about["partial"] is True
    assert [file.path for file in manifest.files] == ["result.json"]
