"""How long comparing two large runs and looking back over many nights take, as commands; prints, asserts no time."""

import os
import random
import resource
import subprocess
import sys
import time
from pathlib import Path
from statistics import median

import pytest
from helpers.night_records import make_job, make_night, store_night

from prefect_robomaker.schemas.reports.run_record import StepRecord

ROBOMAKER = Path(sys.executable).parent / "robomaker"
ROUNDS = 5
METRICS = 20


def store(home: Path, night: int, jobs: int, chance: random.Random) -> str:
    """Stores a night: jobs with metrics and a requirement, and the step's output as a batch has it."""
    made = [
        make_job(
            index,
            "P" if chance.random() < 0.9 else "F",
            night=night,
            metrics={f"metric_{number}_m": chance.gauss(number, 1) for number in range(METRICS)},
        )
        for index in range(jobs)
    ]
    record = make_night(made, night, runs=home / "runs")
    created = [{"arn": job.arn, "lastUpdatedAt": str(record.ended_at), "status": "Completed"} for job in made]
    step = StepRecord(
        name="drive", operation="StartSimulationJobBatch", status="Completed", output={"createdRequests": created}
    )
    store_night(record.model_copy(update={"steps": [step]}))
    return record.run_id


def seconds(home: Path, *words: str) -> list[tuple[float, float]]:
    """Wall-clock and processor time of each round."""
    spent = []
    for _ in range(ROUNDS + 1):  # the first may have to write byte code
        began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [str(ROBOMAKER), *words]
        subprocess.run(command, env={**os.environ, "ROBOMAKER_HOME": str(home)}, capture_output=True, check=False)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
        spent.append((time.perf_counter() - began, used))
    return spent[1:]


def told(what: str, home: Path, words: list[str], target_s: float, capsys: pytest.CaptureFixture[str]) -> None:
    spent, bare = seconds(home, *words), seconds(home, "--version")
    (wall, used), (bare_wall, bare_used) = (
        (median(each) for each in zip(*found, strict=True)) for found in (spent, bare)
    )
    load = f"load {os.getloadavg()[0]:.1f} on {len(os.sched_getaffinity(0))} cores"
    with capsys.disabled():
        print(
            f"\n{what}: {wall:.2f} s, target {target_s:g}, best {min(spent)[0]:.2f}; {used:.2f} CPU-s, "
            f"{used / bare_used:.0f} times `robomaker --version` ({bare_wall:.2f} s, {bare_used:.2f} CPU-s); {load}"
        )


@pytest.mark.benchmark
def test_comparing_two_runs_of_1000_jobs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chance = random.Random(1)
    first, second = (store(tmp_path, night, 1000, chance) for night in (0, 1))
    told("compare two runs of 1,000 jobs", tmp_path, ["compare", first, second], 2, capsys)


@pytest.mark.benchmark
def test_a_history_of_100_nights_of_100_jobs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chance = random.Random(2)
    for night in range(100):
        store(tmp_path, night, 100, chance)
    told("history of 100 nights of 100 jobs", tmp_path, ["history", "nightly"], 3, capsys)
    size = (tmp_path / "history" / "nightly.html").stat().st_size
    with capsys.disabled():
        print(f"its page: {size / 1e6:.2f} MB")
