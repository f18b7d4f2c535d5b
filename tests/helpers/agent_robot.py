"""A real agent in a process of its own, and a real door with a repository beside it."""

import asyncio
import hashlib
import json
import os
import random
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import uvicorn

from helpers.processes import descendants, wait_for
from helpers.robot_orders import robot_order
from helpers.tuf_repository import TufRepository
from prefect_robomaker.deployments.fleet.robot_door.door import DoorSettings, RobotDoor
from prefect_robomaker.deployments.fleet.robot_door.downloads import part_of
from prefect_robomaker.tasks.fleet.ddi.open_orders import OpenOrders
from prefect_robomaker.tasks.fleet.ddi.received_reports import CancelFeedback, OrderEnd, OrderFeedback, RobotReport

AGENT = "prefect_robomaker.tasks.fleet.agent"
ROBOT = "rover"
ENROLMENT_TOKEN = "e" * 40
_REPOSITORY = re.compile(rf"/DEFAULT/controller/v1/{ROBOT}/repository/((?:metadata|targets)/.*)")
_ORDER = re.compile(rf"/DEFAULT/controller/v1/{ROBOT}/deploymentBase/\d+")
_CHUNK_BYTES = 64 * 1024


@dataclass
class FleetServer:
    """The door for robots, with enrolment and repository; an ASGI application."""

    repository: TufRepository
    heard: list[RobotReport] = field(default_factory=list)
    metadata: dict[int, list[dict[str, str]]] = field(default_factory=dict)
    """Metadata of the chunk of each order."""

    statuses: dict[str, int] = field(default_factory=dict)
    """Paths of the repository that are answered with an error, by their ends."""

    cut_after: int | None = None
    """The next target that is longer is cut after so many bytes; once."""

    sent: dict[str, int] = field(default_factory=dict)
    """Bytes sent of each target."""

    starts: dict[str, list[int]] = field(default_factory=dict)
    """Where each request for a target began."""

    target_delay_s: float = 0.0
    """Before each 64 KiB of a target."""

    lost_enrolments: int = 0
    """Answers to enrolments that get lost."""

    enrolled_with: bytes | None = None
    is_away: bool = False
    """Every request is answered with 503."""

    def __post_init__(self) -> None:
        self.orders = OpenOrders()
        self.door = RobotDoor(
            self.orders,
            read_part=lambda order, start, length: bytes(length),
            sink=self.heard.append,
            clock=time.time,
            chance=random.random,
            settings=DoorSettings(idle_sleep_s=1),
        )

    def offer(self, action_id: int, target: str, **tags: str) -> None:
        """Gives the robot an order."""
        entries = [{"key": "robomaker.target", "value": target}]
        if tags:
            entries.append({"key": "robomaker.tags", "value": json.dumps(tags)})
        self.metadata[action_id] = entries
        self.orders.offer(robot_order(robot=ROBOT, action_id=action_id))

    def ends(self, action_id: int) -> list[OrderFeedback | CancelFeedback]:
        """The reports that ended an order."""
        return [report for report in self.reports(action_id) if _end(report) is not None]

    def reports(self, action_id: int) -> list[OrderFeedback | CancelFeedback]:
        """What the robot said of an order."""
        said = [report for report in self.heard if isinstance(report, (OrderFeedback, CancelFeedback))]
        return [report for report in said if report.feedback.action_id == action_id]

    def wait_for_end(self, action_id: int) -> OrderFeedback | CancelFeedback:
        """Waits until the robot has ended an order and another may be offered; returns how."""
        what = f"the end of order {action_id}"
        wait_for(lambda: self.ends(action_id) and not self.orders.state(ROBOT).has(action_id), what)
        return self.ends(action_id)[-1]

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Answers one request."""
        path = scope.get("path", "")
        if scope["type"] == "http" and self.is_away:
            await _answer(send, 503, b"")
        elif scope["type"] == "http" and path == f"/DEFAULT/agents/v1/{ROBOT}/enrolment":
            await self._enrol(scope, receive, send)
        elif scope["type"] == "http" and (found := _REPOSITORY.fullmatch(path)):
            await self._file(scope, found[1], send)
        elif scope["type"] == "http" and scope["method"] == "GET" and _ORDER.fullmatch(path):
            await self._order(scope, receive, send)
        else:
            await self.door(scope, receive, send)

    async def _enrol(self, scope: Any, receive: Any, send: Any) -> None:
        body = (await receive())["body"]
        is_right = dict(scope["headers"])[b"authorization"] == f"EnrolmentToken {ENROLMENT_TOKEN}".encode()
        if not is_right or self.enrolled_with not in (None, body):
            await _answer(send, 401, b"{}")
            return
        self.enrolled_with = body
        self.orders.enrol(ROBOT, bytes.fromhex(json.loads(body)["tokenSha256"]))
        if self.lost_enrolments:
            self.lost_enrolments -= 1
            await _answer(send, 502, b"")
            return
        await _answer(send, 200, json.dumps({"root": self.repository.first_root.decode()}).encode())

    async def _file(self, scope: Any, path: str, send: Any) -> None:
        file = self.repository.folder / path
        status = next((code for end, code in self.statuses.items() if path.endswith(end)), None)
        if status is not None or not file.is_file():
            await _answer(send, status or 404, b"")
            return
        content = file.read_bytes()
        part = part_of(len(content), b"", dict(scope["headers"]).get(b"range"), None)
        self.starts.setdefault(path, []).append(part.start)
        headers = [(b"content-length", b"%d" % (part.stop - part.start))]
        await send({"type": "http.response.start", "status": 200 if part.is_whole else 206, "headers": headers})
        stop = part.stop
        if path.startswith("targets/") and self.cut_after is not None and stop - part.start > self.cut_after:
            stop, self.cut_after = part.start + self.cut_after, None
        for start in range(part.start, stop, _CHUNK_BYTES):
            if path.startswith("targets/"):
                await asyncio.sleep(self.target_delay_s)
            chunk = content[start : min(stop, start + _CHUNK_BYTES)]
            self.sent[path] = self.sent.get(path, 0) + len(chunk)
            await send({"type": "http.response.body", "body": chunk, "more_body": True})
        if stop < part.stop:
            raise ConnectionError("cut")
        await send({"type": "http.response.body", "body": b""})

    async def _order(self, scope: Any, receive: Any, send: Any) -> None:
        messages: list[Any] = []

        async def keep(message: Any) -> None:
            messages.append(message)

        await self.door(scope, receive, keep)
        document = json.loads(messages[1]["body"])
        if "deployment" in document:
            document["deployment"]["chunks"][0]["metadata"] = self.metadata[int(document["id"])]
        await _answer(send, messages[0]["status"], json.dumps(document).encode())


def _end(report: OrderFeedback | CancelFeedback) -> OrderEnd | None:
    feedback = report.feedback
    return feedback.cancel_end if isinstance(report, CancelFeedback) else feedback.order_end


async def _answer(send: Any, status: int, body: bytes) -> None:
    headers = [(b"content-length", b"%d" % len(body))]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


@contextmanager
def serving(application: Any, port: int = 0) -> Iterator[str]:
    """The address where uvicorn serves an application."""
    config = uvicorn.Config(application, port=port, http="h11", ws="none", log_config=None, access_log=False)
    running = uvicorn.Server(config)
    thread = threading.Thread(target=running.run)
    thread.start()
    try:
        wait_for(lambda: running.started, "the server")
        yield f"http://127.0.0.1:{running.servers[0].sockets[0].getsockname()[1]}"
    finally:
        running.should_exit = True
        thread.join(200)


@dataclass
class AgentProcess:
    """An agent whose home is a folder; started and killed at will."""

    home: Path
    options: tuple[str, ...] = ("--health-s", "0.3", "--stop-s", "2", "--longest-wait-s", "1", "--sandbox", "none")
    environ: Mapping[str, str] = field(default_factory=dict)
    process: "subprocess.Popen[bytes] | None" = None
    module: str = AGENT
    command: tuple[str, ...] = (sys.executable,)

    @property
    def log(self) -> str:
        """What it has logged."""
        return self.home.with_suffix(".log").read_text()

    @property
    def journal(self) -> Any:
        """What its journal has."""
        return json.loads((self.home / "journal.json").read_bytes())

    def words(self, name: str, *more: str) -> list[str]:
        """The words of a command of the agent."""
        return [*self.command, "-m", self.module, name, "--home", str(self.home), *more]

    def enroll(self, url: str, root: bytes) -> "subprocess.CompletedProcess[str]":
        """Enrols the robot."""
        token = f"{ENROLMENT_TOKEN}-{hashlib.sha256(root).hexdigest()}"
        words = self.words("enroll", "--url", url, "--name", ROBOT, token)
        return subprocess.run(words, capture_output=True, text=True, env={**os.environ, **self.environ})

    def start(self) -> None:
        """Starts it."""
        with self.home.with_suffix(".log").open("ab") as log:
            self.process = subprocess.Popen(
                self.words("run", *self.options),
                env={**os.environ, **self.environ},
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def kill(self) -> None:
        """Kills it and its children as a power loss would, the application too."""
        assert self.process is not None
        for pid in [self.process.pid, *descendants(self.process.pid)]:
            try:
                os.kill(pid, 9)
            except ProcessLookupError:
                continue
        self.process.wait()
        self.process = None

    def kill_alone(self) -> None:
        """Kills it; what it has started runs on."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()
        self.process = None

    def stop(self) -> int:
        """Ends it as systemd does; returns the exit code."""
        assert self.process is not None
        self.process.terminate()
        code = self.process.wait(200)
        self.process = None
        return code


@dataclass
class Rover:
    """A server with a repository, and the agent of one robot."""

    server: FleetServer
    agent: AgentProcess
    url: str
    folder: Path

    def program(self, version: str) -> str:
        """A program that says which version runs, and runs on."""
        return f"#!/bin/sh\necho {version} > {self.folder}/running\nexec sleep 1000\n"

    @property
    def running(self) -> str | None:
        """Which version said that it runs."""
        path = self.folder / "running"
        return path.read_text().strip() if path.exists() else None


@contextmanager
def rover(folder: Path, home: "Path | None" = None, **members: Any) -> Iterator[Rover]:
    """A robot that is enrolled; its agent is not started."""
    server = FleetServer(TufRepository(folder / "repository"))
    agent = AgentProcess(home or folder / "home", **members)
    with serving(server) as url:
        enrolled = agent.enroll(url, server.repository.first_root)
        assert enrolled.returncode == 0, enrolled.stderr
        try:
            yield Rover(server, agent, url, folder)
        finally:
            if agent.process is not None:
                agent.stop()
