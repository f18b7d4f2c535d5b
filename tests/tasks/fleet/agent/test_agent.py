"""An agent in a process of its own, at a real door: from an order to an application that runs."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.agent_robot import Rover, rover
from helpers.processes import wait_for
from helpers.tuf_repository import bundle


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Rover]:
    """A robot that is enrolled; its agent is not started."""
    with rover(tmp_path) as made:
        yield made


def test_an_order_is_installed_and_runs(robot: Rover) -> None:
    target = robot.server.repository.add_deployment("job-1", bundle({"drive": robot.program("1")}))
    robot.server.offer(1, target, Color="red")
    robot.agent.start()
    end = robot.server.wait_for_end(1)

    assert end.feedback.finished == "success", robot.agent.log
    assert robot.running == "1"
