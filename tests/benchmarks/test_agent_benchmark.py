"""What an idle agent of a robot costs: memory, and the processor time of its polls."""

import os
from pathlib import Path

import pytest
from helpers.agent_robot import Rover, rover
from helpers.processes import wait_for
from helpers.tuf_repository import bundle

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(900)]

POLLS = 40
IDLE_SLEEP_S = 30
"""Between two polls of a robot with nothing to do."""


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _resident_mb(pid: int) -> float:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


def _count_polls(robot: Rover) -> list[str]:
    """Counts the polls from now on."""
    polls: list[str] = []
    poll = robot.server.orders.check_token

    def counted(name: str, token: bytes | None) -> object:
        polls.append(name)
        return poll(name, token)

    robot.server.orders.check_token = counted  # type: ignore[method-assign,assignment]
    return polls


def test_what_an_idle_agent_costs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with rover(tmp_path) as robot:
        target = robot.server.repository.add_deployment("job-1", bundle({"drive": robot.program("1")}))
        robot.server.offer(1, target)
        robot.agent.start()
        robot.server.wait_for_end(1)
        assert robot.agent.process is not None
        pid = robot.agent.process.pid
        polls = _count_polls(robot)
        cpu_s = _cpu_s(pid)
        wait_for(lambda: len(polls) >= POLLS, "the polls", timeout_s=300)
        each_s = (_cpu_s(pid) - cpu_s) / len(polls)
        resident_mb = _resident_mb(pid)
    with capsys.disabled():
        print(
            f"\nidle agent: {resident_mb:.1f} MB resident, {1000 * each_s:.2f} ms of CPU per poll, "
            f"{100 * each_s / IDLE_SLEEP_S:.3f} % at a poll every {IDLE_SLEEP_S} s"
        )
