"""Specifications that pages of the documentation show, run as readers would."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from helpers.paths import REPOSITORY

DOCS = REPOSITORY / "docs"


def run_example(page: str, folder: Path, home: Path, server: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Runs a page's specification; returns the run's record and the jobs' results."""
    text = (DOCS / f"{page}.md").read_text()
    [spec] = [block for block in re.findall(r"```yaml\n(.*?)```", text, re.DOTALL) if "\nsteps:" in block]
    (folder / "spec.yaml").write_text(spec)
    environ = {**os.environ, "ROBOMAKER_HOME": str(home), "PREFECT_API_URL": server, "CI": "true"}
    command = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main", "run", "spec.yaml", "-o", "json"]
    ended = subprocess.run(command, cwd=folder, env=environ, capture_output=True, text=True, check=False, timeout=120)
    assert ended.returncode == 0, ended.stderr
    return json.loads(ended.stdout), [json.loads(each.read_text()) for each in sorted(home.rglob("result.json"))]


@pytest.mark.deep
def test_the_example_of_requirements_meets_all_of_them(home: Path, prefect_server: str, tmp_path: Path) -> None:
    record, results = run_example("verdicts", tmp_path, home, prefect_server)
    assert [job["verdict"] for job in record["jobs"]] == ["PASS"] * 4
    for result in results:
        judged = {each["name"]: each["satisfied"] for each in result["requirements"] if each["counts"]}
        assert judged == dict.fromkeys(("at-home", "to-bed", "gentle", "polite", "quick"), True)
        assert result["ended_by"] == "requirements"
        assert result["sim_time_s"] > 2, "the bedroom is a way off"


@pytest.mark.deep
def test_the_example_of_trials_has_a_row_for_each(home: Path, prefect_server: str, tmp_path: Path) -> None:
    record, results = run_example("trials", tmp_path, home, prefect_server)
    assert [job["verdict"] for job in record["jobs"]] == ["PASS"]
    [table] = home.rglob("trials.parquet")
    rows = pq.read_table(table).to_pylist()
    assert [row["verdict"] for row in rows] == ["PASS"] * 20
    assert [row["seed"] for row in rows] == 2 * list(range(10))
    assert [row["parameter.ROBOMAKER_SIM_TIME_LIMIT_S"] for row in rows] == ["120"] * 10 + ["240"] * 10
    assert [row["trial"] for row in rows if row["recorded"]] == [0]
    # A longer limit changes nothing for those that are faster.
    digests = [row["state_digest"] for row in rows]
    assert digests[:10] == digests[10:]
    assert len(set(digests)) == 10
    verified = subprocess.run(
        [sys.executable, "-m", "prefect_robomaker.deployments.cli.main", "verify", record["jobs"][0]["arn"],
         "--trial", "5"],
        env={**os.environ, "ROBOMAKER_HOME": str(home)}, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert verified.stdout.startswith("bit-identical: "), verified
    assert len(results) == 2, "the job's, and that of the trial that was recorded"


@pytest.mark.deep
def test_the_example_of_videos_is_filmed(home: Path, prefect_server: str, tmp_path: Path) -> None:
    record, _ = run_example("videos", tmp_path, home, prefect_server)
    assert record["jobs"][0]["remarks"] == []
    [film] = home.rglob("video.mp4")
    assert film.stat().st_size > 10_000
