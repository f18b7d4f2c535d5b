"""What a robot's poll costs, on a connection of its own, against a bare ASGI handler."""

import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import pytest
from helpers.robot_door_server import ORDERS, ROBOTS, DoorServer, door_server

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(900)]

ROUNDS = 7
POLLS = 1_000


def _measured(server: DoorServer, robot: Callable[[int], str]) -> tuple[float, float]:
    """Processor seconds of the server, and seconds, for each poll."""
    began, cpu_s = time.perf_counter(), server.cpu_s()
    for number in range(POLLS):
        server.poll(robot(number))
    return (server.cpu_s() - cpu_s) / POLLS, (time.perf_counter() - began) / POLLS


def test_what_a_poll_costs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def busy(number: int) -> str:
        return f"robot{number % ORDERS}"

    def idle(number: int) -> str:
        return f"robot{ORDERS + number * 7 % (ROBOTS - ORDERS)}"

    with door_server(tmp_path / "door") as door, door_server(tmp_path / "bare", bare=True) as bare:
        for server in (door, bare):
            _measured(server, idle)
        # They take turns, so that a busy machine is busy for all of them.
        rounds = [(_measured(bare, idle), _measured(door, idle), _measured(door, busy)) for _ in range(ROUNDS)]
    with capsys.disabled():
        print(f"\n{ROBOTS} robots, {ORDERS} with an order; each poll on a new connection")
        for name, column in (("a bare handler", 0), ("idle robots", 1), ("robots with an order", 2)):
            cpu_s = median(each[column][0] for each in rounds)
            ratio = median(each[column][0] / each[0][0] for each in rounds)
            wall_s = median(each[column][1] for each in rounds)
            print(
                f"{name}: {cpu_s * 1000:.3f} ms of CPU, {1 / cpu_s:.0f} polls/s on one core, {ratio:.2f} of a bare "
                f"handler; one client after the other {wall_s * 1000:.2f} ms"
            )
