"""Comparing two runs of 100,000 trials each, as a user does it: `robomaker compare` in a process of its own."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.night_records import make_trials_night

TRIALS = 100_000
WORLDS = 50
MOST_S = 3.0
MOST_BYTES = 300e6

pytestmark = pytest.mark.benchmark


@pytest.mark.parametrize("worlds", [1, WORLDS])
def test_comparing_two_runs_of_100000_trials(worlds: int, tmp_path: Path) -> None:
    chance = np.random.default_rng(1)
    runs = tmp_path / "runs"
    for night, rate in enumerate((0.95, 0.94)):
        letters = np.where(chance.random((worlds, TRIALS // worlds)) < rate, "P", "F")
        make_trials_night(["".join(each) for each in letters], night, runs=runs)
    names = sorted(each.name for each in runs.iterdir())
    bare, _ = _measured([sys.executable, "-c", "import numpy, pydantic, pyarrow.parquet, scipy.special"], tmp_path)
    took, peak = _measured([str(Path(sys.executable).with_name("robomaker")), "compare", *names], tmp_path)
    print(f"{worlds} worlds: {took:.2f} s, of which imports {bare:.2f} s; {peak / 1e6:.0f} MB")
    assert took <= MOST_S
    assert peak <= MOST_BYTES


_WATCH = """\
import resource, subprocess, sys, time
began = time.perf_counter()
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
assert code in (0, 1, 6), code
print(time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024)
"""
"""A small process, since a child is as large as the one that forks it until it becomes its program."""


def _measured(command: list[str], home: Path) -> tuple[float, float]:
    """Seconds of the fastest of three runs, and the largest memory of any in bytes."""
    environment = {"ROBOMAKER_HOME": str(home), "PATH": "/usr/bin:/bin"}
    watch = [sys.executable, "-c", _WATCH, *command]
    told = [subprocess.run(watch, env=environment, capture_output=True, text=True, check=True).stdout for _ in range(3)]
    found = [tuple(map(float, each.split())) for each in told]
    return min(took for took, _ in found), max(peak for _, peak in found)
