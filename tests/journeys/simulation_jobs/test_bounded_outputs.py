"""Outputs without end: a run that leaves them holds no machine, and cancelling ends its upload."""

import json
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.service.timing import Timing
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
