"""Full disks and sudden death: nothing half-written looks finished, and the next one finds everything in order."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import RobomakerError
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service, Timing
from prefect_robomaker.tasks.storage import open_store
from prefect_robomaker.tasks.storage.directory import DirectoryStore

Order = Callable[..., dict[str, Any]]
MAIN = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 2 MiB."""
    folder = tmp_path / "small-disk"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", folder], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip(f"mounting a file system needs root: {mounted.stderr.decode().strip()}")
    yield folder
    subprocess.run(["umount", "--lazy", folder], check=True)


def manifests(store: Path) -> list[Path]:
    return sorted(store.rglob("manifest.json"))


def check_manifests(store: Path) -> None:
    """Checks that every manifest names only files that are there, whole."""
    for path in manifests(store):
        for file in json.loads(path.read_text())["files"]:
            assert (path.parent / file["path"]).stat().st_size == file["size_bytes"]


def test_outputs_that_do_not_fit_into_the_store_fail_the_job_without_a_manifest(
    service: Service, hostile: Order, small_disk: Path, prefect_server: str
) -> None:
    environment = {"ROBOMAKER_HOME": str(service.settings.home), "ROBOMAKER_OBJECT_STORE": str(small_disk)}
    settings = Settings.from_environment(environment)
    store = open_store(settings, {})
    store.ensure_bucket("applications")
    store.put_bytes("applications", "hostile.tar.gz", service.store.get_bytes("applications", "hostile.tar.gz"))
    full = Service(settings, service.catalog, store, timing=Timing(store_patience_s=0.0))
    job = call("CreateSimulationJob", hostile("hostile.arena.filling"), full)

    ended = registry()["CreateSimulationJob"].perform(job["arn"], full)

    assert (ended["status"], ended["failureCode"]) == ("Failed", "InternalServiceError")
    assert "No space left on device" in ended["failureReason"]
    assert manifests(small_disk) == []
    kept = Path(ended["failureReason"].rpartition("they are in ")[2])
    assert len(list(kept.glob("*.bin"))) == 300
    # With space again, the next job works.
    for path in small_disk.rglob("*.bin"):
        path.unlink()
    job = call("CreateSimulationJob", hostile(), full)
    assert registry()["CreateSimulationJob"].perform(job["arn"], full)["status"] == "Completed"
    check_manifests(small_disk)


def test_outputs_that_do_not_fit_wait_until_there_is_space(
    service: Service, hostile: Order, small_disk: Path, prefect_server: str
) -> None:
    store = DirectoryStore(small_disk)
    store.ensure_bucket("applications")
    store.put_bytes("applications", "hostile.tar.gz", service.store.get_bytes("applications", "hostile.tar.gz"))
    notes: list[str] = []

    def make_space(text: str) -> None:
        notes.append(text)
        subprocess.run(["mount", "-o", "remount,size=50m", small_disk], check=True)

    full = replace(service, store=store, timing=Timing(store_pause_s=0.1), report_note=make_space)
    job = call("CreateSimulationJob", hostile("hostile.arena.filling"), full)

    ended = registry()["CreateSimulationJob"].perform(job["arn"], full)

    assert ended["status"] == "Completed", ended["failureReason"]
    assert "No space left on device" in notes[0]
    assert len(manifests(small_disk)) == 1
    check_manifests(small_disk)


def test_a_home_that_is_full_is_said_and_the_next_job_works_once_there_is_space(
    hostile: Order, service: Service, small_disk: Path, prefect_server: str
) -> None:
    settings = Settings.from_environment(
        {
            "ROBOMAKER_HOME": str(small_disk),
            "ROBOMAKER_OBJECT_STORE": service.settings.object_store,
            "ROBOMAKER_MIN_FREE_DISK_MB": "0",  # else jobs would wait for space
        }
    )
    full = Service.open(settings, {})
    for kind, operation in (
        ("robot-application", "CreateRobotApplication"),
        ("simulation-application", "CreateSimulationApplication"),
    ):
        [name] = [each.name for each in service.catalog.list(kind).resources if each.name in ("driver", "arena")]
        request = {
            "name": name,
            "sources": [{"s3Bucket": "applications", "s3Key": "hostile.tar.gz"}],
            "robotSoftwareSuite": {"name": "General"},
        }
        if kind == "simulation-application":
            request["simulationSoftwareSuite"] = {"name": "SimulationRuntime"}
        call(operation, request, full)
    job = call("CreateSimulationJob", hostile("hostile.arena.filling"), full)

    with pytest.raises(RobomakerError, match="disk is full"):
        registry()["CreateSimulationJob"].perform(job["arn"], full)

    assert manifests(Path(service.settings.object_store)) == []
    # With space again, everything is in order and the next job works.
    subprocess.run(["mount", "-o", "remount,size=50m", small_disk], check=True)
    again = Service.open(settings, {})
    assert again.catalog.get(job["arn"]).status in ("Preparing", "Running", "Terminating")
    job = call("CreateSimulationJob", hostile(), again)
    assert registry()["CreateSimulationJob"].perform(job["arn"], again)["status"] == "Completed"
    check_manifests(Path(service.settings.object_store))


@pytest.fixture
def spec(tmp_path: Path) -> Callable[[dict[str, Any]], Path]:
    """Writes a specification of one simulation job."""

    def write(request: dict[str, Any]) -> Path:
        steps = {"drive": {"operation": "CreateSimulationJob", "input": request}}
        path = tmp_path / "spec.json"
        path.write_text(json.dumps({"version": 1, "name": "attacked", "steps": steps}))
        return path

    return write


@pytest.mark.slow
@pytest.mark.parametrize(
    ("environment", "status"),
    [
        pytest.param("endless", "Running", marks=pytest.mark.endurance),
        pytest.param("filling", "Terminating", marks=pytest.mark.deep),
    ],
)
def test_a_killed_run_leaves_no_manifest_and_no_process_and_the_next_run_works(
    service: Service,
    hostile: Order,
    spec: Callable[[dict[str, Any]], Path],
    tmp_path: Path,
    prefect_server: str,
    environment: str,
    status: str,
) -> None:
    variables = {**os.environ, "ROBOMAKER_HOME": str(service.settings.home), "PREFECT_API_URL": prefect_server}
    variables["ROBOMAKER_SANDBOX"] = "off"  # its processes write to this test's folder who they are
    command = [*MAIN, "run", str(spec(hostile(f"hostile.arena.{environment}")))]
    with subprocess.Popen(command, env=variables, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        job = _wait_for(service, status, process)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()

    store = Path(service.settings.object_store)
    assert manifests(store / "results") == []
    processes = [int(line) for line in (tmp_path / "processes").read_text().split()]
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in processes), "the simulation to end with its run")
    # A process that opens the catalog now sees the job as it stood, and can run another.
    again = Service.open(service.settings, {})
    assert again.catalog.get(job).status == status
    other = call("CreateSimulationJob", hostile(), again)
    assert registry()["CreateSimulationJob"].perform(other["arn"], again)["status"] == "Completed"
    assert len(manifests(store / "results")) == 1
    check_manifests(store)


def _wait_for(service: Service, status: str, process: "subprocess.Popen[bytes]") -> str:
    deadline = time.monotonic() + 200
    while time.monotonic() < deadline and process.poll() is None:
        for job in service.catalog.list("simulation-job").resources:
            notes = Path(
                job.document["request"]["robotApplications"][0]["launchConfig"]["environmentVariables"]["PROCESSES"]
            )
            if job.status == status and notes.exists():
                return job.arn
        time.sleep(0.005)
    raise AssertionError(f"no job became {status}")


def test_a_job_that_writes_without_end_fails_before_it_hurts_others(
    service: Service, order: Order, prefect_server: str
) -> None:
    settings = service.settings.model_copy(update={"max_job_disk_gb": 1})
    limited = replace(service, settings=settings)
    # Blocks are taken without being written, in no time.
    fill = "import os, time\nfile = open(os.environ['TMPDIR'] + '/endless.bin', 'wb')\nfor part in range(20):\n"
    fill += "    os.posix_fallocate(file.fileno(), part * 100_000_000, 100_000_000)\n    time.sleep(0.1)\n"
    job = call("CreateSimulationJob", order({"DO": fill}), limited)

    ended = registry()["CreateSimulationJob"].perform(job["arn"], limited)

    assert (ended["status"], ended["failureCode"]) == ("Failed", "SimulationApplicationCrash")
    assert "used too much: 1 GB of disk are allowed" in ended["failureReason"]
    assert "the biggest files are /tmp/endless.bin (1" in ended["failureReason"]  # and a little
    assert not list((service.settings.home / "jobs").iterdir())
