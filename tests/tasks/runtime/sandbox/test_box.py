"""Boxes as jobs find them: what is shown and hidden, ports, the supervisor's view of their processes."""

import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from helpers.ports import free_port
from helpers.run_processes import never, processes_in, wait_until

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.runs.programs import PortPlan, ProgramPlan
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

Plan = Callable[..., RunPlan]
MakeProgram = Callable[..., ProgramPlan]


@pytest.fixture
def boxed(launcher: Launcher, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Launcher:
    monkeypatch.setenv("ROBOMAKER_HOME", str(tmp_path / "shown" / "home"))
    monkeypatch.setenv("ROBOMAKER_SANDBOX_NETWORK", "none")
    if launcher._box().level != "box":
        pytest.skip("this machine or user has no namespaces")
    return launcher


def said(plan: RunPlan) -> str:
    return (plan.output_dir / "logs" / "robot.stdout.log").read_text()


def test_a_shown_folder_is_read_only_and_hides_the_home_in_it(
    boxed: Launcher, program: MakeProgram, plan_programs: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("shown/map.pgm", "shown/home/catalog.db", "own/x"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
    monkeypatch.setenv("ROBOMAKER_SANDBOX_SHOW", str(tmp_path / "shown"))
    script = (
        f"cd {tmp_path}/shown && cat map.pgm && ls home && echo > map.pgm || echo refused; echo > ../own/y && echo ok"
    )
    plan = plan_programs(program("", argv=["/bin/sh", "-c", script], folder=tmp_path / "own"))
    boxed.run(plan, never)
    assert said(plan) == "xrefused\nok\n"


def test_ports_are_forwarded_into_a_network_of_its_own(
    boxed: Launcher, program: MakeProgram, plan_programs: Plan
) -> None:
    code = """
import socket
with socket.create_server(("127.0.0.1", 9090)) as server, server.accept()[0] as client:
    client.sendall(b"from the box")
"""
    port = free_port()
    plan = plan_programs(program(code), ports=[PortPlan(job_port=port, application_port=9090)], max_duration_s=60)
    answers: list[bytes] = []

    def ask() -> None:
        with socket.socket() as client:
            client.settimeout(10)
            try:
                client.connect(("127.0.0.1", port))
                answers.append(client.recv(100))
            except OSError:
                answers.append(b"")

    assert boxed.run(plan, ask).status == "Completed"
    assert b"from the box" in answers


def test_a_local_network_has_the_object_store_and_nothing_else_of_this_machine(
    boxed: Launcher, program: MakeProgram, plan_programs: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = """
import socket, sys, threading
def heard(port):
    try:
        with socket.create_connection(("127.0.0.1", port), 60) as client:
            return client.recv(100).decode() or "nothing"
    except OSError as error:
        return type(error).__name__
def serve(server):
    server.accept()[0].sendall(b"own")
own = socket.create_server(("127.0.0.1", 0))
threading.Thread(target=serve, args=[own], daemon=True).start()
print(*map(heard, [int(sys.argv[1]), int(sys.argv[2]), own.getsockname()[1]]))
"""
    with serving(b"store") as store, serving(b"other") as other:
        monkeypatch.setenv("ROBOMAKER_SANDBOX_NETWORK", "local")
        monkeypatch.setenv("ROBOMAKER_OBJECT_STORE", f"http://127.0.0.1:{store}")
        plan = plan_programs(program("", argv=[sys.executable, "-c", code, str(store), str(other)]))
        assert boxed.run(plan, never).status == "Completed"
    assert said(plan) == "store ConnectionRefusedError own\n"


@contextmanager
def serving(greeting: bytes) -> Iterator[int]:
    """A server of this machine, which greets the first that connects; its port."""

    def greet() -> None:
        with suppress(OSError), server.accept()[0] as client:
            client.sendall(greeting)

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=greet, daemon=True)
        thread.start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)
        thread.join(200)


def test_a_signal_is_seen_as_in_no_box(boxed: Launcher, program: MakeProgram, plan_programs: Plan) -> None:
    plan = plan_programs(program("import os; os.kill(os.getpid(), 9)"))
    assert "was killed by SIGKILL" in (boxed.run(plan, never).failure_reason or "")


@pytest.mark.deep
def test_processes_that_leave_their_parents_go_with_the_box(
    boxed: Launcher, program: MakeProgram, plan_programs: Plan, tmp_path: Path
) -> None:
    code = """
import os, time
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        time.sleep(600)
    os._exit(0)
os.wait()
"""
    (tmp_path / "own").mkdir()
    plan = plan_programs(program(code, folder=tmp_path / "own"))
    assert boxed.run(plan, never).status == "Completed"
    wait_until(lambda: not processes_in(tmp_path / "own"))


def test_a_program_that_is_not_there_is_said_so(boxed: Launcher, program: MakeProgram, plan_programs: Plan) -> None:
    plan = plan_programs(program("", argv=["no-such-program"]))
    assert "program not found: no-such-program" in (boxed.run(plan, never).failure_reason or "")


@pytest.mark.skipif(not Path("/home").is_dir(), reason="there is no /home")
def test_home_folders_and_keys_of_root_are_not_there(
    boxed: Launcher, program: MakeProgram, plan_programs: Plan
) -> None:
    code = "import os; print(os.path.exists('/var/lib'), os.path.exists('/run'), os.listdir('/proc/1/task'))"
    plan = plan_programs(program(code, argv=[sys.executable, "-c", code]))
    boxed.run(plan, never)
    assert said(plan) == "False False ['1']\n"
