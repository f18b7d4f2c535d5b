"""A failed run of the tests says how to repeat it, and keeps what that needs."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.paths import TESTS

CHANCE = """
import random

def test_first():
    pass

def test_second():
    pass

def test_chance():
    assert not f"drawn {random.random()}"
"""
"""It fails with a number that is drawn, so that a repetition shows whether it is one."""


def run(folder: Path, *words: str) -> str:
    command = [sys.executable, "-m", "pytest", "-p", "helpers.repeating", "-m", "not deep", *words]
    environ = {**os.environ, "PYTHONPATH": str(TESTS), "ROBOMAKER_TESTS_KEEP": str(folder / "kept")}
    environ.pop("PYTEST_XDIST_WORKER", None)
    done = subprocess.run(command, cwd=folder, env=environ, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stdout


def drawn(printed: str) -> str:
    found = re.search(r"drawn (0\.\d+)", printed)
    assert found, printed
    return found.group(1)


@pytest.mark.deep
def test_a_failure_by_chance_is_repeated_as_it_says(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(CHANCE)
    first = run(tmp_path, "-n", "1", "test_it.py")
    alone = re.search(r"^pytest (-n 0 .*test_chance)$", first, re.MULTILINE)
    after = re.search(r"before it: pytest (-n 0 .*failed-0.txt)$", first, re.MULTILINE)
    assert alone
    assert after

    assert drawn(run(tmp_path, *shlex.split(alone.group(1)))) == drawn(first)
    assert drawn(run(tmp_path, *shlex.split(after.group(1)))) == drawn(first)
    kept = (tmp_path / "kept" / "failed-0.txt").read_text().split()
    assert kept[-1] == "test_it.py::test_chance"
