"""Runs that consist of programs: real processes, real signals."""

import json
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from helpers.run_processes import limit_reached, never, processes_with

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunOutcome, RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import ProgramPlan, RunStop
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

Plan = Callable[..., RunPlan]
MakeProgram = Callable[..., ProgramPlan]
ProgramsPlan = Callable[..., RunPlan]
UNHEALTHY = "RobotApplicationHealthCheckFailure"
WAITING = "import time; time.sleep(1000)"


def read_result(plan: RunPlan) -> RunResult:
    return RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())


def log_of(plan: RunPlan, name: str) -> str:
    return (plan.output_dir / "logs" / name).read_text()


def failure(outcome: RunOutcome) -> tuple[str | None, str]:
    assert outcome.status == "Failed"
    return outcome.failure_code, outcome.failure_reason or ""


class TestEnds:
    def test_exit_code_0_completes_the_job(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        plan = plan_programs(program("print('all done')"))
        outcome = launcher.run(plan, never)
        assert (outcome.status, outcome.failure_code, outcome.finished) == ("Completed", None, True)
        assert log_of(plan, "robot.stdout.log") == "all done\n"
        result = read_result(plan)
        assert (result.verdict, result.ended_by, result.seed) == ("NONE", "application", plan.seed)
        assert 0.0 < result.wall_time_s < 120.0

    def test_a_result_that_the_application_wrote_is_kept(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        own = RunResult(
            verdict="PASS", summary="Parked.", sim_time_s=3.0, wall_time_s=1.0, real_time_factor=3.0,
            ended_by="environment", seed=1,
        )  # fmt: skip
        write = "import os; open(os.environ['ROBOMAKER_OUTPUT_DIR'] + '/result.json', 'w').write"
        code = f"{write}({own.model_dump_json()!r})"
        plan = plan_programs(program(code))
        launcher.run(plan, never)
        assert read_result(plan) == own

    def test_a_result_that_is_none_is_replaced_but_not_lost(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        code = "import os; open(os.environ['ROBOMAKER_OUTPUT_DIR'] + '/result.json', 'w').write('[]')"
        plan = plan_programs(program(code))
        launcher.run(plan, never)
        assert read_result(plan).ended_by == "application"
        assert (plan.output_dir / "result.invalid.json").read_text() == "[]"

    def test_a_result_that_cannot_be_written_fails_the_run(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        code = "import os, pathlib; pathlib.Path(os.environ['ROBOMAKER_OUTPUT_DIR'], '.result.json.unfinished').mkdir()"
        outcome = launcher.run(plan_programs(program(code)), never)
        reason_code, reason = failure(outcome)
        assert reason_code == "InternalServiceError"
        assert reason.startswith("result.json cannot be written: ")
        assert not outcome.finished

    def test_a_link_where_the_result_is_written_is_not_followed(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path
    ) -> None:
        (tmp_path / "mine").write_text("mine")
        link = "pathlib.Path(os.environ['ROBOMAKER_OUTPUT_DIR'], '.result.json.unfinished')"
        code = f"import os, pathlib; {link}.symlink_to({str(tmp_path / 'mine')!r})"
        plan = plan_programs(program(code))
        assert launcher.run(plan, never).finished
        assert not (plan.output_dir / "result.json").is_symlink()
        assert (tmp_path / "mine").read_text() == "mine"

    @pytest.mark.parametrize(
        ("code", "texts"),
        [
            ("import sys; print('lost the map', file=sys.stderr); sys.exit(3)", ["exited with code 3", "lost the map"]),
            pytest.param("import os; os.kill(os.getpid(), 11)", ["was killed by SIGSEGV"], marks=pytest.mark.deep),
            pytest.param(
                "print('only on stdout'); raise SystemExit(1)",
                ["robot.stdout.log:\nonly on stdout"],
                marks=pytest.mark.deep,
            ),
            ("1 / 0", ["exited with code 1", "robot.stderr.log", "ZeroDivisionError: division by zero"]),
        ],
    )
    def test_any_other_end_is_a_crash(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, code: str, texts: list[str]
    ) -> None:
        plan = plan_programs(program(code))
        outcome = launcher.run(plan, never)
        reason_code, reason = failure(outcome)
        assert reason_code == "RobotApplicationCrash"
        assert reason.startswith("Robot application driver (program robot) ")
        assert all(text in reason for text in texts)
        assert outcome.finished, "all that it wrote is there"
        result = read_result(plan)
        assert (result.verdict, result.ended_by) == ("ERROR", "application")
        assert result.summary == reason.splitlines()[0]

    @pytest.mark.parametrize(
        ("verdict", "after"),
        [("PASS", "ERROR"), pytest.param("NONE", "ERROR", marks=pytest.mark.deep), ("FAIL", "FAIL")],
    )
    def test_a_crash_lets_no_result_pass(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, verdict: Any, after: str
    ) -> None:
        own = RunResult(
            verdict=verdict, metrics={"laps": 2.0}, sim_time_s=3.0, wall_time_s=1.0, real_time_factor=3.0,
            ended_by="environment", seed=1,
        )  # fmt: skip
        write = "import os; open(os.environ['ROBOMAKER_OUTPUT_DIR'] + '/result.json', 'w').write"
        plan = plan_programs(program(f"{write}({own.model_dump_json()!r}); os._exit(1)"))

        assert launcher.run(plan, never).status == "Failed"

        assert (read_result(plan).verdict, read_result(plan).metrics) == (after, {"laps": 2.0})

    def test_the_crash_of_one_ends_the_other(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path
    ) -> None:
        plan = plan_programs(program(WAITING), program("raise SystemExit(9)", role="simulation", name="simulation"))
        code, reason = failure(launcher.run(plan, never))
        assert (code, "arena (program simulation) exited with code 9" in reason) == ("SimulationApplicationCrash", True)
        assert processes_with(str(tmp_path)) == []

    @pytest.mark.parametrize(
        ("argv", "text"),
        [
            (["no-such-program"], "program not found: no-such-program"),
            pytest.param(["./plain.txt"], "./plain.txt is not executable", marks=pytest.mark.deep),
            pytest.param(
                ["./binary"], "./binary cannot be executed: [Errno 8] Exec format error", marks=pytest.mark.deep
            ),
            (["./script"], "./script is there, but not the interpreter"),
        ],
    )
    def test_a_program_that_cannot_be_started(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path,
        argv: list[str], text: str,
    ) -> None:  # fmt: skip
        for name, content, mode in (
            ("plain.txt", "hello", 0o644),
            ("binary", "\0\1", 0o755),
            ("script", "#!/no/such/interpreter\n", 0o755),
        ):
            (tmp_path / name).write_text(content)
            (tmp_path / name).chmod(mode)
        code, reason = failure(launcher.run(plan_programs(program("", argv=argv, folder=tmp_path)), never))
        assert code == "RobotApplicationCrash"
        assert f"could not be started: {text}" in reason

    def test_a_folder_that_is_not_there(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path
    ) -> None:
        _, reason = failure(launcher.run(plan_programs(program("", folder=tmp_path / "gone")), never))
        assert f"its working directory {tmp_path / 'gone'} cannot be entered: No such file or directory" in reason


class TestRunEnvironment:
    def test_what_a_program_finds(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:  # fmt: skip
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "hush")
        code = (
            "import json, os, signal, sys;"
            "print(json.dumps({'environ': dict(os.environ), 'cwd': os.getcwd(), 'stdin': sys.stdin.read(),"
            "'open': [n for n in os.listdir('/proc/self/fd') if int(n) > 2 and os.path.exists('/proc/self/fd/' + n)],"
            "'leader': os.getsid(0) == os.getpid(),"
            "'interruptible': signal.getsignal(signal.SIGINT) is signal.default_int_handler,"
            "'args': sys.argv[1:]}))"
        )
        argv = [sys.executable, "-c", code, "a b", "c"]
        one = program("", argv=argv, environment={"MAP": "loft", "ROBOMAKER_SEED": "0"})
        driver = ApplicationPlan(role="robot", name="driver", environment_variables={"MAP": "flat", "SPEED": "2"})
        plan = plan_programs(one, robot_application=driver, data_dir=tmp_path / "data", root_dir=tmp_path / "root")
        assert launcher.run(plan, never).status == "Completed"
        found: dict[str, Any] = json.loads(log_of(plan, "robot.stdout.log"))
        environ = found["environ"]
        assert environ["AWS_ROBOMAKER_SIMULATION_JOB_ID"] == plan.job_id
        assert (environ["MAP"], environ["SPEED"], environ["ROBOMAKER_SEED"]) == ("loft", "2", str(plan.seed))
        assert environ["ROBOMAKER_OUTPUT_DIR"] == str(plan.output_dir)
        assert environ["ROBOMAKER_DATA_DIR"] == str(tmp_path / "data")
        assert environ["ROBOMAKER_JOB_ROOT"] == str(tmp_path / "root")
        assert environ["HOME"] == str(tmp_path / "root" / "home" / "robomaker")
        assert "ROBOMAKER_WORLD_DIR" not in environ
        assert "ROBOMAKER_AGENT_SOCKET" not in environ
        assert "hush" not in environ.values()
        assert (found["cwd"], found["stdin"], found["open"]) == (str(one.folder), "", [])
        assert (found["leader"], found["interruptible"], found["args"]) == (True, True, ["a b", "c"])

    def test_what_one_program_writes_others_may_not_read(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        """A reader that is gone ends a shell pipeline as everywhere: SIGPIPE is not ignored."""
        plan = plan_programs(program("", argv=["sh", "-c", "yes | head -n 1; echo over"]))
        assert launcher.run(plan, never).status == "Completed"
        assert log_of(plan, "robot.stdout.log") == "y\nover\n"
        assert log_of(plan, "robot.stderr.log") == ""


class TestStopping:
    IGNORING = "import signal, time; signal.signal(15, signal.SIG_IGN); print('ready', flush=True); time.sleep(1000)"
    DAEMON = (
        "import os, sys, time\n"
        "for _ in range(2):\n"
        "    if os.fork(): os._exit(0) if _ else time.sleep(1000)\n"
        "    os.setsid()\n"
        "print('ready', flush=True); time.sleep(1000)"
    )

    @pytest.mark.parametrize(
        "code",
        [
            pytest.param(f"print('ready', flush=True); {WAITING}", marks=pytest.mark.deep),
            pytest.param(IGNORING, marks=pytest.mark.deep),
            DAEMON,
        ],
    )
    def test_cancel(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path, code: str
    ) -> None:
        plan = plan_programs(program(code))
        outcome = launcher.run(plan, lambda: RunStop.CANCELED if "ready" in log_of(plan, "robot.stdout.log") else None)
        assert (outcome.status, outcome.finished) == ("Canceled", True)
        assert processes_with(str(tmp_path)) == []
        assert read_result(plan).ended_by == "canceled"

    def test_the_duration_limit_is_a_normal_end(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        code = "import signal, sys, time; signal.signal(15, lambda *_: (print('bye'), exit(7)))\n"
        code += "print('ready', file=sys.stderr, flush=True); time.sleep(1000)"
        plan = plan_programs(program(code))
        outcome = launcher.run(plan, never, clock=limit_reached(lambda: "ready" in log_of(plan, "robot.stderr.log")))
        assert (outcome.status, outcome.timed_out, outcome.finished) == ("Completed", True, True)
        assert log_of(plan, "robot.stdout.log") == "bye\n"
        assert read_result(plan).ended_by == "duration limit"

    def test_cleaning_up_comes_last(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path
    ) -> None:
        cleanup = ["sh", "-c", f"echo removed >> {tmp_path}/cleaned; echo gone"]
        ends = program("pass", cleanup_argv=cleanup), program("pass", cleanup_argv=["no-such-engine"])
        plans = [plan_programs(one, run_id=f"run-{i}") for i, one in enumerate(ends)]
        for plan in plans:
            assert launcher.run(plan, never).status == "Completed"
        assert (tmp_path / "cleaned").read_text() == "removed\n"
        assert "cleaning up: program not found: no-such-engine" in log_of(plans[-1], "robot.stderr.log")


class TestContinue:
    def test_others_go_on_until_the_limit(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        crashes: list[tuple[str, str]] = []
        counting = "import time\nwhile True: print('tick', flush=True); time.sleep(0.1)"
        plan = plan_programs(
            program("raise SystemExit(4)"),
            program(counting, role="simulation", name="simulation"),
            failure_behavior="Continue",
        )

        def ticks() -> int:
            return log_of(plan, "simulation.stdout.log").count("tick")

        def crashed(code: str, reason: str) -> None:
            crashes.append((code, reason))
            before.append(ticks())

        before: list[int] = []
        clock = limit_reached(lambda: bool(before) and ticks() > before[0] + 3)
        outcome = launcher.run(plan, never, on_crash=crashed, clock=clock)
        [(code, reason)] = crashes
        assert (code, failure(outcome)) == ("RobotApplicationCrash", (code, reason))
        assert ticks() > before[0] + 3

    def test_cancel_after_a_crash(self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan) -> None:
        crashes: list[str] = []
        plan = plan_programs(program("raise SystemExit(4)"), failure_behavior="Continue")
        outcome = launcher.run(
            plan, lambda: RunStop.CANCELED if crashes else None, on_crash=lambda code, _: crashes.append(code)
        )
        assert (outcome.status, crashes) == ("Canceled", ["RobotApplicationCrash"])

    def test_the_crash_of_an_episode(self, launcher: Launcher, make_plan: Plan) -> None:
        crashes: list[str] = []
        plan = make_plan("segfaulting", failure_behavior="Continue")
        clock = limit_reached(lambda: bool(crashes))
        outcome = launcher.run(plan, never, on_crash=lambda code, _: crashes.append(code), clock=clock)
        assert (failure(outcome)[0], crashes) == ("SimulationApplicationCrash", ["SimulationApplicationCrash"])
        assert "killed by SIGSEGV" in failure(outcome)[1]


class TestEpisodesWithPrograms:
    """A simulation application in the run's process, the robot application beside it."""

    @pytest.fixture
    def plan_drive(self, make_plan: Plan, program: MakeProgram) -> Callable[..., RunPlan]:
        def plan(code: str, **members: Any) -> RunPlan:
            driver = ApplicationPlan(role="robot", name="driver")
            return make_plan(robot_application=driver, programs=[program(code)], **members)

        return plan

    def test_it_never_connects(self, launcher: Launcher, plan_drive: Callable[..., RunPlan]) -> None:
        plan = plan_drive("import os; print(os.environ['ROBOMAKER_AGENT_SOCKET'])")
        code, reason = failure(launcher.run(plan, never))
        said = "robot application driver ended with exit code 0 without connecting to the simulation"
        assert (code, said in reason) == (UNHEALTHY, True)
        assert said in log_of(plan, "stderr.log")
        assert not (plan.output_dir / "result.json").exists()

    def test_it_connects_and_leaves_without_a_greeting(
        self, launcher: Launcher, plan_drive: Callable[..., RunPlan]
    ) -> None:
        plan = plan_drive(
            "import os, socket, time\n"
            "connection = socket.socket(socket.AF_UNIX)\n"
            "while connection.connect_ex(os.environ['ROBOMAKER_AGENT_SOCKET']):\n"
            "    time.sleep(0.02)  # on a busy machine a program may be quicker than the simulation\n"
            "connection.recv(100)"
        )
        code, reason = failure(launcher.run(plan, never))
        assert (code, "exit code 0 without greeting the simulation" in reason) == (UNHEALTHY, True)

    def test_it_ends_while_the_environment_is_made(
        self, launcher: Launcher, plan_drive: Callable[..., RunPlan]
    ) -> None:
        plan = plan_drive("pass", environment="slow_to_make")
        code, reason = failure(launcher.run(plan, never))
        assert (code, "without connecting to the simulation" in reason) == (UNHEALTHY, True)

    def test_cancel_while_the_environment_is_made_without_a_robot(
        self, launcher: Launcher, plan_drive: Callable[..., RunPlan]
    ) -> None:
        plan, began = plan_drive("pass", environment="never_made"), time.monotonic()
        outcome = launcher.run(plan, lambda: RunStop.CANCELED if time.monotonic() > began + 1.5 else None)
        assert outcome.status == "Canceled"

    def test_it_crashes_before_it_connects(self, launcher: Launcher, plan_drive: Callable[..., RunPlan]) -> None:
        plan = plan_drive("raise SystemExit(5)")
        code, reason = failure(launcher.run(plan, never))
        assert code == "RobotApplicationCrash"
        assert "driver (program robot) exited with code 5" in reason
        assert not (plan.output_dir / "result.json").exists()

    DRIVE = (
        "from prefect_robomaker.tasks.runtime.agents.agent_client import connect\n"
        "simulation = connect()\n"
        "for count, _ in enumerate(simulation):\n"
        "    if count == 3: {end}\n"
        "    simulation.act([0.0])\n"
    )

    @pytest.mark.parametrize(
        "end",
        [
            "break",
            *(
                pytest.param(end, marks=pytest.mark.deep)
                for end in ("simulation.end(); break", "import os; os._exit(0)")
            ),
        ],
    )
    def test_the_robot_ends_it(self, launcher: Launcher, plan_drive: Callable[..., RunPlan], end: str) -> None:
        plan = plan_drive(self.DRIVE.format(end=end))
        outcome = launcher.run(plan, never)
        assert (outcome.status, outcome.finished) == ("Completed", True)
        assert (read_result(plan).ended_by, read_result(plan).metrics["steps"]) == ("agent", 3.0)

    @pytest.mark.parametrize(
        ("end", "text"),
        [("import os; os._exit(5)", "exited with code 5"), ("raise KeyError('map')", "KeyError: 'map'")],
    )
    def test_the_robot_crashes_on_the_way(
        self, launcher: Launcher, plan_drive: Callable[..., RunPlan], end: str, text: str
    ) -> None:
        plan = plan_drive(self.DRIVE.format(end=end))
        code, reason = failure(launcher.run(plan, never))
        assert (code, text in reason, "program robot" in reason) == ("RobotApplicationCrash", True, True)
        assert not (plan.output_dir / "result.json").exists()

    def test_the_simulation_ends_it(self, launcher: Launcher, plan_drive: Callable[..., RunPlan]) -> None:
        plan = plan_drive(self.DRIVE.format(end="pass"))
        assert launcher.run(plan, never).status == "Completed"
        assert read_result(plan).ended_by == "environment"

    def test_the_robot_notices_first_that_the_simulation_fails(
        self, launcher: Launcher, plan_drive: Callable[..., RunPlan]
    ) -> None:
        """Its error at the lost simulation is not taken for the reason."""
        plan = plan_drive(self.DRIVE.format(end="pass") + "raise SystemExit(8)", environment="raising")
        code, reason = failure(launcher.run(plan, never))
        assert (code, "the table is on fire" in reason) == ("SimulationApplicationCrash", True)

    def test_the_simulation_fails(self, launcher: Launcher, plan_drive: Callable[..., RunPlan], tmp_path: Path) -> None:
        plan = plan_drive(WAITING, environment="unable")
        code, reason = failure(launcher.run(plan, never))
        assert (code, "no such map" in reason) == ("SimulationApplicationCrash", True)
        assert processes_with(str(tmp_path)) == []


def test_the_death_of_a_supervisor_is_the_death_of_all(
    launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path
) -> None:
    plan = plan_programs(
        program(
            "import os, subprocess, sys, time\n"
            f"nap = [sys.executable, '-c', {WAITING!r}]\n"
            "subprocess.Popen(nap, start_new_session=True)\n"
            "print(os.getppid(), flush=True); time.sleep(1000)",
            cleanup_argv=["sh", "-c", f"echo removed > {tmp_path}/cleaned"],
        )
    )

    def stop() -> None:
        if supervisor := log_of(plan, "robot.stdout.log").strip():
            with suppress(ProcessLookupError):  # what it left is still being killed
                os.kill(int(supervisor), signal.SIGKILL)

    code, reason = failure(launcher.run(plan, stop))
    assert (code, "supervising process disappeared" in reason) == ("InternalServiceError", True)
    assert processes_with(str(tmp_path)) == []
    assert (tmp_path / "cleaned").exists()
    assert launcher.run(plan_programs(program("pass"), run_id="run-2"), never).status == "Completed"
