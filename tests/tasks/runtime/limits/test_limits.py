"""Limits of real runs: cores, memory, processes, the GPU's visibility."""

import json
import os
import resource
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
from helpers.run_processes import never, processes_with
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.plan import RunOutcome, RunPlan
from prefect_robomaker.schemas.runs.programs import ComputeLimits, ProgramPlan
from prefect_robomaker.tasks.runtime.limits.limits import estimated_bytes
from prefect_robomaker.tasks.runtime.limits.processes import ProcessState
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.supervision.run_requests import Cores

Plan = Callable[..., RunPlan]
MakeProgram = Callable[..., ProgramPlan]
ProgramsPlan = Callable[..., RunPlan]
MIB = 2**20
HOG = "import time; hog = [bytes(b'x') * (8 << 20) for _ in range({})]; print('full', flush=True); time.sleep({})"


def reason_of(outcome: RunOutcome, code: str) -> str:
    assert (outcome.status, outcome.failure_code) == ("Failed", code)
    return outcome.failure_reason or ""


class TestMemory:
    def test_a_program(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path
    ) -> None:
        plan = plan_programs(program(HOG.format(40, 1000)), compute=ComputeLimits(memory_bytes=150 * MIB))
        reason = reason_of(launcher.run(plan, never), "RobotApplicationCrash")
        assert reason.startswith(
            "Robot application driver (program robot) used too much: 150 MiB of memory are allowed, and it used "
        )
        assert processes_with(str(tmp_path)) == []

    @pytest.mark.deep
    def test_the_tree_counts_as_a_whole(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        hog = f"[sys.executable, '-c', {HOG.format(10, 1000)!r}]"
        code = f"import subprocess, sys; [subprocess.Popen({hog}) for _ in '12']"
        plan = plan_programs(
            program(f"{code}; import time; time.sleep(1000)"), compute=ComputeLimits(memory_bytes=150 * MIB)
        )
        assert "150 MiB of memory are allowed" in reason_of(launcher.run(plan, never), "RobotApplicationCrash")

    def test_what_is_shared_counts_once(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        """Five processes that share 64 MiB have 64 MiB, though each of them alone has that too."""
        code = HOG.format(8, 0.1) + "; import os; [os.fork() for _ in '12']; time.sleep(0.6); os._exit(0)"
        plan = plan_programs(program(code), compute=ComputeLimits(memory_bytes=150 * MIB))
        assert launcher.run(plan, never).status == "Completed"

    def test_an_episode(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan("hogging", compute=ComputeLimits(memory_bytes=400 * MIB))
        reason = reason_of(launcher.run(plan, never), "SimulationApplicationCrash")
        assert reason.startswith("Simulation application arena used too much: 400 MiB of memory are allowed")

    @pytest.mark.deep
    def test_continuing_does_not_help(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        limits = ComputeLimits(memory_bytes=150 * MIB)
        plan = plan_programs(program(HOG.format(40, 1000)), compute=limits, failure_behavior="Continue")
        assert "150 MiB" in reason_of(launcher.run(plan, never), "RobotApplicationCrash")

    @pytest.mark.deep
    def test_a_tool(self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan) -> None:
        tool = program(HOG.format(40, 1000), name="simulation-view", kind="tool", role="simulation")
        plan = plan_programs(
            program("import time; time.sleep(1000)"), tool, compute=ComputeLimits(memory_bytes=150 * MIB)
        )
        reason = reason_of(launcher.run(plan, never), "SimulationApplicationCrash")
        assert reason.startswith("Tool view of simulation application arena used too much")


def test_what_is_not_weighed_yet_is_estimated() -> None:
    """Four forks of one process of 90 bytes; the second one cannot be weighed."""
    states = [ProcessState(pid, "R", 1, pid, pid, 1, 90) for pid in (2, 3, 4, 5)]
    assert estimated_bytes(states, []) == {2: 90, 3: 90, 4: 90, 5: 90}
    assert estimated_bytes(states, [30]) == {2: 30, 3: 90, 4: 30, 5: 30}
    assert estimated_bytes(states, [30, 20, 30, 20]) == {2: 30, 3: 20, 4: 30, 5: 20}


class TestProcesses:
    SPAWN = "import subprocess, time\nfor _ in range({}): subprocess.Popen(['sleep', '1000'])\ntime.sleep({})"

    def test_too_many(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path
    ) -> None:
        plan = plan_programs(program(self.SPAWN.format(30, 1000)), compute=ComputeLimits(processes=20))
        reason = reason_of(launcher.run(plan, never), "RobotApplicationCrash")
        assert "used too much: 20 processes and threads at once are allowed, and there were more" in reason
        assert processes_with(str(tmp_path)) == []

    def test_threads_count(self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan) -> None:
        code = "import threading, time\nfor _ in range(30): threading.Thread(target=time.sleep, args=[1000]).start()"
        plan = plan_programs(program(code), compute=ComputeLimits(processes=20))
        assert "20 processes and threads" in reason_of(launcher.run(plan, never), "RobotApplicationCrash")

    def test_enough(self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan) -> None:
        plan = plan_programs(program(self.SPAWN.format(18, 0.3)), compute=ComputeLimits(processes=20))
        assert launcher.run(plan, never).status == "Completed"


class TestCores:
    @given(
        st.lists(st.integers(0, 500), min_size=1, max_size=16, unique=True),
        st.lists(st.integers(1, 20), max_size=8),
        st.integers(0, 10_000),
    )
    def test_runs_are_spread(self, available: list[int], counts: list[int], first: int) -> None:
        cores = Cores(available, first)
        use = dict.fromkeys(available, 0)
        with ExitStack() as stack:
            for count in counts:
                chosen = stack.enter_context(cores.taken(count))
                if count >= len(available):
                    assert chosen is None
                    continue
                assert chosen is not None
                assert len(set(chosen)) == count
                # No run is given a core while there is one with fewer runs.
                assert max(use[core] for core in chosen) <= min(use[core] for core in use if core not in chosen)
                for core in chosen:
                    use[core] += 1
        with cores.taken(1) as again:
            assert again is None or use.keys() >= set(again)

    @pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="there is but one core")
    def test_a_run_is_confined(self, launcher: Launcher, make_plan: Plan) -> None:
        plan = make_plan("Judging", compute=ComputeLimits(cpus=1))
        launcher.run(plan, never)
        extra = json.loads((plan.output_dir / "result.json").read_text())["extra"]
        assert len(extra["cores"]) == 1
        assert set(extra["cores"]) < os.sched_getaffinity(0)
        assert extra["core_files"] == [0, 0]


class TestGpu:
    CODE = "import os; print(repr(os.environ.get('CUDA_VISIBLE_DEVICES')), os.environ.get('NVIDIA_VISIBLE_DEVICES'))"

    @pytest.mark.parametrize(("gpu", "seen"), [(False, "'' \n"), (True, "'0' None\n")])
    def test_visibility(
        self, launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan, gpu: bool, seen: str,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:  # fmt: skip
        for name in ("CUDA_VISIBLE_DEVICES", "NVIDIA_VISIBLE_DEVICES"):
            monkeypatch.delenv(name, raising=False)
        plan = plan_programs(
            program(self.CODE, environment={} if gpu else {"CUDA_VISIBLE_DEVICES": "3"}),
            compute=ComputeLimits(gpu=gpu),
        )
        assert launcher.run(plan, never).status == "Completed"
        assert (plan.output_dir / "logs/robot.stdout.log").read_text() == seen


def test_no_limits(launcher: Launcher, program: MakeProgram, plan_programs: ProgramsPlan) -> None:
    limits = ComputeLimits(processes=None)
    plan = plan_programs(program("import resource; print(resource.getrlimit(resource.RLIMIT_NPROC))"), compute=limits)
    assert launcher.run(plan, never).status == "Completed"
    found = (plan.output_dir / "logs/robot.stdout.log").read_text()
    assert found == f"{resource.getrlimit(resource.RLIMIT_NPROC)}\n"
