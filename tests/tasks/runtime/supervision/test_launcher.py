"""Real runs in real processes."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest
from helpers.run_processes import (
    children_of,
    is_running,
    limit_reached,
    never,
    processes_in,
    processes_with,
    wait_until,
)
from mcap.reader import make_reader

from prefect_robomaker.schemas.runs.plan import RunOutcome, RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import RunStop
from prefect_robomaker.schemas.wire.errors import LaunchError, LaunchInterruptedError
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

Plan = Callable[..., RunPlan]
OK = ""
SIMULATION = "SimulationApplicationCrash"
ROBOT = "RobotApplicationCrash"


def read_result(plan: RunPlan) -> RunResult:
    return RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())


def has_process(plan: RunPlan) -> bool:
    """Whether the run's process is there, by its working directory; in its box it has another number."""
    return bool(processes_in(plan.work_dir))


def assert_failed(outcome: RunOutcome, code: str, *texts: str) -> None:
    assert (outcome.status, outcome.failure_code) == ("Failed", code)
    assert outcome.failure_reason is not None
    for text in texts:
        assert text in outcome.failure_reason
    assert len(outcome.failure_reason) <= 1024


class TestNormalEnds:
    def test_the_environment_ends_it(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan("Judging")
        outcome = launcher.run(plan, never)
        assert (outcome.status, outcome.failure_reason, outcome.timed_out) == ("Completed", None, False)
        assert outcome.started_at < outcome.ended_at
        assert outcome.cpu_time_s is not None
        assert outcome.cpu_time_s > 0
        result = read_result(plan)
        assert (result.verdict, result.summary, result.ended_by) == ("PASS", "Counted to 20.", "environment")
        assert result.sim_time_s == pytest.approx(2.0)
        assert result.metrics == {"steps": 20.0, "count": 20.0}
        assert result.extra["not_finite"] == {"bad": "nan"}
        assert len(result.path) == 600
        assert (result.path[0][1], result.path[-1][1]) == (0.0, 1999.0)
        assert result.versions.keys() == {"mujoco", "dm_control", "prefect_robomaker"}

    def test_the_agent_ends_it(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan(agent="leaving_early")
        assert launcher.run(plan, never).status == "Completed"
        result = read_result(plan)
        assert (result.ended_by, result.verdict, result.metrics["steps"]) == ("agent", "NONE", 5.0)

    def test_leaving_with_exit_code_0_is_no_failure(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan("exiting_0")
        assert launcher.run(plan, never).status == "Completed"
        assert read_result(plan).ended_by == "environment"

    def test_the_built_in_applications_are_the_default(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan(simulation_application=None, robot_application=None)
        outcome = launcher.run(plan, never)
        # Without a world there is nothing to drive in: their own clear refusal, not an import error.
        assert_failed(outcome, "InvalidInput", "indoor-navigation", "world")

    def test_run_environment(self, launcher: Launcher, make_plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "hush")
        monkeypatch.setenv("PREFECT_API_KEY", "hush")
        plan = make_plan("Judging", variables={"MAP": "flat"})
        launcher.run(plan, never)
        extra = read_result(plan).extra
        environ = extra["environ"]
        assert environ["AWS_ROBOMAKER_SIMULATION_JOB_ID"] == plan.job_id
        assert environ["AWS_ROBOMAKER_SIMULATION_JOB_ARN"] == plan.job_arn
        assert environ["AWS_ROBOMAKER_SIMULATION_RUN_ID"] == plan.run_id
        assert environ["MAP"] == "flat"
        assert "hush" not in environ.values()
        assert extra["cwd"] == str(plan.work_dir)
        assert extra["stdin"] == ""
        assert "pytest" not in extra["main"]

    def test_a_seed_repeats_a_run(self, launcher: Launcher, make_plan: Plan) -> None:
        plans = [make_plan("Judging", run_id=f"run-{i}", seed=seed) for i, seed in enumerate((5, 5, 6))]
        for plan in plans:
            launcher.run(plan, never)
        first, again, other = [(read_result(plan).extra["random"], read_result(plan).extra["rng"]) for plan in plans]
        assert first == again
        assert first[0] != other[0]
        assert first[1] != other[1]

    def test_output_goes_to_the_logs(self, launcher: Launcher, make_plan: Plan, capfd: pytest.CaptureFixture) -> None:
        plan = make_plan("writing")
        launcher.run(plan, never)
        assert (plan.output_dir / "logs/stdout.log").read_text() == "from C, to stdout\nfrom a program\n"
        assert (plan.output_dir / "logs/stderr.log").read_text() == "complaint\n"
        assert capfd.readouterr() == ("", "")

    def test_much_output_blocks_nothing(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan("printing")
        assert launcher.run(plan, never).status == "Completed"
        assert (plan.output_dir / "logs/stdout.log").stat().st_size > 2_000_000

    def test_runs_at_the_same_time(self, launcher: Launcher, make_plan: Plan) -> None:
        plans = [make_plan("Judging", run_id=f"run-{i}", seed=i) for i in range(3)]
        outcomes: dict[str, RunOutcome] = {}

        def carry_out(plan: RunPlan) -> None:
            outcomes[plan.run_id] = launcher.run(plan, never)

        threads = [threading.Thread(target=carry_out, args=[plan]) for plan in plans]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert {outcome.status for outcome in outcomes.values()} == {"Completed"}
        assert [read_result(plan).seed for plan in plans] == list(range(3))


class TestFailures:
    @pytest.mark.parametrize(
        ("environment", "agent", "code", "texts"),
        [
            (
                "raising",
                OK,
                SIMULATION,
                [
                    "arena failed in environment.step()",
                    "ValueError: the table is on fire",
                    "in step 10 (arena.py, line",
                ],
            ),
            pytest.param(
                "UnableToReset", OK, SIMULATION, ["environment.reset()", "cannot reset"], marks=pytest.mark.deep
            ),
            pytest.param(
                "unable", OK, SIMULATION, ["making the environment", "KeyError: 'no such map'"], marks=pytest.mark.deep
            ),
            ("diverging", OK, SIMULATION, ["PhysicsError", "mjWARN_BADQPOS"]),
            pytest.param(
                "Loose",
                OK,
                SIMULATION,
                ["PhysicsError", "bad numbers at joint 'wrist_hinge' of body 'wrist'"],
                marks=pytest.mark.deep,
            ),
            ("NoMessage", OK, SIMULATION, ["run_result()", "verdict", "'PASS', 'FAIL'"]),
            pytest.param("exiting_3", OK, SIMULATION, ["exit code 3", "environment.step()"], marks=pytest.mark.deep),
            ("segfaulting", OK, SIMULATION, ["killed by SIGSEGV", "environment.step()"]),
            pytest.param("filling", OK, SIMULATION, ["File too large"], marks=pytest.mark.deep),
            pytest.param(
                "mking_environment",
                OK,
                SIMULATION,
                ["has no mking_environment", "did you mean make_environment"],
                marks=pytest.mark.deep,
            ),
            pytest.param(
                "not_callable",
                OK,
                SIMULATION,
                ["trouble.arena.not_callable is a int, not a function"],
                marks=pytest.mark.deep,
            ),
            (OK, "raising", ROBOT, ["driver failed in the agent", "ZeroDivisionError: lost the map", "agent.py, line"]),
            (OK, "unable", ROBOT, ["driver failed in making the agent", "no wheels"]),
            pytest.param(OK, "killed", ROBOT, ["killed by SIGKILL", "failed in the agent"], marks=pytest.mark.deep),
            pytest.param(
                OK, "make_agnt", ROBOT, ["has no make_agnt", "did you mean make_agent"], marks=pytest.mark.deep
            ),
            (
                "overfilling",
                OK,
                "InternalServiceError",
                ["The runtime failed in writing the outputs", "File too large"],
            ),
        ],
    )
    def test_whose_fault_and_why(
        self, launcher: Launcher, make_plan: Plan, environment: str, agent: str, code: str, texts: list[str]
    ) -> None:
        plan = make_plan(environment or "make_environment", agent or "make_agent")
        assert_failed(launcher.run(plan, never), code, *texts)
        assert not (plan.output_dir / "result.json").exists()

    def test_the_reason_ends_with_the_log(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan("raising")
        reason = launcher.run(plan, never).failure_reason
        assert reason is not None
        log = (plan.output_dir / "logs/stderr.log").read_text()
        assert reason.splitlines()[-2:] == log.splitlines()[-2:]
        assert "Last lines of logs/stderr.log:" in reason
        # The traceback is about the application, not about the runtime that called it.
        assert "run_episode" not in log
        assert "arena.py" in log

    def test_a_failed_run_keeps_its_recording(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan("raising")
        launcher.run(plan, never)
        with (plan.output_dir / "recording.mcap").open("rb") as stream:
            assert make_reader(stream).get_summary() is not None

    def test_no_recording_unless_asked(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan(record=False)
        launcher.run(plan, never)
        names = ["logs", "provenance.json", "result.json", "timeline.json"]
        assert sorted(path.name for path in plan.output_dir.iterdir()) == names


class TestStopping:
    @pytest.mark.parametrize("environment", ["make_environment", "hanging", "ignoring_sigterm"])
    def test_cancel(self, launcher: Launcher, make_plan: Plan, environment: str) -> None:
        plan = make_plan(environment, variables={"STEPS": "100000", "WAIT_S": "0.01"})
        outcome = launcher.run(plan, lambda: RunStop.CANCELED if (plan.work_dir / "busy").exists() else None)
        assert (outcome.status, outcome.failure_code) == ("Canceled", None)
        assert not has_process(plan)
        if environment == "ignoring_sigterm":
            assert not (plan.output_dir / "result.json").exists()
        else:  # also when it was interrupted in a call that would not have returned
            assert read_result(plan).ended_by == "canceled"

    @pytest.mark.parametrize("environment", ["make_environment", "hanging"])
    def test_the_duration_limit_is_a_normal_end(self, launcher: Launcher, make_plan: Plan, environment: str) -> None:
        plan = make_plan(environment, variables={"STEPS": "100000", "WAIT_S": "0.01"})
        outcome = launcher.run(plan, never, clock=limit_reached((plan.work_dir / "busy").exists))
        assert (outcome.status, outcome.timed_out, outcome.failure_code) == ("Completed", True, None)
        assert read_result(plan).ended_by == "duration limit"
        with (plan.output_dir / "recording.mcap").open("rb") as stream:
            assert make_reader(stream).get_summary() is not None

    def test_a_run_that_ignores_the_duration_limit_is_killed(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan("ignoring_sigterm")
        outcome = launcher.run(plan, never, clock=limit_reached((plan.work_dir / "busy").exists))
        assert (outcome.status, outcome.timed_out, outcome.verdict) == ("Completed", True, "NONE")
        assert "did not answer" in read_result(plan).remarks[0]
        assert not has_process(plan)

    @pytest.mark.parametrize("sandbox", ["auto", "off"])  # in a box the kernel ends them, where there is none we do
    def test_grandchildren_in_other_sessions_go_too(
        self, launcher: Launcher, make_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sandbox: str
    ) -> None:
        monkeypatch.setenv("ROBOMAKER_SANDBOX", sandbox)
        plan = make_plan("forking", variables={"MARK": str(tmp_path)})
        assert launcher.run(plan, never).status == "Completed"
        assert len(list(plan.work_dir.glob("*.there"))) == 4
        assert processes_with(str(tmp_path)) == []

    def test_a_caller_that_fails_takes_the_run_along(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan("hanging")

        def stop() -> RunStop | None:
            if (plan.work_dir / "busy").exists():
                raise TimeoutError("the thread was interrupted")
            return None

        with pytest.raises(TimeoutError):
            launcher.run(plan, stop)
        wait_until(lambda: not has_process(plan))


LEVELS = "prefect_robomaker.tasks.runtime.sandbox.levels"
SCRIPT = """
import os, sys
os.closerange(0, 3)  # a job worker without any standard stream
from pathlib import Path
from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

with open("log", "a") as log:
    log.write("imported\\n")
launcher = Launcher()
for name in sys.argv[1:]:
    plan = RunPlan.model_validate_json(Path(name).read_bytes())
    Path(name + ".outcome").write_text(launcher.run(plan, lambda: None).status)
"""


def waiting_below(server: int) -> list[int]:
    """Supervisors whose process has no run yet: it is in the warm process's folder."""
    home = Path(f"/proc/{server}/cwd").readlink()
    return [supervisor for supervisor in children_of(server) if is_waiting(children_of(supervisor), home)]


def is_waiting(pids: Sequence[int], home: Path) -> bool:
    """Whether they are a process without a run, and the keeper of its box on a machine that has boxes."""
    own = Path("/proc/self/ns/pid").readlink()
    try:
        boxed = [Path(f"/proc/{pid}/ns/pid").readlink() != own for pid in pids]
        return boxed == ([True, True] if has_boxes() else [False]) and all(
            Path(f"/proc/{pid}/cwd").readlink() in (home, Path("/")) for pid in pids
        )
    except FileNotFoundError:
        return False


@cache
def has_boxes() -> bool:
    found = subprocess.run([sys.executable, "-m", LEVELS], capture_output=True, check=True, text=True)
    return json.loads(found.stdout)["level"] == "box"


class TestParentProcess:
    @pytest.mark.deep
    def test_a_script_without_streams_is_not_run_again_and_its_death_is_the_death_of_all(
        self, make_plan: Plan, tmp_path: Path
    ) -> None:
        """Runs plans from an unguarded script of its own, one after the other, and kills it."""
        first, last = make_plan("Judging"), make_plan("ignoring_sigterm", run_id="run-2", max_duration_s=600)
        (tmp_path / "script.py").write_text(SCRIPT)
        (tmp_path / "first").write_text(first.model_dump_json())
        (tmp_path / "last").write_text(last.model_dump_json())
        with subprocess.Popen([sys.executable, "script.py", "first", "last"], cwd=tmp_path) as process:
            wait_until(lambda: process.poll() is not None or (last.work_dir / "busy").exists())
            assert (tmp_path / "first.outcome").read_text() == "Completed"
            assert (tmp_path / "log").read_text() == "imported\n"
            [server] = children_of(process.pid)
            wait_until(lambda: len(waiting_below(server)) == 1)
            [supervisor] = set(children_of(server)) - set(waiting_below(server))
            [run] = processes_in(last.work_dir)
            assert run in children_of(supervisor)
            waiting = waiting_below(server)
            tree = [server, supervisor, *children_of(supervisor), *waiting, *children_of(waiting[0])]
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
        assert len(tree) in (5, 7)  # with the keepers of two boxes
        wait_until(lambda: not any(map(is_running, tree)))

    @pytest.mark.deep
    def test_a_dead_fork_server_is_replaced(self, make_plan: Plan) -> None:
        before = set(children_of(os.getpid()))
        with Launcher() as launcher:
            launcher.start()
            [server] = set(children_of(os.getpid())) - before
            os.kill(server, signal.SIGKILL)
            wait_until(lambda: not is_running(server))
            assert launcher.run(make_plan(), never).status == "Completed"

    @pytest.mark.deep
    def test_processes_that_wait_may_be_killed_and_none_is_left_in_the_end(self, make_plan: Plan) -> None:
        before = set(children_of(os.getpid()))
        with Launcher() as launcher:
            launcher.start()
            [server] = set(children_of(os.getpid())) - before
            for which in ("supervisor", "run", "keeper", "both"):
                wait_until(lambda: len(waiting_below(server)) == 1)
                [supervisor] = waiting_below(server)
                keeper, run = min(children_of(supervisor)), max(children_of(supervisor))  # the same without a box
                killed = {"supervisor": [supervisor], "run": [run], "keeper": [keeper], "both": [run, supervisor]}
                for pid in killed[which]:
                    os.kill(pid, signal.SIGKILL)
                    wait_until(lambda pid=pid, which=which: which == "keeper" or not is_running(pid))
                # A killed keeper waits for its run.
                assert launcher.run(make_plan(run_id=f"run-{which}"), never).status == "Completed", which
                wait_until(lambda pids=(supervisor, run): not any(map(is_running, pids)))
            wait_until(lambda: len(waiting_below(server)) == 1)
            tree = [server, *waiting_below(server), *children_of(waiting_below(server)[0])]
        assert len(tree) in (3, 4)  # with the keeper of a box
        assert not any(map(is_running, tree))

    def test_a_launcher_that_cannot_start_says_why(
        self, make_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        (tmp_path / "mujoco.py").write_text("raise ImportError('this mujoco is broken')")
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        with Launcher() as launcher, pytest.raises(LaunchError, match="this mujoco is broken"):
            launcher.run(make_plan(), never)


class TestDeathsBeforeTheStart:
    """What is killed before a run has begun interrupts it; it has not failed."""

    def test_a_supervisor_that_is_dead_before_it_gets_its_run(
        self, launcher: Launcher, make_plan: Plan, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def connect() -> Connection:
            ours, theirs = socket.socketpair()
            theirs.close()
            return Connection(ours.detach())

        monkeypatch.setattr(launcher, "_connect", connect)
        with pytest.raises(LaunchInterruptedError, match="ended before the run began"):
            launcher.run(make_plan("Judging"), never)

    def test_a_warm_process_that_is_killed_while_it_starts(
        self, make_plan: Plan, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        start: Any = subprocess.Popen

        def start_and_kill(*words: Any, **options: Any) -> "subprocess.Popen[bytes]":
            process: subprocess.Popen[bytes] = start(*words, **options)
            process.kill()
            return process

        monkeypatch.setattr(subprocess, "Popen", start_and_kill)
        with Launcher() as launcher, pytest.raises(LaunchInterruptedError, match="exit code -9"):
            launcher.run(make_plan("Judging"), never)
