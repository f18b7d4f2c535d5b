"""The agent is killed at random moments of a deployment: the right version runs in the end, and the order ends once."""

import random
import time
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.agent_robot import Rover, rover
from helpers.processes import wait_for

from prefect_robomaker.tasks.fleet.ddi.feedback import Feedback

from .conftest import deploy

ROUNDS = 25
LONG = 500
"""Rounds of the test that is run by hand."""

SLOWEST_S = 3.0
"""Moments are drawn from this time after the order, which is longer than a deployment takes."""


def ends_of(robot: Rover, number: int) -> list[Feedback]:
    return [replace(report.feedback, details=()) for report in robot.server.ends(number)]


def kill_once(robot: Rover, number: int, chance: random.Random) -> None:
    """Orders version `number`, bad or good, and kills the agent meanwhile; what it started lives on or does not."""
    is_bad = chance.random() < 0.3
    good = robot.agent.journal["good"]["version"]
    robot.server.cut_after = chance.choice([None, 20_000])
    launch = {"postLaunchFile": "after"}
    files = {"after": "sleep 0.2", "map": chance.randbytes(100_000)}
    deploy(robot, number, "#!/bin/sh\nsleep 0.1\nexit 1\n" if is_bad else None, launch=launch, files=files)
    time.sleep(chance.uniform(0, SLOWEST_S))
    kill = robot.agent.kill if chance.random() < 0.5 else robot.agent.kill_alone
    kill()
    expected = good if is_bad else str(number)
    (robot.folder / "running").unlink(missing_ok=True)
    robot.agent.start()

    robot.server.wait_for_end(number)
    wait_for(lambda: robot.running == expected, f"version {expected} after order {number}")
    wait_for(lambda: robot.agent.journal["phase"] == "idle" and robot.agent.journal["end"]["is_delivered"], "idle")
    found = robot.agent.journal
    assert found["good"]["version"] == expected, robot.agent.log
    link = (robot.agent.home / "current").readlink()
    assert link.name.startswith(f"{expected}-")
    assert (robot.agent.home / link / "drive").is_file()
    ends = ends_of(robot, number)
    assert [end.finished for end in ends] == ["failure" if is_bad else "success"], "it ended once"


def kill_often(folder: Path, rounds: int, seed: int) -> None:
    chance = random.Random(seed)
    with rover(folder) as robot:
        deploy(robot, 1)
        robot.agent.start()
        assert robot.server.wait_for_end(1).feedback.finished == "success", robot.agent.log
        for number in range(2, rounds + 2):
            kill_once(robot, number, chance)


@pytest.mark.deep
@pytest.mark.timeout(1800)
def test_an_agent_killed_at_random_moments_installs_what_it_should(tmp_path: Path) -> None:
    kill_often(tmp_path, ROUNDS, seed=14)


@pytest.mark.endurance
@pytest.mark.timeout(7200)
def test_an_agent_killed_at_500_random_moments_installs_what_it_should(tmp_path: Path) -> None:
    kill_often(tmp_path, LONG, seed=500)
