"""The agent is killed at random moments of a deployment: the right version runs in the end, and the order ends once.

All 500 moments take an hour, or some of them less: `ROBOMAKER_AGENT_KILLS=209-354 pytest -n 0 -m endurance -s FILE`.
"""

import os
import random
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import pytest
from helpers.agent_robot import Rover, rover
from helpers.processes import wait_for

from prefect_robomaker.tasks.fleet.ddi.received_reports import Feedback

from .conftest import deploy

SLOWEST_S = 3.0
"""Moments are drawn from this time after the order, which is longer than a deployment takes."""


def ends_of(robot: Rover, number: int) -> list[Feedback]:
    return [replace(report.feedback, details=()) for report in robot.server.ends(number)]


@dataclass(frozen=True)
class Kill:
    """When an agent is killed, and what it is doing."""

    is_bad: bool
    cut_after: int | None
    map: bytes
    after_s: float
    kills_all: bool
    """Also what the agent started."""


def kills(seed: int) -> Iterator[Kill]:
    """Random ones without end; always the same of a seed."""
    chance = random.Random(seed)
    while True:
        yield Kill(
            is_bad=chance.random() < 0.3,
            cut_after=chance.choice([None, 20_000]),
            map=chance.randbytes(100_000),
            after_s=chance.uniform(0, SLOWEST_S),
            kills_all=chance.random() < 0.5,
        )


def kill_once(robot: Rover, number: int, kill: Kill) -> None:
    """Orders version `number`, bad or good, and kills the agent meanwhile; what it started lives on or does not."""
    good = robot.agent.journal["good"]["version"]
    robot.server.cut_after = kill.cut_after
    launch = {"postLaunchFile": "after"}
    files = {"after": "sleep 0.2", "map": kill.map}
    deploy(robot, number, "#!/bin/sh\nsleep 0.1\nexit 1\n" if kill.is_bad else None, launch=launch, files=files)
    time.sleep(kill.after_s)
    if kill.kills_all:
        robot.agent.kill()
    else:
        robot.agent.kill_alone()
    expected = good if kill.is_bad else str(number)
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
    assert [end.finished for end in ends] == ["failure" if kill.is_bad else "success"], "it ended once"


def kill_often(folder: Path, seed: int, first: int, last: int) -> None:
    with rover(folder) as robot:
        deploy(robot, 1)
        robot.agent.start()
        assert robot.server.wait_for_end(1).feedback.finished == "success", robot.agent.log
        for number, kill in enumerate(islice(kills(seed), first - 1, last), first):
            print(f"seed {seed}, kill {number}", flush=True)
            kill_once(robot, number + 1, kill)


@pytest.mark.deep
@pytest.mark.timeout(1800)
def test_an_agent_killed_at_random_moments_installs_what_it_should(tmp_path: Path) -> None:
    kill_often(tmp_path, seed=14, first=1, last=6)


@pytest.mark.endurance
@pytest.mark.timeout(7200)
def test_an_agent_killed_at_500_random_moments_installs_what_it_should(tmp_path: Path) -> None:
    first, last = (int(word) for word in os.environ.get("ROBOMAKER_AGENT_KILLS", "1-500").split("-"))
    kill_often(tmp_path, seed=500, first=first, last=last)
