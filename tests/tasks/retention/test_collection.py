"""What is collected: of runs and jobs that are stored as real ones are, in a directory and on S3."""

import json
import os
import threading
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from helpers.fleet_calls import Fleets
from helpers.tested_batches import Batches, courier, etag

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.reports.retention import GcItem, GcReport, RetentionPolicy
from prefect_robomaker.schemas.reports.run_record import Order, RunRecord
from prefect_robomaker.schemas.wire.errors import ConfigurationError, StorageUnavailableError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.inspection.judged_recordings import store_recording
from prefect_robomaker.tasks.retention import removal
from prefect_robomaker.tasks.retention.collection import collect, plan_collection
from prefect_robomaker.tasks.service.service import Service

BUCKET = "their-own-bucket"
MONTH = RetentionPolicy(older_than=timedelta(days=30))
MakeRun = Callable[..., RunRecord]
ALSO_ON_S3 = pytest.mark.parametrize(
    "service", ["directory", pytest.param("s3", marks=pytest.mark.slow)], indirect=True
)
"""Both stores are shown in the suite; rules of the collection alone are on S3 in deep runs."""


def keys(service: Service) -> set[str]:
    return {info.key for info in service.store.list(BUCKET)} - {"nights/their.txt"}


def runs(service: Service) -> set[str]:
    return {path.name for path in (service.settings.home / "runs").iterdir()}


def by_id(items: list[GcItem]) -> dict[str, GcItem]:
    return {item.id: item for item in items}


def everything(service: Service) -> tuple[set[str], set[str], dict[str, dict[str, int]]]:
    return keys(service), runs(service), service.catalog.count()


def test_looking_changes_nothing_and_says_what_goes(service: Service, job: Any, night: MakeRun) -> None:
    night("night-1", [job("sim-1")], days=40)
    night("night-2", [job("sim-2")], days=3)
    before = everything(service)

    items = by_id(plan_collection(MONTH, service).items)

    assert everything(service) == before
    assert items["night-1"].action == "remove"
    stored = sum(info.size_bytes for info in service.store.list(BUCKET, "nights/sim-1/"))
    local = sum(path.stat().st_size for path in (service.settings.home / "runs" / "night-1").iterdir())
    assert (items["night-1"].objects, items["night-1"].size_bytes) == (4 + 2, stored + local)
    assert (items["night-2"].action, items["night-2"].reason) == ("keep", "not old enough")


@ALSO_ON_S3
def test_a_run_goes_with_its_outputs_jobs_and_folders(service: Service, job: Any, night: MakeRun) -> None:
    night("night-1", [job("sim-1")], days=40)
    night("night-2", [job("sim-2"), job("sim-22")], days=3)
    service.folder("jobs", "sim-1", "run-sim-1", "output")

    report = collect(MONTH, service)

    assert report.problems == []
    assert runs(service) == {"night-2"}
    assert {key.split("/")[1] for key in keys(service)} == {"sim-2", "sim-22"}
    assert not (service.settings.home / "jobs" / "sim-1").exists()
    assert service.catalog.get_many([service.arn("simulation-job", "sim-1")]) == {}
    assert service.store.get_bytes(BUCKET, "nights/their.txt") == b"not ours"
    assert collect(MONTH, service).removed == []


def test_what_a_kept_report_names_stays_and_is_told(service: Service, job: Any, night: MakeRun) -> None:
    shared, own = job("sim-shared"), job("sim-own")
    night("night-1", [shared, own], days=40)
    night("night-2", [shared], days=3)

    item = by_id(collect(MONTH, service).items)["night-1"]

    assert (item.action, item.reason) == ("remove", "1 of its jobs stay: night-2 names them")
    assert {key.split("/")[1] for key in keys(service)} == {"sim-shared"}
    assert service.catalog.get(shared.arn).status == "Completed"


def test_results_that_a_kept_run_took_over_stay(service: Service, job: Any, night: MakeRun) -> None:
    origin = job("sim-origin")
    night("night-20260101T020000000", [origin], days=60)
    night("night-20260301T020000000", [job("sim-reused", of=origin)], days=1)

    collect(MONTH, service)

    assert service.catalog.get(origin.arn).status == "Completed"
    assert any("sim-origin/run-sim-origin/result.json" in key for key in keys(service))


@pytest.mark.parametrize("record", [None, "{"], ids=["it goes on", "it cannot be read"])
def test_results_stay_that_a_run_without_a_readable_record_took_over(
    service: Service, job: Any, night: MakeRun, record: str | None
) -> None:
    origin, other = job("sim-origin"), job("sim-other")
    night("night-20260101T020000000", [origin, other], days=60)
    reused = job("sim-reused", of=origin)
    folder = service.folder("runs", "night-20260301T020000000")
    if record is not None:
        (folder / "run.json").write_text(record)

    item = by_id(collect(MONTH, service).items)["night-20260101T020000000"]

    assert item.reason == f"1 of its jobs stay: {reused.arn} names them"
    assert service.catalog.get(origin.arn).status == "Completed"
    assert {key.split("/")[1] for key in keys(service)} == {"sim-origin", "sim-reused"}


def test_a_run_that_died_does_not_keep_what_was_made_since_for_ever(service: Service, job: Any) -> None:
    dead = service.folder("runs", f"night-{datetime.now(UTC):%Y%m%dT%H%M%S%f}"[:-3])
    orphan = job("sim-orphan")
    later = replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=60))
    policy = MONTH.model_copy(update={"sdk_jobs": True, "keep_failures": True})

    items = by_id(collect(policy, later).items)

    assert (items[dead.name].action, items[dead.name].reason) == ("keep", "it did not succeed")
    assert items[orphan.arn].action == "remove"


def test_what_two_removed_runs_name_counts_once(service: Service, job: Any, night: MakeRun) -> None:
    shared = job("sim-shared")
    night("night-1", [shared], days=40)
    night("night-2", [shared], days=39)

    planned, told = plan_collection(MONTH, service), collect(MONTH, service)

    assert [item.objects for item in planned.items] == [item.objects for item in told.items] == [4 + 2, 2]
    assert told.problems == []
    assert (keys(service), runs(service)) == (set(), set())


@ALSO_ON_S3
def test_results_that_stay_are_whole_and_the_report_says_what_went(
    service: Service, job: Any, night: MakeRun, prefect_server: str
) -> None:
    night("night-1", [job("sim-1")], days=40)

    report = collect(MONTH.model_copy(update={"keep_results": True}), service)

    assert report.problems == []
    (item,) = report.items
    assert (item.action, item.objects, item.size_bytes) == ("thin", 2, 1004)
    prefix = "nights/sim-1/run-sim-1"
    assert keys(service) == {f"{prefix}/result.json", f"{prefix}/manifest.json"}
    page = (service.settings.home / "runs" / "night-1" / "report.html").read_text()
    assert "2 more files were removed to free space" in page
    assert "recording.mcap" not in page
    again = plan_collection(MONTH.model_copy(update={"keep_results": True}), service)
    assert [(item.action, item.reason) for item in again.items] == [("keep", "only its results are left")]


@pytest.mark.parametrize("status", ["Running", "Terminating"])
def test_what_runs_stays(service: Service, job: Any, night: MakeRun, status: str) -> None:
    night("night-1", [job("sim-1", status)], days=40)
    before = everything(service)

    (item,) = collect(MONTH, service).items

    assert (item.action, item.reason) == ("keep", f"simulation-job sim-1 is {status}")
    assert everything(service) == before


def test_a_job_whose_lease_is_held_stays(service: Service, job: Any, night: MakeRun) -> None:
    held = job("sim-1")
    night("night-1", [held], days=40)
    assert service.catalog.claim(held.arn, "somebody", 60)
    before = everything(service)

    (item,) = collect(MONTH, service).items

    assert (item.action, item.reason) == ("keep", "simulation-job sim-1 is in use by somebody")
    assert everything(service) == before


def test_a_lease_that_is_taken_after_the_look_keeps_the_job(service: Service, job: Any, night: MakeRun) -> None:
    held = job("sim-1")
    night("night-1", [held], days=40)
    (unit,) = removal_units(service)
    assert service.catalog.claim(held.arn, "somebody", 60)

    with pytest.raises(removal.StillInUse):
        removal.remove_unit(unit, set(), service)

    assert len(keys(service)) == 4


def removal_units(service: Service) -> list[Any]:
    from prefect_robomaker.tasks.retention.inventory import find_runs

    return find_runs(service)


class Failing:
    """A store that stops answering after some deletions."""

    def __init__(self, store: Any, left: int) -> None:
        self._store, self._left = store, left

    def __getattr__(self, name: str) -> Any:
        if name == "delete":
            self._left -= 1
            if self._left < 0:
                raise StorageUnavailableError("no answer")
        return getattr(self._store, name)


@pytest.mark.parametrize("deletions", range(5))
def test_an_interrupted_removal_looks_whole_to_nobody_and_is_finished_by_the_next(
    service: Service, job: Any, night: MakeRun, deletions: int
) -> None:
    night("night-1", [job("sim-1")], days=40)
    store: Any = Failing(service.store, deletions)

    report = collect(MONTH, replace(service, store=store))

    assert (report.problems == []) == (deletions > 3)
    folder = service.settings.home / "runs" / "night-1"
    assert not (folder / "run.json").exists()
    if deletions:
        assert "nights/sim-1/run-sim-1/manifest.json" not in keys(service)
    # What was begun is finished, whatever the next policy keeps.
    assert collect(RetentionPolicy(keep_runs=5), service).problems == []
    assert (keys(service), runs(service)) == (set(), set())


def test_the_newest_and_the_failed_stay(service: Service, job: Any, night: MakeRun) -> None:
    night("night-1", [job("sim-1")], days=40, state="failed")
    for number in (2, 3, 4):
        night(f"night-{number}", [job(f"sim-{number}")], days=40 - number)

    items = by_id(collect(RetentionPolicy(keep_runs=1, keep_failures=True), service).items)

    assert runs(service) == {"night-1", "night-4"}
    assert items["night-1"].reason == "it did not succeed"
    assert items["night-4"].reason == "one of the newest 1 of night"


def test_jobs_of_sdks_go_only_when_asked_and_never_those_of_a_run_that_may_go_on(
    service: Service, job: Any, night: MakeRun
) -> None:
    early = job("sim-early")
    later = replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=60))
    assert collect(MONTH, later).removed == []
    running = service.folder("runs", f"night-{datetime.now(UTC):%Y%m%dT%H%M%S%f}"[:-3])
    job("sim-late")
    os.utime(running, (later.clock().timestamp(), later.clock().timestamp()))

    report = collect(MONTH.model_copy(update={"sdk_jobs": True}), later)

    assert [item.id for item in report.removed] == [early.arn]
    assert {key.split("/")[1] for key in keys(service)} == {"sim-late"}
    assert running.exists()


def test_the_batch_that_the_last_deployment_of_a_fleet_requires_stays(service: Service) -> None:
    application = courier(service)
    batches = Batches(service, etag(service))
    arns = [batches.batch(), batches.batch()]
    fleets = Fleets(service)
    fleet = fleets.fleet()
    fleets.robot("rover", fleet)
    jobs = []
    for arn in arns:
        order = {"deploymentConfig": {"requiresBatch": arn}}
        jobs.append(fleets.deploy(fleet, application.arn, arn[-12:], **order)["arn"])
        fleets.cancel(jobs[-1])
    later = replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=60))

    report = collect(MONTH.model_copy(update={"sdk_jobs": True}), later)

    assert [item.id for item in report.removed] == arns[:1]
    (kept,) = (item for item in report.items if item.id == arns[1])
    assert (kept.action, kept.reason) == ("keep", f"{jobs[-1]} requires it")
    assert len(service.catalog.children(arns[1], "simulation-job")) == 1


def test_worlds_that_a_job_names_stay(service: Service, job: Any) -> None:
    """Also a job that no run made, and that has ended; its world goes when the job goes."""
    named, orphan = (
        service.catalog.create(
            Resource.new(arn=service.arn("world", f"gen/{name}"), kind="world", id=f"gen/{name}", status="Active"),
            token=None,
        )
        for name in ("named", "orphan")
    )
    request = {"simulationApplications": [{"worldConfigs": [{"world": named.arn}]}]}
    service.catalog.update(job("sim-1").arn, lambda document: {**document, "request": request})
    later = replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=60))
    worlds = MONTH.model_copy(update={"orphaned_worlds": True})

    assert [item.id for item in collect(worlds, later).removed] == [orphan.arn]

    told = collect(worlds.model_copy(update={"sdk_jobs": True}), later)
    assert [item.kind for item in told.removed] == ["jobs", "world"]
    assert service.catalog.list("world").resources == ()


def test_imported_worlds_stay_unless_they_are_asked_for(service: Service) -> None:
    """A deployed specification may name an imported world between its nights, when no run and no job does."""
    imported, varied = (
        service.catalog.create(
            Resource.new(arn=service.arn("world", name), kind="world", id=name, status="Active"), token=None
        )
        for name in ("import-82856b0yq33y", "variation-82856b0yq33y")
    )
    later = replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=60))
    orphaned = MONTH.model_copy(update={"orphaned_worlds": True})
    by_hand = MONTH.model_copy(update={"imported_worlds": True})

    report = collect(orphaned, later)
    assert [item.id for item in report.removed] == [varied.arn]
    assert any("imported worlds stay (1)" in note and "--imported-worlds" in note for note in report.notes)
    assert collect(MONTH, later).notes == []

    report = collect(by_hand, later)
    assert ([item.id for item in report.removed], report.notes) == ([imported.arn], [])


def test_a_record_that_cannot_be_read_keeps_what_it_may_name(service: Service, job: Any) -> None:
    job("sim-1")
    (service.folder("runs", "night-1") / "run.json").write_text("{")
    later = replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=60))

    report = collect(MONTH.model_copy(update={"sdk_jobs": True, "orphaned_worlds": True}), later)

    assert report.removed == []
    assert "its record cannot be read" in report.items[0].reason
    assert "left" in report.notes[0]


def test_outputs_elsewhere_than_a_runs_own_folder_are_left(service: Service, job: Any, night: MakeRun) -> None:
    """A document that names another place, by a mistake or on purpose, removes nothing there."""
    odd = job("sim-1")
    service.catalog.update(odd.arn, lambda document: {**document, "outputs": {"bucket": BUCKET, "prefix": "nights"}})
    night("night-1", [odd], days=40)

    assert collect(MONTH, service).problems == []

    assert service.store.get_bytes(BUCKET, "nights/their.txt") == b"not ours"


def test_two_at_once_are_refused(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    from prefect_robomaker.tasks.retention import collection

    inside, go_on = threading.Event(), threading.Event()
    find_runs = collection.find_runs

    def slow(service: Service) -> Any:
        inside.set()
        assert go_on.wait(120)
        return find_runs(service)

    monkeypatch.setattr(collection, "find_runs", slow)
    first = threading.Thread(target=collect, args=(MONTH, service))
    first.start()
    try:
        assert inside.wait(120)
        with pytest.raises(ConfigurationError, match="another `robomaker gc` is going on"):
            collect(MONTH, service)
    finally:
        go_on.set()
        first.join()


@ALSO_ON_S3
def test_recordings_that_no_job_names_go(service: Service, job: Any, tmp_path: Path) -> None:
    """Age, the jobs that stay, and what lies beside recordings decide; a recording that is judged again is young."""
    policy = MONTH.model_copy(update={"orphaned_recordings": True, "sdk_jobs": True})
    bucket, folders = service.settings.bucket, [f"recordings/{digit * 16}" for digit in "abc"]
    service.store.ensure_bucket(bucket)
    for folder in folders:
        for name in ("bag/metadata.yaml", "bag/bag_0.mcap"):
            service.store.put_bytes(bucket, f"{folder}/{name}", b"said")
    service.store.put_bytes(bucket, "recordings-of-mine/x.mcap", b"said")
    for name, keys in (("sim-old", [f"{folders[0]}/bag/"]), ("sim-batch", [f"{folders[1]}/bag/bag_0.mcap"])):
        sources = [{"name": "recording", "s3Bucket": bucket, "s3Keys": keys}]
        document = SimulationJobDocument(request={"dataSources": sources}, seed=1)
        service.catalog.create(
            Resource.new(arn=service.arn("simulation-job", name), kind="simulation-job", id=name, status="Completed",
                         document=document), token=None)  # fmt: skip

    def left() -> set[str]:
        return {"/".join(info.key.split("/")[:2]) for info in service.store.list(bucket, "recordings")}

    later = replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=40))
    alone = policy.model_copy(update={"sdk_jobs": False})
    assert collect(alone, service).removed == [], "too young"
    assert collect(MONTH, later).removed == [], "not asked for"
    [planned] = plan_collection(alone, later).removed
    assert (planned.kind, planned.id, planned.objects, planned.size_bytes) == ("recording", folders[2], 2, 8)
    assert {each.id for each in plan_collection(policy, later).removed} >= {*folders}, "their jobs go, too"

    assert [each.id for each in collect(alone, later).removed] == [folders[2]]

    assert left() == {folders[0], folders[1], "recordings-of-mine/x.mcap"}
    bag = tmp_path / "bag.mcap"
    bag.write_bytes(b"another")
    [key] = store_recording(bag, service)
    service.store.put_bytes(bucket, key, b"was there")
    assert store_recording(bag, service) == [key]
    assert service.store.get_bytes(bucket, key) == b"was there"
    store_recording(bag, replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=2)))
    assert service.store.get_bytes(bucket, key) == b"another", "so that it is young, and gc does not take it now"


def test_a_recording_that_the_order_of_an_open_run_names_stays(service: Service, tmp_path: Path) -> None:
    """`judge` may break off before its job exists, and `perform` ends its run later, however late."""
    bag = tmp_path / "bag.mcap"
    bag.write_bytes(b"said")
    [key] = store_recording(bag, service)
    other = tmp_path / "other.mcap"
    other.write_bytes(b"another")
    [of_nobody] = store_recording(other, service)
    specification = json.dumps({"jobs": [{"dataSources": [{"name": "recording", "s3Keys": [key]}]}]})
    folder = service.settings.home / "runs" / "judged-20260101T000000000"
    folder.mkdir(parents=True)
    order = Order(run_id=folder.name, text=specification, filename="judged.json", spec_path="", command=["perform"])
    (folder / "order.json").write_text(order.model_dump_json())
    policy = RetentionPolicy(older_than=timedelta(days=2), orphaned_recordings=True)

    def after(days: int) -> Service:
        return replace(service, clock=lambda: datetime.now(UTC) + timedelta(days=days))

    def recordings(report: GcReport) -> list[str]:
        return [each.id for each in report.removed if each.kind == "recording"]

    assert recordings(collect(policy, after(days=3))) == [of_nobody.rpartition("/")[0]]
    assert service.store.get_bytes(service.settings.bucket, key) == b"said"

    planned = recordings(plan_collection(policy, after(days=40)))
    assert planned == [key.rpartition("/")[0]], "its run goes, too"
    assert recordings(collect(policy, after(days=40))) == planned
