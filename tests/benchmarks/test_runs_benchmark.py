"""What it takes to start, cancel and hold a run; prints figures and asserts no time.

Start: from the call of the launcher, whose warm process runs already, to the first step of the simulation, on the
clock that all processes share; right after the end of another run, as in a batch, and half a second after it.
Cancel: from the answer that a run is to stop until none of its processes is left. Memory: of the run's process at the
end of a run without video, as peak resident memory (with all that it shares with the warm process and other runs) and
as proportional memory (what is shared counts by its share).
"""

import json
import os
import statistics
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.run_processes import processes_with
from helpers.small_flat import BODY

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.programs import RunStop
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

ROUNDS = 21
RUN_S = 0.5
ARENA = '''
"""Environments that write down when they were first stepped, and what their process used at the end."""

import json
import signal
import time
from pathlib import Path

import dm_env
import numpy as np
from dm_control import mujoco
from dm_control.rl import control
from dm_env import specs

from prefect_robomaker.tasks.runtime.applications import indoor_navigation, scout

PENDULUM = """<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="5 5 .1"/>
<body pos="0 0 1"><joint name="hinge" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.6" size=".05"/></body>
</worldbody><actuator><motor joint="hinge"/></actuator></mujoco>"""


class Swing(control.Task):
    def initialize_episode(self, physics):
        pass

    def before_step(self, action, physics):
        physics.data.ctrl[:] = action

    def after_step(self, physics):
        pass

    def action_spec(self, physics):
        return mujoco.action_spec(physics)

    def get_observation(self, physics):
        return {"angle": physics.data.qpos.copy()}

    def get_reward(self, physics):
        return 0.0


def measured(environment):
    step = environment.step

    def first(action):
        Path("first").write_text(str(time.monotonic()))
        environment.step = step
        return step(action)

    environment.step = first
    return environment


def small(context):
    physics = mujoco.Physics.from_xml_string(PENDULUM)
    limit = float(context.environment["LIMIT_S"])
    return measured(control.Environment(physics, Swing(), time_limit=limit, n_sub_steps=10))


def world(context):
    environment = measured(indoor_navigation.make_environment(context))
    report = environment.run_result

    def weighed():
        lines = dict(line.split(":", 1) for line in open("/proc/self/status"))
        share = next(line for line in open("/proc/self/smaps_rollup") if line.startswith("Pss:"))
        kib = {"peak": int(lines["VmHWM"].split()[0]), "proportional": int(share.split()[1])}
        (context.output_dir / "memory.json").write_text(json.dumps(kib))
        return report()

    environment.run_result = weighed
    return environment


def stubborn(context):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    return small(context)


def still(context, environment):
    action = np.zeros(environment.action_spec().shape)
    left = [20_000]

    def act(timestep):
        left[0] -= 1
        if left[0] <= 0 or timestep.last():
            raise StopIteration
        return action

    return act


def driver(context, environment):
    return scout.make_agent(context, environment)
'''


@pytest.fixture(scope="module")
def launcher() -> Iterator[Launcher]:
    with Launcher() as launcher:
        launcher.start()
        yield launcher


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bundle with the environments above, and a small world."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "bundle").mkdir()
    (folder / "bundle" / "arena.py").write_text(ARENA)
    world = generate_world(WorldTemplateBody.model_validate(BODY), *seeds_for(7, 0, 0))
    write_bundle(world, folder / "world")
    return folder


def plan_run(folder: Path, name: str, environment: str, agent: str, limit_s: float = 1000.0) -> RunPlan:
    path, run = folder / "bundle", folder / name
    return RunPlan(
        job_id="sim-1", job_arn="arn", run_id=name, seed=1, max_duration_s=120.0, world_dir=folder / "world",
        work_dir=run / "work", output_dir=run / "out",
        simulation_application=ApplicationPlan(
            role="simulation", name="arena", attribute=f"arena.{environment}", path=path,
            environment_variables={"LIMIT_S": str(limit_s)},
        ),
        robot_application=ApplicationPlan(role="robot", name="driver", attribute=f"arena.{agent}", path=path),
    )  # fmt: skip


def load() -> str:
    return f"load {os.getloadavg()[0]:.1f} on {len(os.sched_getaffinity(0))} cores"


def percentiles(values: list[float]) -> str:
    ordered = sorted(values)
    return f"p50 {statistics.median(ordered):.3g}, best {ordered[0]:.3g}, worst {ordered[-1]:.3g}"


@pytest.mark.benchmark
@pytest.mark.parametrize("environment", ["small", "world"])
@pytest.mark.parametrize("pause_s", [0.0, 0.5], ids=["in-a-batch", "alone"])
def test_job_start_to_first_step(
    launcher: Launcher, folder: Path, environment: str, pause_s: float, capsys: pytest.CaptureFixture[str]
) -> None:
    times_ms = []
    for number in range(ROUNDS):
        plan = plan_run(
            folder, f"start-{environment}-{pause_s}-{number}", environment,
            "still" if environment == "small" else "driver",
        )  # fmt: skip
        time.sleep(pause_s)
        began = time.monotonic()

        def stop(began: float = began) -> RunStop | None:
            return RunStop.CANCELED if time.monotonic() > began + RUN_S else None

        assert launcher.run(plan, stop).status in ("Canceled", "Completed")
        times_ms.append(1000.0 * (float((plan.work_dir / "first").read_text()) - began))
    with capsys.disabled():
        since = f"{pause_s:g} s after the end of another run"
        print(f"\nstart to first step, {environment}, {since}, ms: {percentiles(times_ms)}, target p50 50; {load()}")


@pytest.mark.benchmark
def test_a_run_of_three_steps(launcher: Launcher, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole_ms = []
    for number in range(ROUNDS):
        plan = plan_run(folder, f"short-{number}", "small", "still", 0.05)
        began = time.monotonic()
        assert launcher.run(plan, lambda: None).status == "Completed"
        whole_ms.append(1000.0 * (time.monotonic() - began))
    with capsys.disabled():
        print(f"\nstart to end of a run of 3 steps, at once after another, ms: {percentiles(whole_ms)}; {load()}")


@pytest.mark.benchmark
@pytest.mark.parametrize("environment", ["small", "stubborn"])
def test_cancel_to_all_gone(
    launcher: Launcher, folder: Path, environment: str, capsys: pytest.CaptureFixture[str]
) -> None:
    times_s = []
    for number in range(5):
        plan = plan_run(folder, f"cancel-{environment}-{number}", environment, "still")
        asked: list[float] = []

        def stop(plan: RunPlan = plan, asked: list[float] = asked) -> RunStop | None:
            if not (plan.work_dir / "first").exists():
                return None
            asked.append(time.monotonic())
            return RunStop.CANCELED

        assert launcher.run(plan, stop).status in ("Canceled", "Completed")
        times_s.append(time.monotonic() - asked[0])
        assert processes_with(str(plan.work_dir)) == []
    with capsys.disabled():
        print(f"\ncancel to all gone, {environment}, s: {percentiles(times_s)}, target 2; {load()}")


@pytest.mark.benchmark
def test_memory(launcher: Launcher, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = plan_run(folder, "memory", "world", "driver")
    assert launcher.run(plan, lambda: None).status == "Completed"
    kib = json.loads((plan.output_dir / "memory.json").read_text())
    with capsys.disabled():
        print(
            f"\nmemory of a run in a small world without video: peak {kib['peak'] / 1024:.0f} MiB resident, "
            f"{kib['proportional'] / 1024:.0f} MiB proportional, target 300"
        )
