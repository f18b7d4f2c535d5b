"""Nights of one specification, run for real: what the report, compare and history say when the robot gets worse."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from helpers.command_here import Command
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.reports.comparison import Comparison
from prefect_robomaker.schemas.reports.history import History
from prefect_robomaker.schemas.reports.run_record import RunRecord

BUNDLE = REPOSITORY / "deployments" / "specs" / "examples" / "cartpole_bundle"
SUITE = {"name": "General"}
SEEDS = (1, 2, 3, 4, 5, 6)
"""As many pairs as the exact test at 5 % needs at least."""

pytestmark = pytest.mark.deep


def spec() -> dict[str, Any]:
    requests = [
        {
            "maxJobDurationInSeconds": 60,
            "seed": seed,
            "robotApplications": [{"application": "agent", "launchConfig": {}}],
            "simulationApplications": [
                {"application": "arena", "launchConfig": {"environmentVariables": {"TIME_LIMIT_S": "2"}}}
            ],
        }
        for seed in SEEDS
    ]
    arena = {
        "name": "arena", "environment": {"uri": "python://my_cartpole.arena"}, "robotSoftwareSuite": SUITE,
        "simulationSoftwareSuite": {"name": "SimulationRuntime"},
    }  # fmt: skip
    agent = {"name": "agent", "environment": {"uri": "python://my_cartpole.agent"}, "robotSoftwareSuite": SUITE}
    balance = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": 2}}
    steps = {
        "arena": {"operation": "CreateSimulationApplication", "input": arena, "ifExists": "reuse"},
        "agent": {"operation": "CreateRobotApplication", "input": agent, "ifExists": "reuse"},
        "balance": {"operation": "StartSimulationJobBatch", "needs": ["arena", "agent"], "input": balance},
    }
    return {"version": 1, "name": "poles", "steps": steps}


def git(repository: Path, *words: str) -> str:
    named = ("-c", "user.name=Ann", "-c", "user.email=ann@example.org")
    ended = subprocess.run(["git", *named, *words], cwd=repository, capture_output=True, text=True, check=True)
    return ended.stdout.strip()


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A repository with a robot, an environment and a specification."""
    folder = tmp_path / "repository"
    shutil.copytree(BUNDLE, folder, ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "poles.yaml").write_text(json.dumps(spec()))
    git(folder, "init", "--quiet")
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "A robot that balances")
    return folder


@pytest.fixture
def robomaker(robomaker_at_server: Command, repository: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """Runs the command where the robot can be imported: by itself, and by the processes that it starts."""
    monkeypatch.setenv("PYTHONPATH", str(repository))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.syspath_prepend(str(repository))
    return robomaker_at_server


def test_two_nights_with_a_robot_that_gets_worse(robomaker: Command, repository: Path, tmp_path: Path) -> None:
    first = night(robomaker, repository, 0)
    page = text_of(first)
    assert "there is no earlier run to compare it with" in page

    agent = repository / "my_cartpole" / "agent.py"
    agent.write_text(agent.read_text().replace("/ 10.0", "/ -10.0"))
    git(repository, "commit", "--quiet", "--all", "--message", "Push the other way")
    second = night(robomaker, repository, 1)

    # What the records keep of either night.
    assert [job.verdict for job in (*first.jobs, *second.jobs)] == ["PASS"] * 6 + ["FAIL"] * 6
    assert first.source is not None
    assert second.source is not None
    assert second.source.commit == git(repository, "rev-parse", "HEAD") != first.source.commit
    assert not second.source.changed
    before, after = (record.jobs[0].inputs for record in (first, second))
    assert before is not None
    assert after is not None
    assert (before.seed, before.seed_given, before.world) == (1, True, None)
    assert before.request_sha256 == after.request_sha256
    digests = [{(used.role, used.name): used.digest for used in inputs.applications} for inputs in (before, after)]
    assert digests[0].keys() == digests[1].keys() == {("robot", "agent"), ("simulation", "arena")}
    assert digests[0]["robot", "agent"] != digests[1]["robot", "agent"]
    assert [item.name for item in second.jobs[0].requirements] == ["upright"]

    # The report of the second night opens with what changed.
    page = text_of(second)
    opening = page[page.index('<div id="since"') : page.index('id="failures-title"')]
    assert first.run_id in opening
    assert 'Newly failing <span class="count">6</span>' in opening
    assert '<a href="#job-1">balance: agent, seed=1</a>' in opening
    assert f"commit {first.source.commit[:8]} → {second.source.commit[:8]}" in opening
    assert f"application agent {digests[0]['robot', 'agent'][:8]} → " in opening

    compare_nights(robomaker, first.run_id, second.run_id)
    look_back(robomaker, first, second, tmp_path)


def night(robomaker: Command, repository: Path, code: int) -> RunRecord:
    ended = robomaker("run", repository / "poles.yaml", "-o", "json")
    assert ended.code == code, ended.err
    record = RunRecord.model_validate_json(ended.out)
    assert RunRecord.model_validate_json((record.run_dir / "run.json").read_text()) == record
    return record


def text_of(record: RunRecord) -> str:
    assert record.report_path is not None
    return record.report_path.read_text()


def compare_nights(robomaker: Command, first: str, second: str) -> None:
    worse = robomaker("compare", first, second)
    assert worse.code == 1, worse.err
    assert "how sure      6 pairs judged in both runs, p = 0.031 (exact McNemar test, alpha 0.05)" in worse.out
    assert "newly failing 6" in worse.out
    assert "largest angle: " in worse.out
    better = robomaker("compare", second, first, "-o", "json")
    assert better.code == 0, better.err
    comparison = Comparison.model_validate_json(better.out)
    assert (comparison.answer, len(comparison.newly_passing)) == ("better", 6)
    changed = {metric.name: metric for metric in comparison.metrics if metric.changed}
    assert changed["largest_angle_rad"].after < 0.1 < changed["largest_angle_rad"].before
    unsure = robomaker("compare", first, "latest", "--alpha", "0.01")
    assert unsure.code == 6, unsure.err
    assert "Too few pairs to tell" in unsure.out
    assert "more than there are" in unsure.out


def look_back(robomaker: Command, first: RunRecord, second: RunRecord, tmp_path: Path) -> None:
    told = robomaker("history", "poles", "-o", "json", "--to", tmp_path / "poles.html")
    assert told.code == 0, told.err
    history = History.model_validate_json(told.out)
    assert [each.run_id for each in history.nights] == [first.run_id, second.run_id]
    assert [each.success.rate for each in history.nights] == [1.0, 0.0]
    (start,) = {cell.since.run_id for cell in history.cells if cell.since}
    assert start == second.run_id
    assert {change.what for change in history.nights[1].changed} == {"commit", "application"}
    assert not any(cell.unsteady for cell in history.cells), "another robot is another robot"
    page = (tmp_path / "poles.html").read_text()
    assert f'href="home/runs/{second.run_id}/report.html"' in page
    words = robomaker("history", "poles")
    assert "newly failing 6" in words.out
    assert "changed then: commit" in words.out
