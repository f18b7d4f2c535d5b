"""What a user waits for interactively imports nothing heavy."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY

QUICKSTART = str(REPOSITORY / "deployments" / "specs" / "quickstart.yaml")
HEAVY = ("prefect", "mujoco", "dm_control", "sqlalchemy", "boto3", "numpy", "scipy", "starlette")
PROBE = """
import sys
from prefect_robomaker.deployments.cli.main import main
try:
    code = main(sys.argv[1:])
except SystemExit as end:
    code = end.code
print(*sys.modules, file=sys.stderr)
sys.exit(code)
"""


def test_a_plan_with_reuse_reads_the_catalog_and_imports_neither_prefect_nor_mujoco(tmp_path: Path) -> None:
    environ = {**os.environ, "ROBOMAKER_HOME": str(tmp_path / "home")}
    words = [sys.executable, "-c", PROBE, "plan", QUICKSTART, "--reuse"]
    ended = subprocess.run(words, capture_output=True, text=True, check=True, env=environ)
    assert "0 of 4 worlds and 0 of 4 simulation jobs are taken over" in ended.stdout
    assert not set(ended.stderr.split()).intersection(("prefect", "mujoco", "dm_control", "scipy", "starlette"))


@pytest.mark.parametrize(
    "words",
    [
        ["--help"],
        ["--version"],
        ["validate", QUICKSTART],
        ["plan", QUICKSTART],
        ["schema"],
        ["schema", "DescribeWorld"],
        ["sdk-model"],
        ["run", "--help"],
        ["world", "show", "--help"],
        ["serve", "--help"],
        ["compare", "--help"],
        ["history", "--help"],
    ],
    ids=" ".join,
)
def test_nothing_heavy_is_imported(words: list[str]) -> None:
    ended = subprocess.run([sys.executable, "-c", PROBE, *words], capture_output=True, text=True, check=True)
    assert ended.stdout
    imported = set(ended.stderr.split())
    assert not imported.intersection(HEAVY)
    if words[-1].startswith("--") or words == ["sdk-model"]:
        assert not imported.intersection(("pydantic", "ruamel", "rich", "jmespath"))
