"""Comparing two runs of 100,000 trials each, as a user does it: `robomaker compare` in a process of its own."""

import resource
import subprocess
import sys
import time
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
    bare = _seconds([sys.executable, "-c", "import numpy, pydantic, pyarrow.parquet, scipy.special"], tmp_path)
    command = [str(Path(sys.executable).with_name("robomaker")), "compare", *names]
    took = _seconds(command, tmp_path)
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    print(f"{worlds} worlds: {took:.2f} s, of which imports {bare:.2f} s; {peak / 1e6:.0f} MB")
    assert took <= MOST_S
    assert peak <= MOST_BYTES


def _seconds(command: list[str], home: Path) -> float:
    """The fastest of three runs."""
    found = []
    for _ in range(3):
        start = time.perf_counter()
        done = subprocess.run(
            command,
            env={"ROBOMAKER_HOME": str(home), "PATH": "/usr/bin:/bin"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode in (0, 1, 6), done.stderr
        found.append(time.perf_counter() - start)
    return min(found)
