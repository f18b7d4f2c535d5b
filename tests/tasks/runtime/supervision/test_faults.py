"""Applications that break in every way: the run ends, with the right code, nothing is left, others go on."""

import os
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.run_processes import never, processes_with, wait_until

from prefect_robomaker.schemas.runs.plan import RunOutcome, RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import ComputeLimits, ProgramPlan, RunStop
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.limits.logs import MAX_END_BYTES, CappedLog
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

Plan = Callable[..., RunPlan]
MakeProgram = Callable[..., ProgramPlan]
ProgramsPlan = Callable[..., RunPlan]
MIB = 2**20
SMALL = ComputeLimits(memory_bytes=150 * MIB, processes=100)


class Bystander:
    """A run that goes on while others break."""

    def __init__(self, launcher: Launcher, plan: RunPlan) -> None:
        self.plan = plan
        self.is_over = False
        self._outcome: RunOutcome | None = None
        self._launcher = launcher
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        self._outcome = self._launcher.run(self.plan, lambda: RunStop.CANCELED if self.is_over else None)

    def start(self) -> None:
        self._thread.start()

    def end(self) -> RunOutcome:
        self.is_over = True
        self._thread.join(120)
        assert self._outcome is not None
        return self._outcome


@pytest.fixture
def bystander(launcher: Launcher, make_plan: Plan) -> Iterator[Bystander]:
    """A run beside that has to be as alive afterwards as before."""
    plan = make_plan(run_id="bystander", variables={"STEPS": "100000", "WAIT_S": "0.01"})
    run = Bystander(launcher, plan)
    run.start()
    wait_until((plan.work_dir / "busy").exists)
    yield run
    assert run.end().status == "Canceled"
    result = RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())
    assert result.ended_by == "canceled"


PROGRAM_FAULTS = {
    "exception": ("raise ValueError('lost')", "ValueError: lost"),
    "segfault": ("import ctypes; ctypes.string_at(0)", "was killed by SIGSEGV"),
    "abort": ("import os; os.abort()", "was killed by SIGABRT"),
    "memory hog": ("hog = []\nwhile True: hog.append(b'x' * 1_000_000)", "150 MiB of memory are allowed"),
    "fork bomb": ("import os, time\nfor _ in range(10): os.fork()\ntime.sleep(1000)", "100 processes and threads"),
    "fork bomb of sessions": (
        "import os, time\nfor _ in range(10):\n    if os.fork() == 0: os.setsid()\ntime.sleep(1000)",
        "100 processes and threads",
    ),
    "thread bomb": (
        "import threading, time\nwhile True: threading.Thread(target=time.sleep, args=[1000]).start()",
        "100 processes and threads",
    ),
    "killed": ("import os; os.kill(os.getpid(), 9)", "was killed by SIGKILL"),
}
BOMBS = {"fork bomb of sessions"}
"""Ends that the suite sees beside another run; ends of programs are in `test_programs`."""


@pytest.mark.parametrize(
    "fault",
    [fault if fault in BOMBS else pytest.param(fault, marks=pytest.mark.deep) for fault in PROGRAM_FAULTS],
)
def test_programs_that_break(
    launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, bystander: Bystander, tmp_path: Path,
    fault: str,
) -> None:  # fmt: skip
    code, text = PROGRAM_FAULTS[fault]
    plan = plan_programs(program(code), compute=SMALL)
    outcome = launcher.run(plan, never)
    assert (outcome.status, outcome.failure_code) == ("Failed", "RobotApplicationCrash")
    assert text in (outcome.failure_reason or "")
    assert not [pid for pid in processes_with(str(plan.work_dir.parent)) if pid != os.getpid()]


@pytest.mark.deep
@pytest.mark.parametrize("child", ["pass", "os.setsid()"])
def test_a_fork_bomb_that_never_ends(
    launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, bystander: Bystander, child: str
) -> None:
    """It would go on for twenty seconds and then say so; the limit ends it before."""
    bomb = f"while time.time() < until:\n    if os.fork() == 0: {child}"
    code = f"import os, time\nuntil = time.time() + 20\n{bomb}\nprint('over')"
    plan = plan_programs(program(code), compute=SMALL)
    outcome = launcher.run(plan, never)
    assert "100 processes and threads" in (outcome.failure_reason or "")
    assert "over" not in (plan.output_dir / "logs/robot.stdout.log").read_text()
    assert processes_with(str(bystander.plan.work_dir.parent.parent / "run-1")) == []


@pytest.fixture
def plan_fault(make_plan: Plan) -> Callable[..., RunPlan]:
    """Plans a run with a simulation application of another module of the `trouble` bundle."""

    def plan(attribute: str, **members: Any) -> RunPlan:
        ordinary = make_plan(**members)
        assert ordinary.simulation_application is not None
        broken = ordinary.simulation_application.model_copy(update={"attribute": f"trouble.{attribute}"})
        return ordinary.model_copy(update={"simulation_application": broken})

    return plan


@pytest.mark.parametrize(
    ("attribute", "text"),
    [
        ("broken_at_import.make", "making the environment: the process ended itself with exit code 0"),
        ("faults.segfaulting_in_c", "environment.step(): killed by SIGSEGV"),
        pytest.param("faults.forking_without_end", "used too much: 100 processes and threads", marks=pytest.mark.deep),
    ],
)
def test_environments_that_break(
    launcher: Launcher, plan_fault: Callable[..., RunPlan], bystander: Bystander, attribute: str, text: str
) -> None:
    plan = plan_fault(attribute, compute=ComputeLimits(processes=100))
    outcome = launcher.run(plan, never)
    assert (outcome.status, outcome.failure_code) == ("Failed", "SimulationApplicationCrash")
    assert text in (outcome.failure_reason or "")
    assert processes_with(str(plan.work_dir)) == []


@pytest.mark.parametrize(
    "code",
    [
        pytest.param("while True: pass", marks=pytest.mark.deep),
        pytest.param("import signal\nsignal.signal(15, signal.SIG_IGN)\nwhile True: pass", marks=pytest.mark.deep),
        "sum(iter(int, 1))",  # never leaves C
        "import signal, os\nsignal.pthread_sigmask(signal.SIG_BLOCK, range(1, 65))\nos.kill(os.getpid(), 19)\n",
    ],
)
def test_endless_loops_are_canceled_in_time(
    launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, code: str
) -> None:
    plan = plan_programs(program(f"print('on', flush=True)\n{code}"))

    def stop() -> RunStop | None:
        if "on" in (plan.output_dir / "logs/robot.stdout.log").read_text():
            return RunStop.CANCELED
        return None

    assert launcher.run(plan, stop).status == "Canceled"
    assert processes_with(str(plan.work_dir)) == []


@pytest.mark.deep
def test_an_environment_that_never_leaves_c(launcher: Launcher, plan_fault: Callable[..., RunPlan]) -> None:
    plan = plan_fault("faults.endless_in_c")

    def stop() -> RunStop | None:
        if not (plan.work_dir / "busy").exists():
            return None
        return RunStop.CANCELED

    assert launcher.run(plan, stop).status == "Canceled"
    assert processes_with(str(plan.work_dir)) == []


class TestOutput:
    @pytest.mark.parametrize("environment", ["closing_stdout", "closing_descriptors"])
    def test_a_closed_stdout(self, launcher: Launcher, plan_fault: Callable[..., RunPlan], environment: str) -> None:
        outcome = launcher.run(plan_fault(f"faults.{environment}"), never)
        assert (outcome.status, outcome.finished) == ("Completed", True)

    def test_a_program_that_closes_everything(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        outcome = launcher.run(plan_programs(program("import os; os.closerange(0, 1000); os._exit(0)")), never)
        assert outcome.status == "Completed"

    @pytest.mark.deep
    def test_a_flood(self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan) -> None:
        code = "import time, os\nfor _ in range(300): os.write(1, b'x' * 1_000_000); time.sleep(0.005)\n"
        plan = plan_programs(program(f"{code}\nprint('the last line', flush=True)"))
        assert launcher.run(plan, never).status == "Completed"
        log = (plan.output_dir / "logs/robot.stdout.log").read_bytes()
        assert len(log) < 100_000_000 + 200_000
        assert b"\nrobomaker: this log became longer than 100,000,000 bytes; from here only its end is kept\n" in log
        assert log.endswith(b"the last line\n")

    def test_logs_are_cut(self, tmp_path: Path) -> None:
        log = CappedLog(tmp_path / "log", max_bytes=1000)
        remark = "\nrobomaker: this log became longer than 1,000 bytes; from here only its end is kept\n"
        with (tmp_path / "log").open("ab", buffering=0) as program:
            program.write(b"a" * 1000)
            log.look()
            assert (tmp_path / "log").stat().st_size == 1000
            program.write(b"b" * 10_000_000)
            log.look()
            assert (tmp_path / "log").read_text() == "a" * 1000 + remark + "b" * MAX_END_BYTES
            program.write(b"c" * 10_000_000)
            log.look()
            program.write(b"the end\n")
        log.close()
        content = (tmp_path / "log").read_text()
        assert content.startswith("a" * 1000 + remark + "c")
        assert content.endswith("c" * 100 + "the end\n")
        assert len(content) == 1000 + len(remark) + MAX_END_BYTES

    def test_a_log_that_was_cut_only_at_the_end(self, tmp_path: Path) -> None:
        log = CappedLog(tmp_path / "log", max_bytes=1000)
        os.write(log.descriptor, b"a" * 200_000 + b"the end\n")
        log.close()
        content = (tmp_path / "log").read_text()
        assert content.endswith("the end\n")
        assert "became longer than 1,000 bytes" in content

    def test_a_program_that_ends_before_its_log_is_cut_keeps_its_last_line(self, tmp_path: Path) -> None:
        log = CappedLog(tmp_path / "log", max_bytes=1000)
        os.write(log.descriptor, b"a" * 200_000 + b"the end\n")
        log.look()
        log.close()
        assert (tmp_path / "log").read_text().endswith("the end\n")

    def test_links_are_not_followed(self, tmp_path: Path) -> None:
        (tmp_path / "log").symlink_to(tmp_path / "elsewhere")
        with pytest.raises(OSError, match="symbolic"):
            CappedLog(tmp_path / "log")
        assert not (tmp_path / "elsewhere").exists()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of one megabyte; only where this user may mount one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "none", str(folder)], capture_output=True, check=False
    )
    if mounted.returncode != 0:
        pytest.skip("this user may not mount a small file system")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


class TestFullDisk:
    def test_a_program_that_fills_it(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, small_disk: Path
    ) -> None:
        code = "import os; open(os.environ['ROBOMAKER_OUTPUT_DIR'] + '/big', 'wb').write(bytes(5_000_000))"
        plan = plan_programs(program(code), output_dir=small_disk / "out")
        outcome = launcher.run(plan, never)
        assert (outcome.status, outcome.failure_code) == ("Failed", "RobotApplicationCrash")
        assert "exited with code 1" in (outcome.failure_reason or "")

    def test_an_episode_that_fills_it(
        self, launcher: Launcher, plan_fault: Callable[..., RunPlan], small_disk: Path
    ) -> None:
        outcome = launcher.run(plan_fault("faults.filling_the_disk", output_dir=small_disk / "out"), never)
        assert (outcome.status, outcome.failure_code) == ("Failed", "SimulationApplicationCrash")
        assert "No space left on device" in (outcome.failure_reason or "")

    def test_it_is_full_from_the_beginning(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, small_disk: Path
    ) -> None:
        with (small_disk / "full").open("wb", buffering=0) as full:
            full.write(bytes(2 * MIB))
        plan = plan_programs(program("", argv=["true"]), output_dir=small_disk / "out")
        with pytest.raises(LaunchError, match="No space left on device") as refused:
            launcher.run(plan, never)
        assert refused.value.failure_code == "InternalServiceError"
