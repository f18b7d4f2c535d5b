"""Two jobs that run at once: one leaves all doors open, and the other tries them, by sockets, signals and files."""

import ctypes
import json
import os
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from helpers.paths import TESTS
from helpers.run_processes import never, wait_until

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.programs import ProgramPlan, RunStop
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

ESCAPES = TESTS / "attacks" / "escapes"
OF_PROCESSES = (
    *("environ", "working directory", "root of a process", "ptrace", "kill", "memory", "memory by a call"),
    *("memory by a file", "descriptors of a process", "stolen descriptor", "limits of a process"),
    *("other limits of a process", "priority of a process", "processors of a process", "group of a process"),
    *("session of a process", "kill order", "traffic of a process", "namespace of a process"),
)
BY_THE_NETWORK = {"tcp", "tcp of version 6", "udp", "abstract socket"}
"""Ways that a network which both share leaves open: docs/sandbox.md says so."""


def plan(folder: Path, run_id: str, argv: list[str], **environment: str) -> RunPlan:
    run = folder / "home" / "runs" / run_id
    (run / "bundle").mkdir(parents=True)
    for each in ESCAPES.glob("*.py"):
        (run / "bundle" / each.name).write_bytes(each.read_bytes())
    program = ProgramPlan(
        name="simulation", role="simulation", kind="application", argv=[sys.executable, *argv], folder=run / "bundle"
    )
    return RunPlan(
        job_id=run_id, job_arn=f"arn:aws:robomaker:us-east-1:000000000000:simulation-job/{run_id}", run_id=run_id,
        seed=1, max_duration_s=300, work_dir=run / "work", output_dir=run / "output", root_dir=run / "root",
        simulation_application=ApplicationPlan(role="simulation", name="attack"), programs=[program],
        environment=environment,
    )  # fmt: skip


def process_named(*words: str) -> int:
    """The process, on this machine, of a command line."""
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            found = entry.read_bytes().decode().split("\0")
        except OSError:
            continue
        if found[1:3] == list(words):
            return int(entry.parent.name)
    raise AssertionError(f"no process {words}")


def remove_left(key: str) -> None:
    """Removes what a job without a box leaves on the machine."""
    for path in (f"/dev/shm/{key}", f"/tmp/{key}", f"/tmp/{key}.sock"):
        Path(path).unlink(missing_ok=True)
    libc = ctypes.CDLL(None)
    if (number := libc.shmget(int(key), 0, 0)) >= 0:
        libc.shmctl(number, 0, None)


@pytest.mark.parametrize(
    ("sandbox", "network"), [("off", "full"), ("require", "none"), ("require", "local"), ("require", "full")]
)
def test_no_job_reaches_another_but_by_a_network_that_both_share(
    launcher: Launcher, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sandbox: str, network: str
) -> None:
    monkeypatch.setenv("ROBOMAKER_SANDBOX", sandbox)
    monkeypatch.setenv("ROBOMAKER_SANDBOX_NETWORK", network)
    monkeypatch.setenv("ROBOMAKER_HOME", str(tmp_path / "home"))
    key = str(0x4E420000 + os.getpid() % 60_000)
    open_doors = plan(tmp_path, "sim-open", ["neighbour.py", key], SECRET_KEY="s3cret")
    over = threading.Event()
    neighbour = threading.Thread(
        target=launcher.run, args=[open_doors, lambda: RunStop.CANCELED if over.is_set() else None]
    )
    neighbour.start()
    try:
        wait_until((open_doors.output_dir / "places.json").exists)
        targets: dict[str, Any] = json.loads((open_doors.output_dir / "places.json").read_text())
        targets |= dict.fromkeys(OF_PROCESSES, process_named("neighbour.py", key))
        attacks = plan(tmp_path, "sim-nosy", ["escapes.py"], TARGETS=json.dumps(targets))

        launcher.run(attacks, never)

        found = set(json.loads((attacks.output_dir / "escapes.json").read_text()))
    finally:
        over.set()
        neighbour.join(200)
        remove_left(key)
    assert len(targets) >= 30
    if sandbox == "off":
        assert found - {"descriptors"} == set(targets), "without a box all succeed"
    else:
        assert found == (BY_THE_NETWORK if network == "full" else set())
