"""A night whose store cannot be written to ends before its first step, and says why."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.required_programs import needs
from helpers.small_flat import BODY

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.service.service import Service


@pytest.mark.deep
@needs("bubblewrap", shutil.which("bwrap"), "bwrap is not installed")
def test_a_run_with_a_read_only_store_makes_no_world(service: Service, prefect_server: str, tmp_path: Path) -> None:
    store, home = tmp_path / "store", service.settings.home
    environ = {"ROBOMAKER_HOME": str(home), "ROBOMAKER_OBJECT_STORE": str(store), "PREFECT_API_URL": prefect_server}
    Service.open(Settings.from_environment(environ), {}).store.ensure_bucket("robomaker")
    worlds = {"template": "${{ flat.arn }}", "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1}}
    steps = {
        "flat": {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": BODY}},
        "worlds": {"operation": "CreateWorldGenerationJob", "input": worlds},
    }
    spec = tmp_path / "night.yaml"
    spec.write_text(json.dumps({"version": 1, "name": "night", "steps": steps}))

    box = ["bwrap", "--dev-bind", "/", "/", "--ro-bind", str(store), str(store)]
    command = [*box, sys.executable, "-m", "prefect_robomaker.deployments.cli.main", "run", str(spec)]
    ended = subprocess.run(command, env={**os.environ, **environ}, capture_output=True, text=True, timeout=240)

    assert ended.returncode != 0
    assert "Read-only file system" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert not service.catalog.list("world-template").resources
    assert list((home / "runs").glob("*/run.json")) == []
