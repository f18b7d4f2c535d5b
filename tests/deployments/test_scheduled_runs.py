"""A schedule made as `docs/prefect.md` says: it fires on the server that this project starts, up to the report."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY
from helpers.prefect_server import provide_tables
from helpers.processes import started, wait_for
from helpers.server_log import tracebacks
from helpers.small_flat import BODY

from prefect_robomaker.deployments.prefect_server.local_server import server_status
from prefect_robomaker.deployments.prefect_server.secret import auth_string, server_folder
from prefect_robomaker.schemas.settings import Settings

PAGE = REPOSITORY / "docs" / "prefect.md"
EVERY_MINUTE = "* * * * *"
SPEC = {
    "version": 1,
    "name": "one-flat",
    "description": "One small flat.",
    "steps": {
        "template": {"operation": "CreateWorldTemplate", "input": {"name": "two rooms", "templateBody": BODY}},
        "look": {"operation": "DescribeWorldTemplate", "input": {"template": "${{ template.arn }}"}},
    },
}
"""Schedules; `test_prefect_yaml.py` has what a worker makes of worlds and jobs."""


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
    provide_tables(server_folder(Settings.from_environment({"ROBOMAKER_HOME": str(home)})))
    yield made
    shell("robomaker server stop --force", made, tmp_path)


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
    # What is deployed goes before the worker starts: the deployment keeps it.
    typed = "\n".join([setup, *making, "rm nightly.yaml", f"exec {worker}"]).replace("0 2 * * *", EVERY_MINUTE)

    log = tmp_path / "worker.log"
    command = ["bash", "-euo", "pipefail", "-c", typed]
    with log.open("w") as output, started(command, environ, cwd=folder, stdout=output, stderr=subprocess.STDOUT):
        said = "RunPipeline/one-flat  created, runs at * * * * * Europe/Berlin"
        wait_for(lambda: said in log.read_text(), f"the deployment; {log}", 600)
        ended = wait_for(partial(ended_runs, environ), f"the end of a run; {log}", 600)

    for scheduled, state, message in ended:
        assert (scheduled, state) == (True, "COMPLETED"), f"{message}\n{log.read_text()}"
    assert not (folder / "nightly.yaml").exists()
    (report, *_) = (tmp_path / "robomaker" / "runs").glob("one-flat-*/report.html")
    assert "one-flat" in report.read_text()
    record = json.loads((report.parent / "run.json").read_text())
    assert record["command"] == ["prefect", "deployment", "run", "RunPipeline/one-flat"]
    (server_log,) = (tmp_path / "robomaker").rglob("server.log")
    assert tracebacks(server_log.read_text()) == []


def ended_runs(environ: dict[str, str]) -> list[tuple[bool, str, str | None]]:
    """Whether a schedule made them, how they ended, and what they say of it."""
    from prefect.client.orchestration import SyncPrefectClient
    from prefect.client.schemas.filters import DeploymentFilter, DeploymentFilterName

    settings = Settings.from_environment({"ROBOMAKER_HOME": environ["ROBOMAKER_HOME"]})
    made = DeploymentFilter(name=DeploymentFilterName(any_=["one-flat"]))
    with SyncPrefectClient(str(server_status(settings, {}).api_url), auth_string=auth_string(settings)) as client:
        states = [(run.auto_scheduled, run.state) for run in client.read_flow_runs(deployment_filter=made)]
    return [(bool(auto), state.type.value, state.message) for auto, state in states if state and state.is_final()]


def shell(script: str, environ: dict[str, str], folder: Path) -> str:
    """Runs lines as a user would type them."""
    command = ["bash", "-euo", "pipefail", "-c", script]
    ended = subprocess.run(command, env=environ, cwd=folder, capture_output=True, text=True, check=False, timeout=900)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout
