"""The door for robots in a process of its own, or a bare ASGI handler, and polls that each need a new connection."""

import os
import random
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from helpers.paths import TESTS
from helpers.processes import started
from helpers.robot_orders import TOKEN, robot_order, table_of_robots

ROBOTS = 10_000
ORDERS = 1_000
"""How many robots have an order open."""

POLL = (
    "GET /DEFAULT/controller/v1/{robot} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
    f"Authorization: TargetToken {TOKEN}\r\nAccept: application/hal+json\r\nConnection: close\r\n\r\n"
)


@dataclass(frozen=True)
class DoorServer:
    """A server in a process."""

    pid: int
    port: int

    def cpu_s(self) -> float:
        """Processor time that it has used."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def poll(self, robot: str) -> bytes:
        """Polls on a new connection; returns the answer."""
        with socket.create_connection(("127.0.0.1", self.port)) as connection:
            connection.sendall(POLL.format(robot=robot, port=self.port).encode())
            answer = b""
            while part := connection.recv(65536):
                answer += part
        assert answer.startswith(b"HTTP/1.1 200"), answer
        return answer


@contextmanager
def door_server(log: Path, *, bare: bool = False) -> Iterator[DoorServer]:
    """Starts a door with `ROBOTS` robots; `bare`: a handler that always sends the same answer to a poll."""
    command = [sys.executable, "-m", "helpers.robot_door_server", *(["bare"] if bare else [])]
    path = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
    with (
        log.open("w") as errors,
        started(command, {"PYTHONPATH": path}, stdout=subprocess.PIPE, stderr=errors) as server,
    ):
        assert server.stdout is not None
        first = server.stdout.readline()
        assert first, log.read_text()
        yield DoorServer(server.pid, int(first))


async def constant(scope: Any, receive: Any, send: Any) -> None:
    """A handler that does nothing but answer, with as many bytes as the door."""
    if scope["type"] == "lifespan":
        while (message := await receive())["type"] != "lifespan.shutdown":
            await send({"type": f"{message['type']}.complete"})
        await send({"type": "lifespan.shutdown.complete"})
        return
    body = b'{"config":{"polling":{"sleep":"00:00:30"}},"_links":{"configData":{"href":"' + b"x" * 69 + b'"}}}'
    headers = [(b"content-type", b"application/hal+json"), (b"content-length", b"%d" % len(body))]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": body})


def main() -> None:
    """Serves until it is killed; prints the port."""
    from prefect_robomaker.deployments.endpoint.server import run_server
    from prefect_robomaker.deployments.fleet.robot_door.door import RobotDoor

    application: Any = constant
    if "bare" not in sys.argv:
        orders = table_of_robots(*(f"robot{number}" for number in range(ROBOTS)))
        for number in range(ORDERS):
            orders.offer(robot_order(robot=f"robot{number}", action_id=number + 1))
        application = RobotDoor(
            orders,
            read_part=lambda order, start, length: bytes(length),
            sink=lambda report: None,
            clock=time.time,
            chance=random.random,
        )
    run_server(application, "127.0.0.1", 0, ready=lambda port: print(port, flush=True))


if __name__ == "__main__":
    main()
