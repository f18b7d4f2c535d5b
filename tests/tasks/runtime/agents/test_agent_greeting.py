"""Who connects first and says nothing keeps no robot out."""

import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from helpers.remote_jobs import greeting
from helpers.stop_flags import StopFlag

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.tasks.runtime.agents.agent_client import HELLO, json_message
from prefect_robomaker.tasks.runtime.agents.agent_greeting import Greeter
from prefect_robomaker.tasks.runtime.agents.agent_socket import AgentSocket

HURRY = 20
"""How much faster than the wall's the clock is: its patience of 5 s is a quarter of a second."""


@pytest.fixture
def listening(make_plan: Callable[..., RunPlan], tmp_path: Path) -> Iterator[AgentSocket]:
    listening = AgentSocket(make_plan(work_dir=tmp_path))
    yield listening
    listening.close()


@contextmanager
def greeted(listening: AgentSocket, timeout_s: float) -> Iterator["Future[Any]"]:
    greeter = Greeter(listening, "driver", StopFlag(), lambda: HURRY * time.monotonic())
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(greeter.greet, json_message(HELLO, {}), timeout_s)


@contextmanager
def connected(listening: AgentSocket, says: bytes = b"") -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(60)
        connection.connect(str(listening.path))
        connection.sendall(says)
        yield connection


def test_who_says_nothing_is_given_up_for_the_next(listening: AgentSocket) -> None:
    with greeted(listening, 1000) as answer, connected(listening) as mute, connected(listening) as mute_too:
        time.sleep(0.1)
        with connected(listening, greeting(mode="free")):
            link, hello = answer.result(60)
        assert hello.mode == "free"
        link.close()
        for connection in (mute, mute_too):
            said = b"".join(iter(lambda: connection.recv(1000), b""))  # noqa: B023 - read at once
            assert b"no greeting came within 5 s, and another program has connected" in said


def test_a_robot_that_is_alone_may_take_its_time(listening: AgentSocket) -> None:
    with greeted(listening, 1000) as answer, connected(listening) as slow:
        time.sleep(0.4)
        slow.sendall(greeting(mode="lockstep"))
        link, _ = answer.result(60)
        link.close()
