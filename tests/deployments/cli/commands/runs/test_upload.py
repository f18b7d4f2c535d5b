"""upload --kept: what it lists, stores and says, and who points to it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.documents.simulation_jobs import Outcome, SimulationJobProgress
from prefect_robomaker.schemas.reports.retention import KeptReport
from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import read_manifest

Order = Callable[..., dict[str, Any]]
RUN = "2026-01-02T03-04-05-000000Z"
FULL = "outputs could not be stored in s3://robomaker/x: no space left"


@pytest.fixture
def keep(service: Service, order: Order) -> Callable[[], str]:
    """Makes a job that ran and passed, and whose outputs could not be stored; its ARN."""

    def make() -> str:
        arn = call("CreateSimulationJob", order(seed=3), service)["arn"]
        catalog, outcome = service.catalog, Outcome(status="Completed", simulation_time_millis=1200, verdict="PASS")
        catalog.transition(arn, "prepare", document_changes=SimulationJobProgress(run_id=RUN))
        catalog.transition(arn, "start")
        catalog.transition(arn, "finish", document_changes=outcome.announced(finished=True))
        failed = Outcome(status="Failed", failure_code="InternalServiceError", failure_reason=FULL)
        catalog.transition(arn, "fail", document_changes=failed.changes())
        output = service.folder("jobs", arn.rpartition("/")[2], RUN, "output")
        (output / "result.json").write_text("{}")
        (output / "map.pgm").write_text("a map")
        return arn

    return make


def test_without_anything_kept_it_says_so(robomaker: Any) -> None:
    told = robomaker("upload", "--kept")

    assert (told.code, told.out) == (
        0,
        "No outputs are kept: all that ran is stored, or was never written on this machine.\n",
    )


def test_a_dry_run_lists_and_stores_nothing(robomaker: Any, keep: Callable[[], str], service: Service) -> None:
    arn = keep()

    told = robomaker("upload", "--kept", "--dry-run")

    assert told.code == 0, told.err
    assert f"{arn.rpartition('/')[2]}  {RUN}  2 files, 7 bytes  kept in {service.settings.home}" in told.out
    assert "outputs" not in service.catalog.get(arn).document


def test_it_stores_all_that_is_kept_and_says_so_in_the_jobs(
    robomaker: Any, keep: Callable[[], str], service: Service
) -> None:
    arns = [keep(), keep()]

    told = robomaker("upload", "--kept", "-o", "json")

    assert told.code == 0, told.err
    report = KeptReport.model_validate_json(told.out)
    assert [(run.state, run.files, run.job_status) for run in report.runs] == [("stored", 2, "Failed")] * 2
    for arn in arns:
        document = service.catalog.get(arn).document
        manifest = read_manifest(service.store, **document["outputs"])
        assert [file.path for file in manifest.files] == ["map.pgm", "result.json"]
        assert manifest.about["simulationTimeMillis"] == 1200
        assert document["verdict"] == "PASS"
    assert not list((service.settings.home / "jobs").iterdir())
    assert "No outputs are kept" in robomaker("upload", "--kept").out


def test_one_job_may_be_named_by_its_id(robomaker: Any, keep: Callable[[], str], service: Service) -> None:
    first, second = keep(), keep()

    told = robomaker("upload", "--kept", second.rpartition("/")[2])

    assert told.code == 0, told.err
    assert "Stored the outputs of 1 of 1 run." in told.out
    assert "outputs" in service.catalog.get(second).document
    assert "outputs" not in service.catalog.get(first).document
    assert robomaker("upload", "--kept", "sim-nosuchjob000").code == 2


def test_what_cannot_be_stored_stays_and_the_others_are_stored(
    robomaker: Any, keep: Callable[[], str], service: Service
) -> None:
    broken, whole = keep(), keep()
    job = broken.rpartition("/")[2]
    output = service.settings.home / "jobs" / job / RUN / "output"
    # In a directory a key cannot be an object and a folder.
    service.store.ensure_bucket("robomaker")
    service.store.put_bytes("robomaker", f"simulation-jobs/{job}/{RUN}/map.pgm/in-the-way", b"")

    told = robomaker("upload", "--kept")

    assert told.code == 3
    assert "! not stored: " in told.out
    assert "both an object and the folder" in told.out
    assert "Stored the outputs of 1 of 2 runs." in told.out
    assert "outputs" in service.catalog.get(whole).document
    assert (output / "map.pgm").exists()


def test_what_is_left_of_a_job_whose_workers_died_all_the_time_is_stored_without_a_manifest(
    robomaker: Any, service: Service, order: Order
) -> None:
    arn = call("CreateSimulationJob", order(), service)["arn"]
    service.catalog.transition(arn, "prepare", document_changes=SimulationJobProgress(run_id=RUN))
    service.catalog.transition(arn, "start")
    folder = service.folder("jobs", arn.rpartition("/")[2], RUN)
    for name in ("output/half.mcap", "work/scratch"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("half")
    for worker in ("a", "b", "c", "d"):
        service.catalog.claim(arn, worker, 0.0)
    perform_job(arn, service)
    assert "job workers died" in service.catalog.get(arn).document["failureReason"]

    told = robomaker("upload", "--kept")

    assert told.code == 0, told.out
    document = service.catalog.get(arn).document
    place = document["outputs"]
    assert service.store.get_bytes(place["bucket"], f"{place['prefix']}/half.mcap") == b"half"
    with pytest.raises(ObjectNotFoundError):
        read_manifest(service.store, **place)
    assert "job workers died" in document["failureReason"]
    assert not folder.parent.exists()


def test_a_job_that_is_held_is_left_alone(robomaker: Any, keep: Callable[[], str], service: Service) -> None:
    arn = keep()
    service.catalog.claim(arn, "gc:1", 60.0)

    assert "No outputs are kept" in robomaker("upload", "--kept").out


@pytest.mark.deep
def test_doctor_and_gc_point_to_it(robomaker: Any, keep: Callable[[], str], service: Service, home: Path) -> None:
    arn = keep()

    collected = robomaker("gc", "--older-than", "30d", "--dry-run")
    examined = robomaker("doctor", "-o", "json")

    assert "outputs of 1 run could not be stored and are here only: `robomaker upload --kept`" in collected.out
    [finding] = [each for each in json.loads(examined.out)["findings"] if each["subject"] == "kept outputs"]
    assert finding["health"] == "warning"
    assert str(home / "jobs" / arn.rpartition("/")[2] / RUN / "output") in finding["found"]
