"""A failure by chance among thousands of tests is named, and refuses no change; what fails again does."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY

MODULE = """
from pathlib import Path

def test_good():
    pass

def test_bad():
    assert False

def test_chance():
    earlier = Path("runs").read_text() if Path("runs").exists() else ""
    Path("runs").write_text(earlier + "x")
    assert len(earlier) not in {failing}
"""
"""`test_chance` fails in those of its runs whose numbers are given."""


pytestmark = pytest.mark.deep


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """The folder of the lists that a failed run leaves."""
    folder = tmp_path / "kept"
    folder.mkdir()
    return folder


def again(kept: Path, *failed: str, failing: str = "set()") -> subprocess.CompletedProcess[str]:
    """Runs the script after a run in which these tests failed."""
    folder = kept.parent
    (folder / "test_it.py").write_text(MODULE.replace("{failing}", failing))
    for number, test in enumerate(failed):
        (kept / f"failed-{number}.txt").write_text(f"test_it.py::test_good\ntest_it.py::{test}\n")
    pytest_here = folder / "pytest"
    pytest_here.write_text(f'#!/bin/sh\ncd "{folder}" && exec "{sys.executable}" -m pytest "$@"\n')
    pytest_here.chmod(0o755)
    environ = {**os.environ, "ROBOMAKER_TESTS_KEEP": str(kept), "PYTEST": str(pytest_here)}
    environ.pop("PYTEST_XDIST_WORKER", None)
    return subprocess.run([REPOSITORY / ".ci" / "again"], env=environ, capture_output=True, text=True, check=False)


def test_a_test_that_passes_three_times_is_named_and_forgiven(kept: Path) -> None:
    done = again(kept, "test_chance")

    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1].endswith("test_it.py::test_chance")
    assert "UNSTABLE" in done.stdout
    assert (kept.parent / "runs").read_text() == "xxx"
    assert not list(kept.iterdir()), "the next run's failures would be counted with these"


@pytest.mark.parametrize("failing", ["{0}", "{1}", "{2}"])
def test_a_test_that_fails_once_more_refuses(kept: Path, failing: str) -> None:
    done = again(kept, "test_chance", failing=failing)

    assert done.returncode == 1
    assert "UNSTABLE" not in done.stdout


@pytest.mark.parametrize("failed", [[], ["test_chance", "test_bad"], ["test_good"] * 3])
def test_failures_that_are_no_chance_refuse(kept: Path, failed: list[str]) -> None:
    assert again(kept, *failed).returncode == 1
