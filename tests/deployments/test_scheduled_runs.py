"""A schedule made as `docs/prefect.md` says: it fires on the server that this project starts, up to the report."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.paths import REPOSITORY
from helpers.processes import started
from helpers.server_log import tracebacks
from helpers.small_flat import BODY, ROLE

PAGE = REPOSITORY / "docs" / "prefect.md"
EVERY_MINUTE = "* * * * *"
SPEC = {
    "version": 1,
    "name": "one-flat",
    "description": "One run in one small flat.",
    "steps": {
        "template": {"operation": "CreateWorldTemplate", "input": {"name": "two rooms", "templateBody": BODY}},
        "worlds": {
            "operation": "CreateWorldGenerationJob",
            "input": {
                "template": "${{ template.arn }}",
                "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1},
                "seed": 7,
            },
        },
        "drive": {
            "operation": "CreateSimulationJob",
            "input": {
                "maxJobDurationInSeconds": 120,
                "iamRole": ROLE,
                "robotApplications": [{"application": "scout", "launchConfig": {}}],
                "simulationApplications": [
                    {
                        "application": "indoor-navigation",
                        "launchConfig": {},
                        "worldConfigs": [{"world": "${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}"}],
                    }
                ],
            },
        },
    },
}
# Waits for a run that the schedule made, and that a worker carried to its end.
WATCH = """
import json, time
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import DeploymentFilter, DeploymentFilterName
made = DeploymentFilter(name=DeploymentFilterName(any_=["one-flat"]))
deadline = time.monotonic() + 600
with get_client(sync_client=True) as client:
    while True:
        runs = client.read_flow_runs(deployment_filter=made)
        ended = [run for run in runs if run.state.is_final()]
        if ended or time.monotonic() > deadline:
            break
        time.sleep(1)
print(json.dumps([[run.auto_scheduled, run.state.type.value, run.state.message] for run in ended]))
"""


@pytest.fixture
def environ(tmp_path: Path) -> Iterator[dict[str, str]]:
    """Variables of a user whose home is empty; what they start is stopped."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "ROBOMAKER_"))}
    home = tmp_path / "robomaker"
    made = {
        **inherited,
        "HOME": str(tmp_path / "user"),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PREFECT_WORKER_QUERY_SECONDS": "1",
        "ROBOMAKER_HOME": str(home),
    }
    (tmp_path / "user").mkdir()
    yield made
    shell("robomaker server stop", made, tmp_path)


def documented() -> tuple[str, list[str], str]:
    """How a shell finds the server, what makes the deployment, and what starts a worker: as the page has them."""
    blocks = re.findall(r"^```console\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    (block,) = [block for block in blocks if "robomaker pool-template process" in block]
    setup, *making, worker = [line.removeprefix("$ ") for line in block.splitlines()]
    assert worker.startswith("prefect worker start")
    return setup, making, worker


@pytest.mark.slow
@pytest.mark.deep
@pytest.mark.timeout(1500)
def test_a_schedule_made_as_documented_fires_up_to_the_report(environ: dict[str, str], tmp_path: Path) -> None:
    setup, making, worker = documented()
    folder = tmp_path / "project"
    folder.mkdir()
    (folder / "nightly.yaml").write_text(json.dumps(SPEC))
    script = "\n".join([setup, *making]).replace("0 2 * * *", EVERY_MINUTE)

    answer = shell(script, environ, folder)
    assert "RunPipeline/one-flat  created, runs at * * * * * Europe/Berlin" in answer
    (folder / "nightly.yaml").unlink()  # the deployment keeps it

    log = tmp_path / "worker.log"
    command = ["bash", "-c", f"{setup}\nexec {worker}"]
    (folder / "watch.py").write_text(WATCH)
    with log.open("w") as output, started(command, environ, cwd=folder, stdout=output, stderr=subprocess.STDOUT):
        ended: list[Any] = json.loads(shell(f"{setup}\npython watch.py", environ, folder).splitlines()[-1])

    assert ended, log.read_text()
    for scheduled, state, message in ended:
        assert (scheduled, state) == (True, "COMPLETED"), f"{message}\n{log.read_text()}"
    (report, *_) = (tmp_path / "robomaker" / "runs").glob("one-flat-*/report.html")
    assert "one-flat" in report.read_text()
    record = json.loads((report.parent / "run.json").read_text())
    assert record["command"] == ["prefect", "deployment", "run", "RunPipeline/one-flat"]
    (server_log,) = (tmp_path / "robomaker").rglob("server.log")
    assert tracebacks(server_log.read_text()) == []


def shell(script: str, environ: dict[str, str], folder: Path) -> str:
    """Runs lines as a user would type them."""
    command = ["bash", "-euo", "pipefail", "-c", script]
    ended = subprocess.run(command, env=environ, cwd=folder, capture_output=True, text=True, check=False, timeout=900)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout
