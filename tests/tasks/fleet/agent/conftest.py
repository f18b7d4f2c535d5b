"""Robots with an agent of their own."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from helpers.agent_robot import Rover, rover


@pytest.fixture
def make_robot(tmp_path: Path) -> Iterator[Callable[..., Rover]]:
    """Makes a robot that is enrolled; its agent is not started. Keyword arguments are the agent's."""
    with ExitStack() as stack:
        yield lambda **members: stack.enter_context(rover(tmp_path, **members))


@pytest.fixture
def robot(make_robot: Callable[..., Rover]) -> Rover:
    """A robot that is enrolled; its agent is not started."""
    return make_robot()


@pytest.fixture
def driving(robot: Rover) -> Rover:
    """A robot whose agent runs version 1, which came with order 1."""
    deploy(robot, 1)
    robot.agent.start()
    assert robot.server.wait_for_end(1).feedback.finished == "success", robot.agent.log
    return robot


def deploy(robot: Rover, number: int, program: str | None = None, **members: Any) -> None:
    """Orders a version whose program is `drive`; by itself one that runs on."""
    from helpers.tuf_repository import bundle

    files = {"drive": robot.program(str(number)) if program is None else program, **members.pop("files", {})}
    packed = members.pop("packed", None) or bundle(files)
    target = robot.server.repository.add_deployment(f"job-{number}", packed, version=str(number), **members)
    robot.server.offer(number, target, Color="red")
