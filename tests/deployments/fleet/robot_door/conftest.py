"""The door without a server in between."""

import asyncio
import json
import threading
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest
import uvicorn
from helpers.processes import wait_for
from helpers.robot_orders import TOKEN, table_of_robots

from prefect_robomaker.deployments.fleet.robot_door.agents import AgentSide
from prefect_robomaker.deployments.fleet.robot_door.door import DoorSettings, RobotDoor
from prefect_robomaker.tasks.fleet.ddi.orders import RobotOrder
from prefect_robomaker.tasks.fleet.ddi.received_reports import RobotReport

BASE = "/DEFAULT/controller/v1/robot1"
NOW = 1_700_000_000.0


@dataclass(frozen=True)
class Answer:
    """What the door answered."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        """The body as JSON."""
        return json.loads(self.body)

    @property
    def links(self) -> dict[str, str]:
        """The paths that a base leads to."""
        return {name: link["href"].removeprefix("http://door:80") for name, link in self.json["_links"].items()}


@dataclass
class Robots:
    """Robots that ask a door; `robot1` is let in."""

    settings: DoorSettings = field(default_factory=DoorSettings)
    chance: float = 0.5
    content: bytes = b""
    """Of every file."""

    agents: AgentSide | None = None
    """What is asked about agents."""

    heard: list[RobotReport] = field(default_factory=list)
    """What the sink was told."""

    sink_error: Exception | None = None
    """What the sink raises."""

    def __post_init__(self) -> None:
        self.orders = table_of_robots()
        self.door = RobotDoor(
            self.orders,
            read_part=self.read,
            sink=self._hear,
            clock=lambda: NOW,
            chance=lambda: self.chance,
            settings=self.settings,
            agents=self.agents,
        )
        self.runner = asyncio.Runner()

    def read(self, order: RobotOrder, start: int, length: int) -> bytes:
        """Reads `content`."""
        return self.content[start : start + length]

    def _hear(self, report: RobotReport) -> None:
        if self.sink_error is not None:
            raise self.sink_error
        self.heard.append(report)

    def ask(self, method: str, path: str, body: bytes | list[bytes] = b"", /, **headers: str) -> Answer:
        """Sends a request with the robot's token; keyword arguments are headers, an empty one takes a header away."""
        parts = [body] if isinstance(body, bytes) else list(body)

        async def receive() -> dict[str, Any]:
            if not parts:
                await asyncio.sleep(3600)
            part = parts.pop(0)
            return {"type": "http.request", "body": part, "more_body": bool(parts)}

        start, *content = self.send(method, path, receive, headers)
        answer = b"".join(each.get("body", b"") for each in content)
        assert [each.get("more_body", False) for each in content] == [True] * (len(content) - 1) + [False]
        names = {name.decode(): value.decode() for name, value in start["headers"]}
        assert int(names["content-length"]) == len(answer) or method == "HEAD"
        return Answer(start["status"], names, answer)

    def say(self, path: str, execution: str = "proceeding", finished: str = "none", **status: Any) -> Answer:
        """Sends a feedback."""
        content = {"status": {"execution": execution, "result": {"finished": finished}, **status}}
        return self.ask("POST", f"{path}/feedback", json.dumps(content).encode())

    def poll(self) -> Answer:
        """Polls."""
        return self.ask("GET", BASE)

    def close(self) -> None:
        """Ends the door."""
        self.runner.run(self.door.close())
        self.runner.close()

    def send(
        self, method: str, path: str, receive: Callable[[], Awaitable[Any]], headers: Mapping[str, str] | None = None
    ) -> list[Any]:
        """Sends a request whose body comes from `receive`; returns the messages of the answer."""
        headers = {"host": "door:80", "authorization": f"TargetToken {TOKEN}", **(headers or {})}
        scope = {
            "type": "http",
            "scheme": "http",
            "method": method,
            "path": path,
            "headers": [(k.replace("_", "-").encode(), v.encode("latin-1")) for k, v in headers.items() if v],
        }
        sent: list[Any] = []

        async def send(message: Any) -> None:
            await asyncio.sleep(0)
            sent.append(message)

        self.runner.run(self.door(scope, receive, send))
        return sent


@contextmanager
def server(door: RobotDoor) -> Iterator[int]:
    """The port where uvicorn serves a door."""
    config = uvicorn.Config(door, port=0, http="h11", ws="none", log_config=None, access_log=False)
    running = uvicorn.Server(config)
    thread = threading.Thread(target=running.run)
    thread.start()
    try:
        wait_for(lambda: running.started, "the server")
        yield running.servers[0].sockets[0].getsockname()[1]
    finally:
        running.should_exit = True
        thread.join(200)


@pytest.fixture
def make_robots() -> Iterator[Callable[..., Robots]]:
    """Makes robots and their door."""
    made: list[Robots] = []

    def make(**members: Any) -> Robots:
        made.append(Robots(**members))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def robots(make_robots: Callable[..., Robots]) -> Robots:
    """Robots and their door."""
    return make_robots()
