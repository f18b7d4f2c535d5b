"""What a whole run costs beside physics alone; prints figures and asserts no time."""

import os
import time
from pathlib import Path

import mujoco
import numpy as np
import pytest

os.environ.setdefault("MUJOCO_GL", "egl")

from prefect_robomaker.schemas.simulation_run import RunPlan
from prefect_robomaker.schemas.world_template_body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.applications.indoor_navigation import IndoorNavigation, make_environment
from prefect_robomaker.tasks.runtime.applications.scout import make_agent
from prefect_robomaker.tasks.runtime.context import Recorder, SimulationContext
from prefect_robomaker.tasks.runtime.recording import McapRecorder, NullRecorder
from prefect_robomaker.tasks.worldforge.bundle import read_world, write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world

ROUNDS = 3
SUBSTEPS = 25
FLATS = {
    "flat": (("Living", 22.0), ("Bedroom", 14.0), ("Bathroom", 10.0)),
    "house": (("Hallway", 14.0), ("Living", 32.0), ("Kitchen", 16.0), ("Bedroom", 18.0), ("Bathroom", 10.0)),
}


def make_context(folder: Path, recorder: Recorder) -> SimulationContext:
    plan = RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run-1", seed=1, max_duration_s=600.0, world_dir=folder,
        work_dir=folder.parent, output_dir=folder.parent,
    )  # fmt: skip
    return SimulationContext(
        plan=plan, rng=np.random.default_rng(1), world=read_world(folder), world_dir=folder, data_dir=None,
        output_dir=folder.parent, environment={}, recorder=recorder,
    )  # fmt: skip


def drive(context: SimulationContext) -> tuple[float, IndoorNavigation, list[np.ndarray]]:
    """A run as the runtime's loop does it: CPU time, environment, wheel commands."""
    environment = make_environment(context)
    agent = make_agent(context, environment)
    control = environment.physics.data.ptr.ctrl
    commands = []
    start = time.process_time()
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(agent(timestep))
        commands.append(control.copy())
    return time.process_time() - start, environment, commands


def step_only(model: mujoco.MjModel, commands: list[np.ndarray]) -> float:
    """CPU time of the same physics with the same commands and nothing else."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start = time.process_time()
    for command in commands:
        data.ctrl[:] = command
        mujoco.mj_step(model, data, SUBSTEPS)
    return time.process_time() - start


@pytest.mark.benchmark
@pytest.mark.parametrize("kind", FLATS)
def test_whole_run_against_physics_alone(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shape = {"AspectRatio": {"x": 4.0, "y": 3.0}}
    rooms = [{"Name": name, "Type": name, "DesiredShape": {"Area": area, **shape}} for name, area in FLATS[kind]]
    body = WorldTemplateBody.model_validate({"Buildings": [{"Floors": [{"Floorplan": {"Rooms": rooms}}]}]})
    folder = tmp_path / "world"
    write_bundle(generate_world(body, 1, 1), folder, preview=False)
    physics, silent, recorded = [], [], []
    for number in range(ROUNDS):
        seconds, environment, commands = drive(make_context(folder, NullRecorder()))
        silent.append(seconds)
        physics.append(step_only(environment.physics.model.ptr, commands))
        recorder = McapRecorder(tmp_path / f"{number}.mcap")
        recorded.append(drive(make_context(folder, recorder))[0])
        recorder.close()
    assert environment.run_result().verdict == "PASS"
    base = min(physics)
    steps = len(commands) * SUBSTEPS
    geoms = environment.physics.model.ngeom
    with capsys.disabled():
        print(
            f"\n{kind}: {geoms} geoms, {steps} steps, {steps / base / 1000:.1f}k steps/s alone; "
            f"whole run {base / min(silent):.2f} of that, recorded {base / min(recorded):.2f}; "
            f"{len(commands) * 0.05 / min(recorded):.0f}x real time"
        )
