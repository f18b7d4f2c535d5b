"""What filming costs a run; prints figures and asserts no time.

Scout drives through a furnished flat of six rooms for 60 s of simulated time with everything that a job does: sensing,
keeping the score, recording. Measured is the CPU time of the run's process, a fork of one that has imported everything,
from making the environment to the end of the last file. Every run is the same, so runs take turns and of each kind the
best counts: what else happens on a machine only ever makes things slower.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import os
import time
from pathlib import Path

import mujoco
import numpy as np
import pytest

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, VideoPolicy
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.world_with_robot import assemble
from prefect_robomaker.tasks.runtime.episode.progress import Progress
from prefect_robomaker.tasks.runtime.process.child import run_child
from prefect_robomaker.tasks.runtime.states.state_log import StateLogWriter
from prefect_robomaker.tasks.runtime.supervision.run_requests import make_request
from prefect_robomaker.tasks.runtime.video.video import ViewRenderer
from prefect_robomaker.tasks.runtime.video.video_settings import VideoSettings
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

ROUNDS = 3
SIM_TIME_S = 60
ROOMS = (
    ("Hallway", 14.0),
    ("Living", 32.0),
    ("Kitchen", 16.0),
    ("Bedroom", 18.0),
    ("Bedroom", 13.0),
    ("Bathroom", 10.0),
)
SMALL = {"ROBOMAKER_VIDEO_SIZE": "320x240", "ROBOMAKER_VIDEO_FPS": "10"}
KINDS = {
    "no video": ("none", {}),
    "on-failure, while it runs": ("on-failure", {}),
    "320x240 at 10 Hz, follow": ("always", SMALL | {"ROBOMAKER_VIDEO_CAMERA": "follow"}),
    "320x240 at 10 Hz, both": ("always", SMALL | {"ROBOMAKER_VIDEO_CAMERA": "both"}),
    "320x240 at 10 Hz, top": ("always", SMALL | {"ROBOMAKER_VIDEO_CAMERA": "top"}),
    "640x480 at 15 Hz, follow": ("always", {"ROBOMAKER_VIDEO_CAMERA": "follow"}),
}


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("world") / "flat"
    shape = {"AspectRatio": {"x": 4.0, "y": 3.0}}
    rooms = [
        {"Name": f"{kind} {number}", "Type": kind, "DesiredShape": {"Area": area, **shape}}
        for number, (kind, area) in enumerate(ROOMS)
    ]
    body = WorldTemplateBody.model_validate({"Buildings": [{"Floors": [{"Floorplan": {"Rooms": rooms}}]}]})
    write_bundle(generate_world(body, *seeds_for(7, 0, 0)), folder)
    return folder


def plan_of(world: Path, folder: Path, video: VideoPolicy, variables: dict[str, str]) -> RunPlan:
    arena = ApplicationPlan(
        role="simulation", name="indoor-navigation",
        attribute="prefect_robomaker.tasks.runtime.applications.indoor_navigation.make_environment",
        environment_variables={"ROBOMAKER_SIM_TIME_LIMIT_S": str(SIM_TIME_S), **variables},
    )  # fmt: skip
    return RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run-1", seed=1, max_duration_s=600.0, world_dir=world,
        work_dir=folder / "work", output_dir=folder / "out", simulation_application=arena, video=video,
    )  # fmt: skip


def cpu_s(plan: RunPlan) -> float:
    """CPU time of a run's process."""
    plan.work_dir.mkdir(parents=True)
    plan.output_dir.mkdir()
    request, progress = make_request(plan, None), Progress()
    if (pid := os.fork()) == 0:
        os._exit(run_child(request, progress))
    _, status, used = os.wait4(pid, 0)
    assert status == 0, progress.read_report()
    return used.ru_utime + used.ru_stime


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_a_minute_of_navigation(world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    measured: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for number in range(ROUNDS):
        for kind, (video, variables) in KINDS.items():
            measured[kind].append(cpu_s(plan_of(world, tmp_path / f"{kind} {number}", video, variables)))
    with capsys.disabled():
        print(f"\nCPU seconds of {SIM_TIME_S} s simulated (load {os.getloadavg()[0]:.1f} at the end):")
        for kind, figures in measured.items():
            film = next((tmp_path / f"{kind} 0" / "out").glob("*.mp4"), None)
            size = f", {film.stat().st_size / 1e6:.2f} MB" if film else ""
            print(f"  {kind}: {min(figures):.2f} (all: {', '.join(f'{each:.2f}' for each in figures)}){size}")


@pytest.mark.benchmark
def test_a_state_in_the_log(world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    physics = assemble(world / "world.xml")
    model, data = physics.model.ptr, physics.data.ptr
    writer, frames = StateLogWriter(tmp_path / "log", 15.0), 1500
    spent, stepping = [], 0.0
    for number in range(frames):
        data.ctrl[:2] = 5.0 + np.sin(number / 30), 5.0 - np.sin(number / 30)
        began = time.thread_time()
        mujoco.mj_step(model, data, 33)
        stepping += time.thread_time() - began
        began = time.perf_counter()
        writer.note(model, data, number / 15)
        spent.append(time.perf_counter() - began)
    writer.close()
    size = (tmp_path / "log" / "states.log").stat().st_size / frames
    packing = np.mean(np.sort(spent[1:])[-frames // 64 :])  # those that wrote a chunk
    with capsys.disabled():
        print(
            f"\na state in the log, {model.nq} positions: {1e6 * np.median(spent):.1f} us, "
            f"every 64th {1e6 * packing:.0f} us, "
            f"{size:.0f} bytes; the model once {1e3 * spent[0]:.1f} ms; "
            f"{100 * (np.median(spent) + packing / 64) * frames / stepping:.2f} % of physics alone"
        )


@pytest.mark.benchmark
@pytest.mark.parametrize("size", [(320, 240), (640, 480)])
def test_a_picture_without_opengl(world: Path, size: tuple[int, int], capsys: pytest.CaptureFixture[str]) -> None:
    physics = assemble(world / "world.xml")
    figures = []
    for camera in ("follow", "top", "both"):
        filming = ViewRenderer(physics.model.ptr, VideoSettings(camera, size), "rays")
        times = []
        for _ in range(5):
            began = time.thread_time()
            filming.picture(physics.data.ptr)
            times.append(time.thread_time() - began)
        figures.append(f"{camera} {1e3 * min(times):.0f} ms")
    with capsys.disabled():
        print(f"\na picture of {size[0]} x {size[1]} by rays, CPU: {', '.join(figures)}")
