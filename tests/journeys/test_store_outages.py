"""An S3 server that is away, hangs or says 503 while jobs need it: that costs them time, and not their results."""

import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from subprocess import Popen
from typing import Any

import pytest
from helpers.fault_proxy import FaultProxy, in_between
from helpers.processes import started, wait_for
from helpers.s3_server import MortalS3Server, S3Server
from helpers.small_flat import BODY, ROLE

from prefect_robomaker.schemas.runs.provenance import Manifest
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError, StorageError, StorageUnavailableError
from prefect_robomaker.tasks.jobs.job_folders import find_kept, store_kept
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service, Timing
from prefect_robomaker.tasks.simulations.outputs.run_outputs import RunOutputs
from prefect_robomaker.tasks.storage import read_manifest
from prefect_robomaker.tasks.storage.s3 import S3Store

Order = Callable[..., dict[str, Any]]
QUICK = Timing(store_pause_s=0.1)
HASTY = Timing(store_pause_s=0.1, store_patience_s=0.5, store_grace_s=0.5)
WRITE = """
from pathlib import Path
for number in range(6):
    (Path.home() / f"map-{number}.pgm").write_text(str(number))
"""
MAPS = {"name": "maps", "path": "/home/robomaker/*.pgm", "uploadBehavior": "UPLOAD_ON_TERMINATE"}


def service_at(endpoint: str, server: S3Server, home: Path, timing: Timing) -> Service:
    environ = {"ROBOMAKER_HOME": str(home), "ROBOMAKER_OBJECT_STORE": endpoint}
    opened = Service.open(Settings.from_environment(environ), server.environ())
    store = S3Store(endpoint, "us-east-1", server.session(), attempts=2)
    return replace(opened, store=store, timing=timing)


@pytest.fixture
def timing() -> Timing:
    return QUICK


@pytest.fixture
def proxy(mortal_s3: MortalS3Server) -> Iterator[FaultProxy]:
    with in_between(mortal_s3.server.endpoint) as proxy:
        yield proxy


@pytest.fixture
def service(mortal_s3: MortalS3Server, proxy: FaultProxy, tmp_path: Path, timing: Timing) -> Service:
    """Everything below the test's folder, but objects on a server that the test may kill, with a proxy before it."""
    return service_at(proxy.endpoint, mortal_s3.server, tmp_path / "home", timing)


@pytest.fixture
def notes() -> list[str]:
    """What those who watch are told."""
    return []


@contextmanager
def performed(service: Service, request: dict[str, Any], notes: list[str]) -> Iterator[str]:
    """A job that is performed while the block runs, which waits for its end; its ARN."""
    arn = call("CreateSimulationJob", request, service)["arn"]
    worker = threading.Thread(target=perform_job, args=(arn, replace(service, report_note=notes.append)), daemon=True)
    worker.start()
    yield arn
    worker.join(120.0)
    assert not worker.is_alive()


def with_maps(request: dict[str, Any]) -> dict[str, Any]:
    request["simulationApplications"][0]["uploadConfigurations"] = [MAPS]
    return {**request, "outputLocation": {"s3Bucket": "robomaker", "s3Prefix": "nightly"}}


def status_of(service: Service, arn: str) -> str:
    return service.catalog.get(arn).status


def stored_whole(service: Service, arn: str) -> Manifest:
    """The manifest of a job's outputs, all of which are there."""
    document = service.catalog.get(arn).document
    assert document.get("outputs"), document.get("failureReason")
    manifest = read_manifest(service.store, **document["outputs"])
    for file in manifest.files:
        head = service.store.head(document["outputs"]["bucket"], f"{document['outputs']['prefix']}/{file.path}")
        assert head.size_bytes == file.size_bytes
    return manifest


@pytest.mark.deep
def test_inputs_that_cannot_be_fetched_are_waited_for_and_nothing_is_started(
    service: Service, order: Order, proxy: FaultProxy, notes: list[str]
) -> None:
    request = order()
    arn = call("CreateSimulationJob", request, service)["arn"]
    proxy.answer(503, "SlowDown")
    job = replace(service, report_note=notes.append)
    worker = threading.Thread(target=perform_job, args=(arn, job), daemon=True)
    worker.start()

    wait_for(lambda: notes, "the wait to be told")
    assert status_of(service, arn) == "Preparing"
    assert "lastStartedAt" not in service.catalog.get(arn).document
    owner, has_run_out = service.catalog.lease_of(arn)
    assert owner is not None
    assert not has_run_out
    proxy.pass_on()
    worker.join(120.0)

    assert status_of(service, arn) == "Completed"
    assert notes[0].startswith(f"{arn.rpartition('/')[2]}: waits for the object store, at most 30 min: ")
    assert "503" in notes[0]
    assert "answers again" in notes[-1]
    stored_whole(service, arn)


def test_a_server_that_dies_while_a_job_runs_gets_its_outputs_when_it_is_back(
    service: Service, order: Order, mortal_s3: MortalS3Server, notes: list[str]
) -> None:
    direct = S3Store(mortal_s3.server.endpoint, "us-east-1", mortal_s3.server.session(), attempts=2)
    service = replace(service, store=direct)
    with performed(service, with_maps(order({"DO": WRITE, "DURATION_S": "1"})), notes) as arn:
        wait_for(lambda: status_of(service, arn) == "Running", "the run to begin")
        mortal_s3.kill()
        wait_for(lambda: notes, "the job to wait")
        assert status_of(service, arn) == "Terminating"
        mortal_s3.come_back()

    assert status_of(service, arn) == "Completed"
    assert {f"maps/map-{number}.pgm" for number in range(6)} <= {file.path for file in stored_whole(service, arn).files}
    assert not list((service.settings.home / "jobs").iterdir())


@pytest.mark.deep
def test_what_was_uploaded_before_the_store_went_away_is_not_uploaded_again(
    service: Service, order: Order, proxy: FaultProxy, notes: list[str]
) -> None:
    with performed(service, with_maps(order({"DO": WRITE, "DURATION_S": "1"})), notes) as arn:
        wait_for(lambda: status_of(service, arn) == "Running", "the run to begin")
        proxy.answer(503, "SlowDown", after_puts=4)
        wait_for(lambda: notes, "the job to wait")
        proxy.pass_on()

    files = stored_whole(service, arn).files
    prefix = service.catalog.get(arn).document["outputs"]["prefix"]
    assert {proxy.puts[f"/robomaker/{prefix}/{file.path}"] for file in files} == {1}
    assert proxy.refused > 0


def test_a_cancel_ends_the_wait_for_a_server_that_hangs(
    service: Service, order: Order, mortal_s3: MortalS3Server
) -> None:
    arn = call("CreateSimulationJob", order(), service)["arn"]
    mortal_s3.hang()
    worker = threading.Thread(target=perform_job, args=(arn, service), daemon=True)
    worker.start()
    wait_for(lambda: status_of(service, arn) == "Preparing", "the job to begin")

    call("CancelSimulationJob", {"job": arn}, service)

    # The server hangs until then, whatever a request to it takes.
    wait_for(lambda: status_of(service, arn) == "Canceled", "the cancellation to be heard")
    mortal_s3.go_on()
    worker.join(120.0)


@pytest.mark.deep
def test_a_server_that_hangs_for_a_while_costs_a_job_nothing(
    service: Service, order: Order, mortal_s3: MortalS3Server, notes: list[str]
) -> None:
    with performed(service, with_maps(order({"DO": WRITE, "DURATION_S": "1"})), notes) as arn:
        wait_for(lambda: status_of(service, arn) == "Running", "the run to begin")
        mortal_s3.hang()
        wait_for(lambda: status_of(service, arn) == "Terminating", "the run to end")
        mortal_s3.go_on()

    assert status_of(service, arn) == "Completed"
    stored_whole(service, arn)


@pytest.mark.deep
def test_when_patience_is_over_the_job_fails_and_its_outputs_are_kept_and_stored_later_each_file_once(
    service: Service, order: Order, proxy: FaultProxy, notes: list[str]
) -> None:
    """Four of the files were stored before the store went away for longer than its patience."""
    request = with_maps(order({"DO": WRITE, "DURATION_S": "1"}))
    with performed(replace(service, timing=HASTY), request, notes) as kept:
        wait_for(lambda: status_of(service, kept) == "Running", "the run to begin")
        proxy.answer(503, "SlowDown", after_puts=4)
    job = call("DescribeSimulationJob", {"job": kept}, service)

    assert (job["status"], job["failureCode"]) == ("Failed", "InternalServiceError")
    assert "SlowDown" in job["failureReason"]
    assert "`robomaker upload --kept` stores them" in job["failureReason"]
    [found] = find_kept(service)
    assert found.job.arn == kept
    assert str(found.output_dir) in job["failureReason"]
    names = {path.name for path in found.files()}
    assert {"result.json", *(f"map-{number}.pgm" for number in range(6))} <= names
    assert find_kept(service, kept.rpartition("/")[2]) == [found]
    with pytest.raises(StorageUnavailableError):
        store_kept(found, replace(service, timing=HASTY))
    proxy.pass_on()
    half_is_stored_and_does_not_look_whole(service)

    place = store_kept(found, service)

    files = stored_whole(service, kept).files
    assert {proxy.puts[f"/{place.bucket}/{place.prefix}/{file.path}"] for file in files} == {1}
    job, document = call("DescribeSimulationJob", {"job": kept}, service), service.catalog.get(kept).document
    assert job["status"] == "Failed", "its lifecycle leads nowhere from there"
    assert job["failureReason"].startswith("the outputs could not be stored when the run ended; they were at 20")
    assert document["outputs"] == {"bucket": place.bucket, "prefix": place.prefix}
    assert not list((service.settings.home / "jobs").iterdir())
    assert find_kept(service) == []


def half_is_stored_and_does_not_look_whole(service: Service) -> None:
    run = next((service.settings.home / "jobs").glob("*/*"))
    stored = list(service.store.list("robomaker", f"nightly/{run.parent.name}/{run.name}"))
    assert 0 < len(stored) < len(list(find_kept(service)[0].files()))
    with pytest.raises(ObjectNotFoundError):
        read_manifest(service.store, "robomaker", f"nightly/{run.parent.name}/{run.name}")


@pytest.mark.deep
def test_what_was_cancelled_while_the_store_is_away_has_a_short_grace_and_is_kept(
    service: Service, order: Order, proxy: FaultProxy, notes: list[str]
) -> None:
    patient = replace(service, timing=replace(HASTY, store_patience_s=1800.0))
    with performed(patient, order({"DURATION_S": "60"}), notes) as arn:
        wait_for(lambda: status_of(service, arn) == "Running", "the run to begin")
        proxy.answer(503, "SlowDown")
        call("CancelSimulationJob", {"job": arn}, service)

    assert status_of(service, arn) == "Canceled"
    [found] = find_kept(service)
    proxy.pass_on()
    store_kept(found, service)
    assert status_of(service, arn) == "Canceled"
    assert service.catalog.get(arn).document["outputs"]


@pytest.mark.deep
def test_a_job_that_is_cancelled_while_its_outputs_wait_for_the_store_is_canceled(
    service: Service, order: Order, proxy: FaultProxy, notes: list[str]
) -> None:
    patient = replace(service, timing=replace(HASTY, store_patience_s=1800.0))
    with performed(patient, with_maps(order({"DO": WRITE, "DURATION_S": "1"})), notes) as arn:
        wait_for(lambda: status_of(service, arn) == "Running", "the run to begin")
        proxy.answer(503, "SlowDown", after_puts=4)
        wait_for(lambda: notes, "the job to wait")
        assert status_of(service, arn) == "Terminating"
        call("CancelSimulationJob", {"job": arn}, service)

    assert status_of(service, arn) == "Canceled"
    [found] = find_kept(service)
    proxy.pass_on()
    store_kept(found, service)
    assert status_of(service, arn) == "Canceled"
    assert stored_whole(service, arn).about["status"] == "Canceled"


WRITE_MUCH = """
import os
from pathlib import Path
(Path.home() / "large.pgm").write_bytes(os.urandom(40_000_000))
(Path.home() / "small.pgm").write_bytes(os.urandom(1_000))
"""


@pytest.mark.timeout(900)
@pytest.mark.deep
@pytest.mark.parametrize("mortal_s3", ["96m"], indirect=True)
def test_a_server_whose_disk_is_full_gets_the_outputs_when_there_is_space(
    service: Service, order: Order, mortal_s3: MortalS3Server, tmp_path: Path, notes: list[str]
) -> None:
    with performed(service, with_maps(order({"DO": WRITE_MUCH, "DURATION_S": "1"})), notes) as arn:
        wait_for(lambda: status_of(service, arn) == "Running", "the run to begin")
        mortal_s3.fill_disk()
        wait_for(lambda: notes, "the job to wait", 240)  # a server may hang until the client's own time limit
        assert status_of(service, arn) == "Terminating"
        place = RunOutputs(service.catalog.get(arn), service.catalog.get(arn).document["runId"], tmp_path, service)
        with pytest.raises(StorageError):  # half of them does not look whole
            read_manifest(service.store, place.bucket, place.prefix)
        mortal_s3.make_space()
        mortal_s3.kill()  # SeaweedFS writes nothing any more after its disk was full, until it is started again
        mortal_s3.come_back()

    assert status_of(service, arn) == "Completed", service.catalog.get(arn).document
    assert {"maps/large.pgm", "maps/small.pgm"} <= {file.path for file in stored_whole(service, arn).files}
    assert service.store.unfinished_uploads("robomaker", datetime.now(UTC)) == []


def test_data_that_cannot_be_looked_up_now_is_no_fault_of_the_request(
    service: Service, order: Order, proxy: FaultProxy
) -> None:
    service.store.put_bytes("applications", "flat.pgm", b"a map")
    request = order(dataSources=[{"name": "maps", "s3Bucket": "applications", "s3Keys": ["flat.pgm"]}])
    proxy.answer(503, "SlowDown")

    with pytest.raises(StorageUnavailableError):  # a client of the service is told 503, and asks again
        call("CreateSimulationJob", request, service)


def outage(mortal_s3: MortalS3Server, begin: Callable[[], object], notes: list[str]) -> threading.Thread:
    """Kills the server once it may begin, and brings it back when a job waits for it."""

    def go() -> None:
        wait_for(begin, "the outage's time")
        mortal_s3.kill()
        wait_for(lambda: notes, "a job to wait")
        mortal_s3.come_back()

    thread = threading.Thread(target=go, daemon=True)
    thread.start()
    return thread


@pytest.mark.slow
@pytest.mark.deep
def test_a_batch_goes_through_an_outage_and_everything_is_stored_once(
    service: Service,
    order: Order,
    proxy: FaultProxy,
    mortal_s3: MortalS3Server,
    prefect_server: str,
    notes: list[str],
) -> None:
    requests = [with_maps(order({"DO": WRITE, "DURATION_S": "0.5"})) for _ in range(6)]
    policy = {"maxConcurrency": 2}
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": requests, "batchPolicy": policy}, service)
    trouble = outage(mortal_s3, lambda: service.catalog.count_children(batch["arn"], "simulation-job"), notes)

    watched = replace(service, report_note=notes.append)
    ended = registry()["StartSimulationJobBatch"].perform(batch["arn"], watched)
    trouble.join(120.0)

    assert ended["status"] == "Completed"
    assert [job["status"] for job in ended["createdRequests"]] == ["Completed"] * 6
    for job in ended["createdRequests"]:
        stored_whole(service, job["arn"])
        document = service.catalog.get(job["arn"]).document
        assert document.get("attempts", 1) == 1
        prefixes = {item.key.split("/")[2] for item in service.store.list("robomaker", f"nightly/{job['name']}/")}
        assert prefixes == {document["runId"]}, "no run was begun twice"
    assert not list((service.settings.home / "jobs").iterdir())


@pytest.mark.deep
def test_requests_whose_data_cannot_be_looked_up_wait_to_become_jobs(
    service: Service, order: Order, proxy: FaultProxy, prefect_server: str, notes: list[str]
) -> None:
    service.store.put_bytes("applications", "flat.pgm", b"a map")
    request = order(dataSources=[{"name": "maps", "s3Bucket": "applications", "s3Keys": ["flat.pgm"]}])
    orders = {"createSimulationJobRequests": [request], "batchPolicy": {"maxConcurrency": 1}}
    batch = call("StartSimulationJobBatch", orders, service)
    watched = replace(service, report_note=notes.append)

    ended = through(proxy, notes, lambda: perform("StartSimulationJobBatch", batch, watched))

    assert (ended["status"], ended["failedRequests"]) == ("Completed", [])
    assert [job["status"] for job in ended["createdRequests"]] == ["Completed"]
    assert notes[0].startswith(f"{batch['arn'].rpartition('/')[2]}: waits for the object store")


@pytest.mark.deep
@pytest.mark.usefixtures("known_worlds")
def test_worlds_are_generated_and_exported_through_outages(
    service: Service, template: str, proxy: FaultProxy, prefect_server: str, notes: list[str]
) -> None:
    watched = replace(service, report_note=notes.append)
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    job = call("CreateWorldGenerationJob", {"template": template, "worldCount": count, "seed": 7}, service)
    generated = through(proxy, notes, lambda: perform("CreateWorldGenerationJob", job, watched))
    [world] = generated["finishedWorldsSummary"]["succeededWorlds"]
    notes.clear()
    service.store.ensure_bucket("exports")
    location = {"s3Bucket": "exports", "s3Prefix": "night"}
    job = call("CreateWorldExportJob", {"worlds": [world], "outputLocation": location, "iamRole": ROLE}, service)

    exported = through(proxy, notes, lambda: perform("CreateWorldExportJob", job, watched))

    assert (generated["status"], exported["status"]) == ("Completed", "Completed")
    [archive] = service.store.list("exports")
    assert archive.size_bytes > 1000


def perform(operation: str, job: Mapping[str, Any], service: Service) -> dict[str, Any]:
    return registry()[operation].perform(job["arn"], service)


def through(proxy: FaultProxy, notes: list[str], work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Does work that begins while the store is away, which is back once it is waited for."""

    def mend() -> None:
        wait_for(lambda: notes, "the job to wait")
        proxy.pass_on()

    proxy.answer(503, "SlowDown")
    mender = threading.Thread(target=mend, daemon=True)
    mender.start()
    ended = work()
    mender.join(120.0)
    return ended


def flat_spec(tmp_path: Path) -> Path:
    """A specification that makes one world."""
    spec = tmp_path / "spec.json"
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    worlds = {"template": "${{ template.arn }}", "worldCount": count}
    steps = {
        "template": {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": BODY}},
        "worlds": {"operation": "CreateWorldGenerationJob", "input": worlds},
    }
    spec.write_text(json.dumps({"version": 1, "name": "outage", "steps": steps}))
    return spec


@pytest.mark.deep
def test_runs_that_are_typed_while_the_store_is_away_say_so_at_once_and_wait(
    mortal_s3: MortalS3Server, prefect_server: str, tmp_path: Path
) -> None:
    """One is ended by Ctrl-C, the other goes on when the store is back."""
    command = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main", "run", str(flat_spec(tmp_path))]
    mortal_s3.kill()

    @contextmanager
    def typed(home: Path) -> Iterator[Popen[str]]:
        home.mkdir()
        environ = {**mortal_s3.server.environ(), "ROBOMAKER_HOME": str(home), "PREFECT_API_URL": prefect_server}
        with (
            (home / "out").open("w") as output,
            (home / "log").open("w") as errors,
            started([*command, "-o", "json"], environ, stdout=output, stderr=errors) as run,
        ):
            yield run

    ended, gone_on = tmp_path / "ended", tmp_path / "gone-on"
    with typed(ended) as first, typed(gone_on) as second:
        for home in (ended, gone_on):
            wait_for(lambda home=home: "Ctrl-C ends the wait" in (home / "log").read_text(), "the note")
        time.sleep(20.0)  # longer than the S3 client repeats a request by itself
        assert (first.poll(), second.poll()) == (None, None)
        assert "started" not in (ended / "log").read_text() + (gone_on / "log").read_text()

        first.send_signal(signal.SIGINT)
        assert first.wait(200.0) == 130
        assert (ended / "out").read_text() == ""
        assert not (ended / "runs").exists()

        mortal_s3.come_back()
        assert second.wait(200.0) == 0, (gone_on / "log").read_text()
    assert "the object store answers\n" in (gone_on / "log").read_text()
    assert json.loads((gone_on / "out").read_text())["state"] == "succeeded"


@pytest.mark.endurance  # what jobs tell is above, and that the command prints it, too
def test_people_who_watch_a_run_are_told_what_it_waits_for(
    mortal_s3: MortalS3Server, proxy: FaultProxy, prefect_server: str, tmp_path: Path
) -> None:
    """`robomaker run`, with the S3 client's own patience of some seconds before ours."""
    environ = {
        **mortal_s3.server.environ(),
        "ROBOMAKER_OBJECT_STORE": proxy.endpoint,
        "ROBOMAKER_HOME": str(tmp_path / "home"),
        "PREFECT_API_URL": prefect_server,
        "CI": "1",
    }
    command = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main", "run", str(flat_spec(tmp_path))]
    log = tmp_path / "log"
    with log.open("w") as output, started(command, environ, stdout=output, stderr=output) as run:
        wait_for(lambda: "worlds: started" in log.read_text(), "the job", 120.0)
        proxy.answer(503, "SlowDown")
        wait_for(lambda: "waits for the object store, at most 30 min" in log.read_text(), "the note", 120.0)
        proxy.pass_on()
        assert run.wait(120.0) == 0, log.read_text()

    lines = log.read_text().splitlines()
    assert any("the object store answers again, after" in line for line in lines)
