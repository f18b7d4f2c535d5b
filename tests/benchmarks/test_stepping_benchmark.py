"""What a simulation job costs beside physics alone; prints figures and asserts no time.

Measured is CPU time from the first time step handed to the agent to the end of the episode, so with planning, sensing,
keeping the score, recording and closing the recording, but without what happens once before: reading the map and
working out the ways on it, compiling the world, the first lidar scan. Physics alone is `mj_step` from the same state,
with the same controls, over the same steps; that both end in the same state proves that they computed the same. A
further figure adds what lidar and bumper measure, which no job can do without. Every run is the same, so runs take
turns and of each lap, a second of simulated time, the best counts: what else happens on a machine only ever makes
things slower.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.paths import REPOSITORY
from numpy.typing import NDArray
from ruamel.yaml import YAML

os.environ.setdefault("MUJOCO_GL", "egl")

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.applications.indoor_navigation import lidar
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import IndoorNavigation
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.navigation_task import NavigationTask
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.world_with_robot import (
    CONTACT_SAMPLE_STEPS,
    assemble,
)
from prefect_robomaker.tasks.runtime.applications.scout.agent import make_agent
from prefect_robomaker.tasks.runtime.episode.context import SimulationContext
from prefect_robomaker.tasks.runtime.episode.progress import Phase, Progress
from prefect_robomaker.tasks.runtime.episode.run_results import Observer
from prefect_robomaker.tasks.runtime.process.run_loop import run_episode
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder, Recorder
from prefect_robomaker.tasks.runtime.robots.robot import Robot
from prefect_robomaker.tasks.runtime.robots.scout import SCOUT
from prefect_robomaker.tasks.runtime.robots.walker import WALKER
from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world, write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

QUICKSTART = REPOSITORY / "deployments" / "specs" / "quickstart.yaml"
Laps = NDArray[np.float64]
ROUNDS = 6
SUBSTEPS = 25
LAP_STEPS = 20
TIME_LIMIT_S = 1000.0
HOUSE = (
    ("Hallway", "Hallway", 14.0),
    ("Living", "Living", 32.0),
    ("Kitchen", "Kitchen", 16.0),
    ("Bedroom", "Bedroom", 18.0),
    ("Guest room", "Bedroom", 13.0),
    ("Bathroom", "Bathroom", 10.0),
)


def template(kind: str) -> WorldTemplateBody:
    """The quickstart's flat of four rooms, or a house of six."""
    if kind == "flat":
        specification = YAML(typ="safe").load(QUICKSTART.read_text())
        return WorldTemplateBody.model_validate(specification["steps"]["template"]["input"]["templateBody"])
    shape = {"AspectRatio": {"x": 4.0, "y": 3.0}}
    rooms = [{"Name": name, "Type": kind, "DesiredShape": {"Area": area, **shape}} for name, kind, area in HOUSE]
    return WorldTemplateBody.model_validate({"Buildings": [{"Floors": [{"Floorplan": {"Rooms": rooms}}]}]})


class Stopwatch:
    """Marks phases as a job does, and takes the CPU time of laps from the first step to the end of the last one."""

    reason = ""  # these runs are not stopped

    def __init__(self) -> None:
        self._progress = Progress()
        self._steps = 0
        self.times: list[float] = []

    def mark(self, phase: int) -> None:
        self._progress.mark(phase)
        if phase == Phase.AGENT:
            if self._steps % LAP_STEPS == 0:
                self.times.append(time.process_time())
            self._steps += 1
        elif phase == Phase.REPORT:
            self.times.append(time.process_time())


class Witness(Observer):
    """Notes the state at the beginning, the controls every 10 ms, and the state at the end, for physics to repeat."""

    next_time_s = 0.0

    def __init__(self) -> None:
        self.controls: list[NDArray[np.float64]] = []
        self.beginning: mujoco.MjData | None = None

    def watch(self, environment: Any, time_s: float) -> None:
        del time_s
        model, data = environment.physics.model.ptr, environment.physics.data.ptr
        if self.beginning is None:
            self.model, self.robot = model, environment.robot
            self.unseen_group = environment.physics.unseen_group
            self.beginning = copied(model, data)
            self._note_controls(environment.physics, data)
        else:
            self.end = data.qpos.copy()

    def _note_controls(self, physics: Any, data: mujoco.MjData) -> None:
        look = physics.between_substeps

        def note_and_look() -> None:
            self.controls.append(data.ctrl.copy())
            look()

        physics.between_substeps = note_and_look

    @property
    def changes(self) -> list[NDArray[np.float64] | None]:
        """The controls where they differ from those before."""
        same = [False, *(np.array_equal(*pair) for pair in zip(self.controls, self.controls[1:], strict=False))]
        return [None if is_same else each for each, is_same in zip(self.controls, same, strict=True)]


def run_job(folder: Path, robot: Robot, recorder: Recorder, watchers: tuple[Witness, ...] = ()) -> Laps:
    """Drives a robot through the world as a job's process does; returns the CPU seconds of the laps of its loop."""
    plan = RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run-1", seed=1, max_duration_s=600.0, world_dir=folder,
        work_dir=folder.parent, output_dir=folder.parent,
    )  # fmt: skip
    context = SimulationContext(
        plan=plan, rng=np.random.default_rng(1), world=read_world(folder), world_dir=folder, data_dir=None,
        output_dir=folder.parent, environment={}, recorder=recorder,
    )  # fmt: skip

    def make_environment() -> IndoorNavigation:
        assert context.world is not None
        task = NavigationTask(context.world, robot, context.rng, recorder, TIME_LIMIT_S)
        return IndoorNavigation(assemble(folder / "world.xml", robot), task, robot)

    watch = Stopwatch()
    episode = run_episode(
        make_environment,
        lambda environment: make_agent(context, environment),
        mark=watch.mark,
        stop=watch,
        recorder=recorder,
        watchers=watchers,
    )
    closing = time.process_time()
    recorder.close()
    assert episode.report.verdict == "PASS", episode.report.summary
    return np.append(np.diff(watch.times), time.process_time() - closing)


def step_only(witness: Witness, *, sensors: bool = False) -> Laps:
    """CPU seconds of the laps of a plain loop of `mj_step`, with or without the same measurements."""
    model = witness.model
    data = copied(model, witness.beginning)
    step, control, changes = mujoco.mj_step, data.ctrl, witness.changes
    look = range_finders(witness, data) if sensors else ()
    per_scan = witness.robot.lidar.every_steps * SUBSTEPS // CONTACT_SAMPLE_STEPS if witness.robot.lidar else 0
    per_lap = LAP_STEPS * SUBSTEPS // CONTACT_SAMPLE_STEPS
    times = [time.process_time()]
    for first in range(0, len(changes), per_lap):
        for number, change in enumerate(changes[first : first + per_lap], first + 1):
            if change is not None:
                control[:] = change
            for _ in range(CONTACT_SAMPLE_STEPS):
                step(model, data)
            if look and number % per_scan == 0:
                for finder in look:
                    finder.measure()
        times.append(time.process_time())
    np.testing.assert_array_equal(data.qpos, witness.end)
    return np.diff(times)


def range_finders(witness: Witness, data: mujoco.MjData) -> tuple[lidar.RangeFinder, lidar.RangeFinder]:
    model, group, robot = witness.model, witness.unseen_group, witness.robot
    body = robot.footprint_id(model)
    assert robot.lidar is not None
    far = (robot.lidar.height_m, robot.lidar.angles_rad, robot.lidar.range_max_m)
    near = (robot.proximity_height_m, lidar.PROXIMITY_ANGLES_RAD, lidar.PROXIMITY_RANGE_MAX_M)
    return lidar.RangeFinder(model, data, body, *far, group), lidar.RangeFinder(model, data, body, *near, group)


def copied(model: mujoco.MjModel, data: mujoco.MjData | None) -> mujoco.MjData:
    copy = mujoco.MjData(model)
    mujoco.mj_copyData(copy, model, data)
    return copy


@pytest.mark.benchmark
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("kind", "robot", "scans_hz"), [("flat", SCOUT, 5), ("flat", SCOUT, 10), ("house", SCOUT, 10), ("flat", WALKER, 10)]
)
def test_job_against_physics_alone(
    kind: str, robot: Robot, scans_hz: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "world"
    write_bundle(generate_world(template(kind), *seeds_for(7, 0, 0)), folder)
    assert robot.lidar is not None
    robot = replace(robot, lidar=replace(robot.lidar, rate_hz=scans_hz))
    witness = Witness()
    run_job(folder, robot, Recorder(), (witness,))
    physics, sensors, silent, recorded = [], [], [], []
    for number in range(ROUNDS):
        physics.append(step_only(witness))
        sensors.append(step_only(witness, sensors=True))
        silent.append(run_job(folder, robot, Recorder()))
        recorded.append(run_job(folder, robot, McapRecorder(tmp_path / f"{number}.mcap")))
    count = len(witness.controls) * CONTACT_SAMPLE_STEPS // SUBSTEPS
    loop, rays, job, job_recorded = (
        1e6 * np.min(laps, axis=0).sum() / count for laps in (physics, sensors, silent, recorded)
    )
    with capsys.disabled():
        print(
            f"\n{kind}, {robot.name}, scans at {scans_hz} Hz: {witness.model.ngeom} geoms, {count * SUBSTEPS} steps of "
            f"physics in {count} of control; physics alone {1000 * SUBSTEPS / loop:.1f}k steps/s; "
            f"job {loop / job:.2f} of a loop of mj_step, with recording {loop / job_recorded:.2f}; "
            f"of physics and sensors {rays / job:.2f}, with recording {rays / job_recorded:.2f}; "
            f"microseconds per control step: loop {loop:.0f}, and sensors {rays:.0f}, "
            f"job {job:.0f}, with recording {job_recorded:.0f}"
        )
