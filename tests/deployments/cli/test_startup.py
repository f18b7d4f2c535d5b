"""What a user waits for interactively imports nothing heavy."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from helpers.paths import REPOSITORY

QUICKSTART = str(REPOSITORY / "deployments" / "specs" / "quickstart.yaml")
HEAVY = ("prefect", "mujoco", "dm_control", "sqlalchemy", "boto3", "numpy", "scipy", "starlette")
PROBE = """
import contextlib, io, json, sys
from prefect_robomaker.deployments.cli.main import main
seen = {}
for line in json.loads(sys.argv[1]):
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        try:
            code = main(line)
        except SystemExit as end:
            code = end.code
    assert code == 0, line
    seen[" ".join(line)] = {"said": said.getvalue(), "imported": list(sys.modules)}
json.dump(seen, sys.stdout)
"""
LIGHT = [
    ["--help"],
    ["--version"],
    ["run", "--help"],
    ["world", "show", "--help"],
    ["serve", "--help"],
    ["compare", "--help"],
    ["history", "--help"],
    ["sdk-model"],
]
"""These import least, so they come first: modules stay imported."""
OTHERS = [["validate", QUICKSTART], ["plan", QUICKSTART], ["schema"], ["schema", "DescribeWorld"]]


def seen(*lines: list[str], **environ: str) -> dict[str, dict[str, Any]]:
    """What each command line said, and what was imported by then, one after the other in one new process."""
    words = [sys.executable, "-c", PROBE, json.dumps(lines)]
    ended = subprocess.run(words, capture_output=True, text=True, check=False, env={**os.environ, **environ})
    assert ended.returncode == 0, ended.stderr
    return json.loads(ended.stdout)


def test_a_plan_with_reuse_reads_the_catalog_and_imports_neither_prefect_nor_mujoco(tmp_path: Path) -> None:
    (plan,) = seen(["plan", QUICKSTART, "--reuse"], ROBOMAKER_HOME=str(tmp_path / "home")).values()
    assert "0 of 4 worlds and 0 of 4 simulation jobs are taken over" in plan["said"]
    assert not {"prefect", "mujoco", "dm_control", "scipy", "starlette"}.intersection(plan["imported"])


def test_nothing_heavy_is_imported() -> None:
    for line, about in seen(*LIGHT, *OTHERS).items():
        assert about["said"], line
        assert not set(HEAVY).intersection(about["imported"]), line
        if line.split() in LIGHT:
            assert not {"pydantic", "ruamel", "rich", "jmespath"}.intersection(about["imported"]), line
