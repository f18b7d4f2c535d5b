"""How long a person waits for the commands that do not run anything."""

import subprocess
import sys
import time
from pathlib import Path
from statistics import median

import pytest
from helpers.paths import REPOSITORY

ROBOMAKER = Path(sys.executable).parent / "robomaker"
SPEC = REPOSITORY / "deployments" / "specs" / "quickstart.yaml"
RUNS = 7


def _seconds(command: list[str]) -> float:
    spent = []
    for _ in range(RUNS + 1):  # the first may have to write byte code
        started = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        spent.append(time.perf_counter() - started)
    return median(spent[1:])


@pytest.mark.benchmark
def test_commands_a_person_waits_for() -> None:
    bare = _seconds([sys.executable, "-c", "pass"])
    print(f"\npython -c pass: {bare * 1000:.0f} ms")
    for arguments in (["--help"], ["validate", str(SPEC)], ["plan", str(SPEC)]):
        spent = _seconds([str(ROBOMAKER), *arguments])
        print(f"robomaker {arguments[0]}: {spent * 1000:.0f} ms, {spent / bare:.1f} times a bare Python start")
