"""What `ROBOMAKER_BENCH_JOBS` jobs of 1,000 trials each take of a machine (100 unless it says otherwise).

Prints wall time, the peak memory of every kind of process, rows in Prefect, the size of the report, and how long a
description takes; asserts that each trial is in a table, in the catalog's count and in the report's.
"""

import os
import statistics
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from helpers.batch_task_runs import task_runs
from helpers.paths import BUNDLES
from helpers.processes import descendants, started

from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

TRIALS = 1000
SPEC = """\
version: 1
name: many-swings
steps:
  arena:
    operation: CreateSimulationApplication
    input:
      name: arena
      environment: {uri: "python://swinger"}
      robotSoftwareSuite: {name: General}
      simulationSoftwareSuite: {name: SimulationRuntime}
  agent:
    operation: CreateRobotApplication
    input:
      name: agent
      environment: {uri: "python://swinger"}
      robotSoftwareSuite: {name: General}
  swings:
    operation: StartSimulationJobBatch
    needs: [arena, agent]
    input:
      createSimulationJobRequests:
        forEach: [INDICES]
        as: first
        value:
          maxJobDurationInSeconds: 3600
          seed: "${{ first }}"
          iamRole: arn:aws:iam::000000000000:role/test
          robotApplications: [{application: agent, launchConfig: {}}]
          simulationApplications:
            - {application: arena, launchConfig: {environmentVariables: {TIME_LIMIT_S: "0.2"}}}
          trials: {seeds: TRIALS, record_failed: 0}
"""


def peak_mb(pid: int) -> tuple[str, float]:
    """What a process is, and the most resident memory that it had."""
    words = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    peak_kb = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    return " ".join(word.rsplit("/", 1)[-1] for word in words[:4] if not word.startswith("-")), peak_kb / 1024


@pytest.mark.benchmark
@pytest.mark.timeout(3600)
def test_a_hundred_thousand_trials(tmp_path: Path, prefect_server: str, capsys: pytest.CaptureFixture[str]) -> None:
    jobs = int(os.environ.get("ROBOMAKER_BENCH_JOBS", "100"))
    spec, home = tmp_path / "swings.yaml", tmp_path / "home"
    indices = ", ".join(str(TRIALS * index) for index in range(jobs))
    spec.write_text(SPEC.replace("TRIALS", str(TRIALS)).replace("INDICES", indices))
    environ = {
        "ROBOMAKER_HOME": str(home), "PREFECT_API_URL": prefect_server, "CI": "true",
        "PYTHONPATH": str(BUNDLES / "swinger"),
    }  # fmt: skip
    command = [sys.executable, "-m", "prefect_robomaker", "run", str(spec), "-o", "json"]
    peaks: dict[str, float] = {}
    began = time.monotonic()
    with (tmp_path / "record.json").open("w") as out, started(command, environ, stdout=out) as process:
        while process.poll() is None:
            for pid in {process.pid, *descendants(process.pid)}:
                try:
                    kind, mb = peak_mb(pid)
                except (OSError, StopIteration):
                    continue
                peaks[kind] = max(mb, peaks.get(kind, 0.0))
            time.sleep(0.5)
        wall_s = time.monotonic() - began
    assert process.returncode == 0
    record = RunRecord.model_validate_json((tmp_path / "record.json").read_bytes())
    assert len(record.jobs) == jobs
    assert sum(job.metrics["trials"] for job in record.jobs) == jobs * TRIALS
    tables = list(home.rglob("trials.parquet"))
    assert sum(pq.read_metadata(table).num_rows for table in tables) == jobs * TRIALS
    assert record.report_path is not None
    report_mb = record.report_path.stat().st_size / 1e6
    [batch] = [step.output["arn"] for step in record.steps if step.operation == "StartSimulationJobBatch"]
    environment = {"ROBOMAKER_HOME": str(home)}
    service = Service.open(Settings.from_environment(environment), environment)
    took_ms = []
    for job in (record.jobs * 10)[:1000]:
        start = time.perf_counter()
        call("DescribeSimulationJob", {"job": job.arn}, service)
        took_ms.append((time.perf_counter() - start) * 1000)
    with capsys.disabled():
        print(
            f"\n{jobs * TRIALS:,} trials in {wall_s:.0f} s; report {report_mb:.1f} MB; "
            f"{len(task_runs(batch))} task runs; describe p50 {statistics.median(took_ms):.2f} ms"
        )
        for kind, mb in sorted(peaks.items(), key=lambda each: -each[1]):
            print(f"  {mb:5.0f} MB  {kind}")
