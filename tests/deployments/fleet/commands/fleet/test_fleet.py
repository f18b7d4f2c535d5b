"""fleet status, fleet watch, fleet report."""

import json
from pathlib import Path

import pytest
from helpers.deployed_robots import Behaviour, Yard, bad, deployable, good

from prefect_robomaker.deployments.fleet.commands.fleet import watch
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def yard(home: Path) -> Yard:
    return Yard(Service.open(Settings.from_environment({"ROBOMAKER_HOME": str(home)})))


def deploy(yard: Yard, *robots: Behaviour) -> str:
    for number, behaviour in enumerate(robots):
        yard.robot(f"r{number}", behaviour)
    return yard.fleets.deploy(yard.arn, deployable(yard.fleets, "X86_64"))["arn"]


def test_there_may_be_no_fleets(robomaker) -> None:
    assert robomaker("fleet", "status").out == "There are no fleets; CreateFleet makes one.\n"
    assert json.loads(robomaker("fleet", "status", "-o", "json").out) == {"schema_version": 1, "fleets": []}
    assert robomaker("fleet", "watch").code == 2


def test_the_status_of_fleets(robomaker, yard: Yard) -> None:
    job = deploy(yard, good, good, good, good, good, bad)
    yard.run(job)
    yard.fleets.fleet("dock")

    said = robomaker("fleet", "status")
    assert (said.code, said.err) == (0, "")
    assert said.out.splitlines()[:3] == ["dock: 0 robots", "no deployment yet", ""]
    assert said.out.splitlines()[3:7] == [
        "yard: 6 robots",
        f"mine 1: Succeeded  {job.rpartition('/')[2]}",
        "5 succeeded, 1 failed; 16.7 % failed, threshold 20 %",
        "robot  status  version  seen",
    ]
    assert said.out.endswith("r5: PreLaunchFileFailure: no arm\n")

    (shown,) = json.loads(robomaker("fleet", "status", "yard", "-o", "json").out)["fleets"]
    assert shown["deployment"]["counts"] == {"succeeded": 5, "failed": 1}
    assert [robot["status"] for robot in shown["robots"]] == ["InSync"] * 5 + ["Failed"]
    refused = robomaker("fleet", "status", "none")
    assert (refused.code, "there is no fleet named 'none'" in refused.err) == (2, True)


@pytest.mark.parametrize(("robot", "code", "end"), [(good, 0, "Succeeded"), (bad, 3, "Failed")])
def test_watching_ends_as_the_deployment_does(
    robomaker, yard: Yard, monkeypatch: pytest.MonkeyPatch, robot: Behaviour, code: int, end: str
) -> None:
    job = deploy(yard, robot, robot)
    monkeypatch.setattr(watch.time, "sleep", lambda _: yard.run(job))

    said = robomaker("fleet", "watch")

    assert (said.code, said.err) == (code, "")
    lines = [line.partition("] ")[2] for line in said.out.splitlines()]
    assert lines[0] == f"mine 1 to yard: {job.rpartition('/')[2]}"
    assert lines[-1].partition(":")[0] == end
    assert robomaker("fleet", "watch", "yard").code == robomaker("fleet", "watch", job).code == code


def test_watching_a_canceled_one_says_so(robomaker, yard: Yard) -> None:
    job = deploy(yard, good)
    yard.fleets.cancel(job)

    assert robomaker("fleet", "watch", job).code == 4


def test_the_report_is_written_where_it_is_wanted(robomaker, yard: Yard, home: Path, tmp_path: Path) -> None:
    job = deploy(yard, good)
    out = tmp_path / "rollout.html"

    said = robomaker("fleet", "report", job, "--out", out, "--no-open")
    assert (said.code, said.out) == (0, f"{out}\n")
    assert "mine 1 to yard" in out.read_text()
    yard.run(job)
    usual = robomaker("fleet", "report", "yard")
    assert Path(usual.out.strip()) == home / "deployments" / f"{job.rpartition('/')[2]}.html"
    assert "1 of 1 robot in sync" in Path(usual.out.strip()).read_text()
    nowhere = robomaker("fleet", "report", job, "--out", tmp_path / "none" / "x.html")
    assert (nowhere.code, "--out" in nowhere.err) == (2, True)
