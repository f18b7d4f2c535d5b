"""The bytes that docs/robot-programs.md describes, and those that go over the socket."""

import re
import socket
import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from dm_env import specs
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.tasks.runtime.agents import agent_client, remote_robot
from prefect_robomaker.tasks.runtime.agents.agent_client import HEADER, json_message
from prefect_robomaker.tasks.runtime.agents.agent_protocol import RobotHello
from prefect_robomaker.tasks.runtime.agents.agent_socket import agent_socket_path
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

PAGE = (REPOSITORY / "docs" / "robot-programs.md").read_text()
MakePlan = Callable[..., RunPlan]


def block(name: str) -> str:
    """The fenced block below a comment with a name."""
    (text,) = re.findall(rf"^<!-- {name} -->\n```\w+\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    return text


def test_the_greeting_is_the_one_shown(make_plan: MakePlan) -> None:
    observed = {
        "camera": {"rgb": specs.BoundedArray((2, 20, 3), np.uint8, 0, 255), "label": specs.StringArray(())},
        "speed": specs.Array((2,), np.float64, name="speed: left, right rad/s"),
    }
    environment: Any = SimpleNamespace(
        observation_spec=lambda: observed,
        action_spec=lambda: specs.BoundedArray((2,), np.float64, [-1, -np.inf], [1, np.inf]),
    )
    shown = block("hello").replace("\n ", "\n").replace("\n ", "\n").replace("\n", "")
    greeting = remote_robot._greeting(make_plan(), "driver", 0.05, *remote_robot._layouts(environment))
    assert json_message(1, greeting)[8:].decode() == shown


def test_the_greeting_of_the_robot_has_the_members_shown() -> None:
    table = PAGE.partition("### HELLO of the robot")[2].partition("### OBSERVATION")[0]
    assert re.findall(r"^\| `(\w+)`", table, re.MULTILINE) == list(RobotHello.model_fields)


def test_all_types_are_listed() -> None:
    row = next(line for line in PAGE.splitlines() if line.startswith("| `dtype`"))
    assert set(re.findall(r"`(\w+)`", row)) - {"dtype"} == set(agent_client.ITEM_FORMATS)


def test_the_conversation_is_the_one_shown(launcher: Launcher, make_plan: MakePlan) -> None:
    plan = make_plan(robot_application=ApplicationPlan(role="robot", name="driver"))
    outcomes: list[Any] = []
    run = threading.Thread(target=lambda: outcomes.append(launcher.run(plan, lambda: None)))
    run.start()
    with connected(plan) as connection:
        for sender, data in conversation():
            if sender == "<":
                connection.sendall(data)
            elif data:
                assert receive(connection, len(data)).hex(" ") == data.hex(" ")
            else:
                length, kind = HEADER.unpack(receive(connection, HEADER.size))
                assert kind == agent_client.HELLO
                assert receive(connection, length).startswith(b'{"protocol":"robomaker-agent","version":1,')
        assert connection.recv(1000)[8:] == b'{"ended_by":"agent"}'
    run.join(120)
    assert outcomes[0].status == "Completed"


def conversation() -> list[tuple[str, bytes]]:
    """Who sends which bytes; none for the simulation's greeting, which has its own example."""
    turns: list[tuple[str, bytes]] = []
    for line in block("bytes").splitlines():
        head = re.match(r"([<> ])\s+((?:(?:[0-9a-f]{2}|\.\.) )*(?:[0-9a-f]{2})?)\s*(\{.*)?", line)
        assert head is not None, line
        sender, octets, text = head.groups()
        data = b"" if ".." in octets else bytes.fromhex(octets) + (text or "").encode()
        if sender == " ":
            turns[-1] = (turns[-1][0], turns[-1][1] + data)
        else:
            turns.append((sender, data))
    return turns


def connected(plan: RunPlan) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX)
    connection.settimeout(120)
    deadline = time.monotonic() + 120
    while True:
        try:
            connection.connect(str(agent_socket_path(plan)))
            return connection
        except OSError:
            assert time.monotonic() < deadline
            time.sleep(0.02)


def receive(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        data += connection.recv(count - len(data))
    return data
