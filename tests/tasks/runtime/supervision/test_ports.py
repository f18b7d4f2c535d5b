"""Ports of real applications under other numbers."""

import socket
import threading
from collections.abc import Callable

import pytest
from helpers.ports import free_port
from helpers.run_processes import never

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.runs.programs import PortPlan, ProgramPlan, RunStop
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

MakeProgram = Callable[..., ProgramPlan]
ProgramsPlan = Callable[..., RunPlan]
SHOUTING = (
    "import socketserver, sys\n"
    "class Shout(socketserver.StreamRequestHandler):\n"
    "    def handle(self):\n"
    "        data = self.rfile.read()\n"
    "        self.wfile.write(data.upper())\n"
    "server = socketserver.ThreadingTCPServer(('127.0.0.1', {port}), Shout)\n"
    "print('listening', flush=True)\n"
    "server.serve_forever()\n"
)


@pytest.fixture
def free_ports() -> tuple[int, int]:
    return free_port(), free_port()


def shout(port: int, data: bytes) -> bytes:
    with socket.create_connection(("127.0.0.1", port), timeout=200) as connection:
        connection.sendall(data)
        connection.shutdown(socket.SHUT_WR)
        with connection.makefile("rb") as reader:
            return reader.read()


@pytest.mark.parametrize("same", [False, True])
def test_forwarding(
    launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, free_ports: tuple[int, int], same: bool
) -> None:
    job_port, application_port = free_ports if not same else (free_ports[0], free_ports[0])
    ports = [PortPlan(job_port=job_port, application_port=application_port)]
    plan = plan_programs(program(SHOUTING.format(port=application_port)), ports=ports)
    answers: list[bytes] = []
    large = b"x" * 3_000_000

    def talk() -> None:
        answers.extend([shout(job_port, b"hello"), shout(job_port, large)])

    talking = threading.Thread(target=talk)

    def stop() -> RunStop | None:
        if "listening" in (plan.output_dir / "logs/robot.stdout.log").read_text() and talking.ident is None:
            talking.start()
        return RunStop.CANCELED if len(answers) == 2 else None

    assert launcher.run(plan, stop).status == "Canceled"
    assert answers == [b"HELLO", large.upper()]
    with pytest.raises(ConnectionRefusedError):
        shout(job_port, b"anybody there?")


def test_no_program_listens_yet(
    launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, free_ports: tuple[int, int]
) -> None:
    job_port, application_port = free_ports
    ports = [PortPlan(job_port=job_port, application_port=application_port)]
    answers: list[bytes] = []

    def stop() -> RunStop:
        answers.append(shout(job_port, b""))
        return RunStop.CANCELED

    launcher.run(plan_programs(program("import time; time.sleep(1000)"), ports=ports), stop)
    assert answers == [b""]


@pytest.mark.parametrize("same", [False, True])
def test_a_port_that_is_taken(
    launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, free_ports: tuple[int, int], same: bool
) -> None:
    job_port, application_port = free_ports if not same else (free_ports[0], free_ports[0])
    plan = plan_programs(program(""), ports=[PortPlan(job_port=job_port, application_port=application_port)])
    with socket.create_server(("127.0.0.1", job_port)), pytest.raises(LaunchError) as caught:
        launcher.run(plan, never)
    assert caught.value.failure_code == "InvalidInput"
    assert f"jobPort {job_port} (of applicationPort {application_port}) cannot be opened" in str(caught.value)
    assert "Address already in use" in str(caught.value)
