"""What a user waits for interactively imports nothing heavy."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from helpers.night_records import make_night, store_night
from helpers.paths import REPOSITORY

QUICKSTART = str(REPOSITORY / "deployments" / "specs" / "quickstart.yaml")
HEAVY = ("prefect", "mujoco", "dm_control", "sqlalchemy", "boto3", "numpy", "scipy", "starlette")
PROBE = """
import contextlib, io, json, sys
from prefect_robomaker.deployments.cli.main import main
seen = {}
for line, expected in json.loads(sys.argv[1]):
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        try:
            code = main(line)
        except SystemExit as end:
            code = end.code
    assert code == expected, line
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


def seen(*lines: list[str], codes: Sequence[int] = (), **environ: str) -> dict[str, dict[str, Any]]:
    """What each command line said, and what was imported by then, one after the other in one new process."""
    expected = zip(lines, codes or [0] * len(lines), strict=True)
    words = [sys.executable, "-c", PROBE, json.dumps(list(expected))]
    ended = subprocess.run(words, capture_output=True, text=True, check=False, env={**os.environ, **environ})
    assert ended.returncode == 0, ended.stderr
    return json.loads(ended.stdout)


def test_a_plan_with_reuse_reads_the_catalog_and_imports_neither_prefect_nor_mujoco(tmp_path: Path) -> None:
    (plan,) = seen(["plan", QUICKSTART, "--reuse"], ROBOMAKER_HOME=str(tmp_path / "home")).values()
    assert "0 of 4 worlds and 0 of 4 simulation jobs are taken over" in plan["said"]
    assert not {"prefect", "mujoco", "dm_control", "scipy", "starlette"}.intersection(plan["imported"])


def test_a_report_imports_no_prefect_and_a_comparison_no_catalog(tmp_path: Path) -> None:
    """Prefect's artifacts of a report, and its events, are for flow runs only."""
    home = tmp_path / "home"
    first, second = (make_night("", night, runs=home / "runs") for night in (0, 1))
    for night in (first, second):
        store_night(night)

    lines = ["compare", first.run_id, second.run_id], ["report", first.run_id]
    compared, report = seen(*lines, codes=(7, 0), ROBOMAKER_HOME=str(home)).values()

    assert "has no simulation jobs" in compared["said"]
    assert not {"prefect", "sqlalchemy", "boto3", "mujoco", "starlette"}.intersection(compared["imported"])
    assert Path(report["said"].strip()).is_file()
    assert not {"prefect", "boto3", "mujoco", "starlette"}.intersection(report["imported"])


def test_importing_models_builds_few_of_them() -> None:
    """A process uses few of our 300 models: each is built when it is first used."""
    program = """
from prefect_robomaker.schemas.specs import check
from prefect_robomaker.schemas.wire.base import Model
models = {Model}
while more := {each for model in models for each in model.__subclasses__()} - models:
    models |= more
print(len(models), sum(each.__pydantic_complete__ for each in models))
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    known, built = map(int, ended.stdout.split())
    assert known > 250
    assert built < 30


def test_nothing_heavy_is_imported() -> None:
    for line, about in seen(*LIGHT, *OTHERS).items():
        assert about["said"], line
        assert not set(HEAVY).intersection(about["imported"]), line
        if line.split() in LIGHT:
            assert not {"pydantic", "ruamel", "rich", "jmespath"}.intersection(about["imported"]), line


NO_PREFECT_YET = """
import sys
from prefect_robomaker.deployments.cli import prefect_server

def answer(*_, **__):
    print("has Prefect" if "prefect" in sys.modules else "may choose")
    raise SystemExit(99)

prefect_server.use_server = answer
"""


def test_commands_that_run_jobs_choose_a_prefect_server_before_prefect_is_imported(tmp_path: Path) -> None:
    """Prefect reads the server's address, and that it shall be quiet, when it is imported."""
    lines = [
        ["run", QUICKSTART],
        ["plan", QUICKSTART, "--probe"],
        ["challenge", QUICKSTART],
        ["doctor", "--backend", "local"],
        ["server", "start"],
        ["serve"],
    ]
    expected = [(line, 99) for line in lines]
    words = [sys.executable, "-c", NO_PREFECT_YET + PROBE, json.dumps(expected)]
    environ = {**os.environ, "ROBOMAKER_HOME": str(tmp_path / "home")}
    ended = subprocess.run(words, capture_output=True, text=True, check=False, env=environ)
    assert ended.returncode == 0, ended.stderr
    for line, about in json.loads(ended.stdout).items():
        assert about["said"].splitlines()[-1] == "may choose", line
