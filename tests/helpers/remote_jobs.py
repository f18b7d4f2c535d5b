"""Runs whose robot is a program that connects, for tests that speak the agent protocol."""

import json
import socket
import struct
import threading
import time
from contextlib import suppress
from typing import Any

from prefect_robomaker.schemas.runs.plan import RunOutcome, RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import RunStop
from prefect_robomaker.tasks.runtime.agents.agent_client import HELLO, Simulation, connect, json_message
from prefect_robomaker.tasks.runtime.agents.agent_socket import agent_socket_path
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

ARENA = "trouble.unusual_arena.{}"


class Job:
    """A run whose robot is a program that connects."""

    def __init__(self, launcher: Launcher, plan: RunPlan) -> None:
        self.plan = plan
        self.path = agent_socket_path(plan)
        self.cancel = False
        self._outcome: RunOutcome | None = None
        self._thread = threading.Thread(target=self._carry_out, args=[launcher])
        self._thread.start()

    def _carry_out(self, launcher: Launcher) -> None:
        self._outcome = launcher.run(self.plan, lambda: RunStop.CANCELED if self.cancel else None)

    def connect(self, **options: Any) -> Simulation:
        return connect(str(self.path), **options)

    def raw(self) -> socket.socket:
        """A connection that says nothing by itself."""
        connection = socket.socket(socket.AF_UNIX)
        connection.settimeout(120)
        deadline = time.monotonic() + 120
        while True:
            try:
                connection.connect(str(self.path))
                return connection
            except OSError:
                assert time.monotonic() < deadline
                time.sleep(0.02)

    def outcome(self) -> RunOutcome:
        self._thread.join(150)
        assert self._outcome is not None, "the run has not ended"
        return self._outcome

    def result(self) -> RunResult:
        assert self.outcome().status == "Completed", self.outcome().failure_reason
        return RunResult.model_validate_json((self.plan.output_dir / "result.json").read_bytes())

    def assert_failed(self, code: str, *texts: str) -> None:
        outcome = self.outcome()
        assert (outcome.status, outcome.failure_code) == ("Failed", code), outcome
        for text in ("driver", *texts):
            assert text in (outcome.failure_reason or "")


def greeting(**members: Any) -> bytes:
    return json_message(HELLO, {"version": 1, **members})


def action(number: int, value: float) -> bytes:
    return struct.pack("<IIQd", 16, 3, number, value)


def last_words(connection: socket.socket) -> str:
    """What the simulation said before it closed the connection."""
    kind, content, received = 0, b"", b""
    with suppress(ConnectionResetError):
        while data := connection.recv(65536):
            received += data
    while received:
        length, kind = struct.unpack_from("<II", received)
        content, received = received[8 : 8 + length], received[8 + length :]
    assert kind == 5
    return json.loads(content)["error"]
