"""Processes that run day and night import nothing that they need for single requests, or never."""

import subprocess
import sys

import pytest

_HEAVY = ("prefect", "scipy", "mujoco", "trimesh", "pyarrow")


@pytest.mark.parametrize(
    ("module", "needed"),
    [
        # `serve`: scipy compares runs on its page of nights.
        ("prefect_robomaker.deployments.console.console", {"scipy"}),
        # Beside the Prefect server.
        ("prefect_robomaker.deployments.dead_run_sweeper", {"prefect"}),
        # `run`, until it has not refused.
        ("prefect_robomaker.tasks.inspection.preflight", set[str]()),
    ],
)
def test_a_process_imports_what_it_needs_only(module: str, needed: set[str]) -> None:
    program = f"import sys, {module}; print(*(name for name in {_HEAVY} if name in sys.modules))"

    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=200)

    assert set(done.stdout.split()) <= needed
