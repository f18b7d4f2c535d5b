"""Processes that run day and night import nothing that they need for single requests, or never."""

import json
import subprocess
import sys

import pytest

_HEAVY = ("prefect", "fastapi", "scipy", "mujoco", "dm_control", "dm_env", "glfw", "trimesh", "pyarrow")
_PROGRAM = f"""
import json, sys
seen = []
for line in sys.argv[1:]:
    exec(line)
    seen.append([name for name in {_HEAVY} if name in sys.modules])
print(json.dumps(seen))
"""


@pytest.mark.parametrize(
    "needed",
    [
        {
            # What all operations are known by, also to the command line.
            "from prefect_robomaker.tasks.operations.registry import registry; registry()": set[str](),
            # `run`, until it has not refused.
            "import prefect_robomaker.tasks.inspection.preflight": set[str](),
            # `serve`.
            "import prefect_robomaker.deployments.console.console": set[str](),
        },
        {
            # Beside the Prefect server.
            "import prefect_robomaker.deployments.dead_run_sweeper": {"prefect"},
            # What starts and judges runs. A simulator takes seconds in each command and job worker, and without a
            # display dm_control warns on standard error.
            "import prefect_robomaker.tasks.jobs.job_runs": {"prefect"},
            "import prefect_robomaker.flows.pipelines": {"prefect"},
            # A call: Prefect's own flows import FastAPI for its parameters.
            "import prefect_robomaker as our; our.RunPipeline.serialize_parameters({'spec': 'a'})": {"prefect"},
            "import prefect_robomaker as our; our.CreateSimulationJob.serialize_parameters({'a': [1]})": {"prefect"},
        },
    ],
    ids=["requests", "runs"],
)
def test_a_process_imports_what_it_needs_only(needed: dict[str, set[str]]) -> None:
    """One process imports several modules, those that need least first: what is imported stays so."""
    command = [sys.executable, "-c", _PROGRAM, *needed]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=200)
    seen = dict(zip(needed, map(set, json.loads(done.stdout)), strict=True))
    assert {line: names - needed[line] for line, names in seen.items() if names - needed[line]} == {}
