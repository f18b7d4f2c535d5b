"""Warm-up of a waiting process: does once what every run does before its first step.

A forked process pays for each page of memory that it touches first. A run touches thousands of them while it builds its
world, which takes a third of the time to its first step. A warm-up in a world of boxes touches most of them before a
job waits for it. It leaves no files behind, and seeds are set when the run begins.
"""

import io
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path

import numpy as np

from ....schemas.runs.plan import RunPlan
from ....schemas.worlds.world import Floorplan, Furniture, Room, World
from ..applications.indoor_navigation.environment import make_environment
from ..applications.scout.agent import make_agent
from ..episode.context import SimulationContext
from ..recording.recording import McapRecorder
from ..states.digest import digest_of_model
from .rehearsal_folders import make_locked_folder, remove_abandoned_folders

HasRun = Callable[[float], bool]
"""Function that waits for a run for some seconds, and returns whether there is one."""

LOADAVG = Path("/proc/loadavg")
_LOOK_AGAIN_S = 0.25
_SHELVES = 12
_BOARDS = 24
_CELL_M = 0.05
_HALF_M = 3.0


@contextmanager
def rehearsal_room() -> Iterator[Path | None]:
    """Creates a temporary folder with a small world for warming up; `None` if it cannot be written.

    Folders that killed processes left behind are deleted; the processes that use a folder hold a lock on it. The
    new one is deleted at the end of the `with` block.
    """
    folder, lock = None, None
    try:
        with suppress(OSError):  # runs begin without a rehearsal too
            remove_abandoned_folders()
            folder, lock = make_locked_folder()
            _furnish(folder)
        yield folder
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def _furnish(folder: Path) -> None:
    (folder / "world.xml").write_text(_mjcf())
    cells = round(2 * _HALF_M / _CELL_M)
    (folder / "map.pgm").write_bytes(f"P5\n{cells} {cells}\n255\n".encode() + b"\xfe" * cells**2)
    (folder / "map.yaml").write_text(
        f"image: map.pgm\nmode: trinary\nresolution: {_CELL_M}\norigin: [{-_HALF_M}, {-_HALF_M}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def rehearse(room: Path | None, has_run: HasRun, is_idle: Callable[[], bool] | None = None) -> None:
    """Warms up an idle process: runs one simulation step so that imports and caches are ready for a run.

    Nothing is done while the processors are busy. Errors are ignored: the run will fail in the same way, and report it.
    Nothing is done without a folder, either. The simulation's work folder is deleted afterwards.

    Args:
        room: Folder with the small world, from `rehearsal_room`.
        has_run: Called between the parts of the warm-up, which take milliseconds each; true ends it.
        is_idle: Function that returns whether a processor is idle; absent: `has_idle_processor`.
    """
    if room is None:
        return
    is_idle = is_idle or has_idle_processor
    while not is_idle():
        if has_run(_LOOK_AGAIN_S):
            return
    folder = room / str(os.getpid())
    # Its output must not get into the log of the run that this process becomes.
    with suppress(Exception), redirect_stdout(io.StringIO()):
        folder.mkdir()
        for _ in _parts(room, folder):
            if has_run(0.0):
                break
    shutil.rmtree(folder, ignore_errors=True)


def _parts(room: Path, folder: Path) -> Iterator[None]:
    plan = RunPlan(
        job_id="sim-rehearsal", job_arn="", run_id="rehearsal", seed=0, max_duration_s=1.0, world_dir=room,
        work_dir=folder, output_dir=folder,
    )  # fmt: skip
    with McapRecorder(folder / "recording.mcap") as recorder:
        context = SimulationContext(
            plan=plan, rng=np.random.default_rng(0), world=World.model_validate_json(_world().model_dump_json()),
            world_dir=room, data_dir=None, output_dir=folder, environment={}, recorder=recorder,
        )  # fmt: skip
        yield
        environment = make_environment(context)
        yield
        agent = make_agent(context, environment)
        yield
        timestep = environment.reset()
        yield
        digest_of_model(environment.physics.model.ptr)
        environment.step(agent(timestep))
        yield


def has_idle_processor(loadavg: Path = LOADAVG, processors: int | None = None) -> bool:
    """Whether the machine has an idle processor, judged by the number of runnable threads.

    Args:
        loadavg: Kernel file with the number of runnable threads.
        processors: Number of processors; absent: those of this process.
    """
    try:
        running = int(loadavg.read_text().split()[3].split("/")[0]) - 1
    except (OSError, ValueError, IndexError):
        return False
    return running < (processors or len(os.sched_getaffinity(0)))


def _mjcf() -> str:
    walls = [(0.0, _HALF_M, _HALF_M, 0.05), (0.0, -_HALF_M, _HALF_M, 0.05)]
    walls += [(_HALF_M, 0.0, 0.05, _HALF_M), (-_HALF_M, 0.0, 0.05, _HALF_M)]
    boxes = [f'<geom name="wall-{n}" type="box" pos="{x} {y} 1.25" size="{w} {d} 1.25"/>'
             for n, (x, y, w, d) in enumerate(walls)]  # fmt: skip
    for shelf in range(_SHELVES):
        x = -2.6 + 0.45 * shelf
        boxes += [
            f'<geom name="Shelf-{shelf}/{board}" type="box" pos="{x:.2f} 2.7 {0.05 + 0.08 * board:.2f}" '
            'size="0.2 0.15 0.02" material="wood"/>'
            for board in range(_BOARDS)
        ]
    return (
        '<mujoco><option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="10"/>'
        '<asset><texture name="wood" type="2d" builtin="checker" width="256" height="256"/>'
        '<material name="wood" texture="wood"/></asset>'
        '<worldbody><light type="directional" pos="0 0 5"/><geom name="floor" type="box" pos="0 0 -0.05" '
        f'size="{_HALF_M} {_HALF_M} 0.05"/>{"".join(boxes)}'
        '<body name="Ball" pos="1.5 1.5 0.1"><freejoint/><geom name="Ball/ball" size="0.1"/></body>'
        "</worldbody></mujoco>"
    )


def _world() -> World:
    corners = [(-_HALF_M, -_HALF_M), (_HALF_M, -_HALF_M), (_HALF_M, _HALF_M), (-_HALF_M, _HALF_M)]
    area_m2 = (2 * _HALF_M) ** 2
    room = Room(
        name="room", type="Living", polygon=corners, area_m2=area_m2, desired_area_m2=area_m2,
        desired_aspect_ratio=1.0, goal=(1.0, 1.0),
    )  # fmt: skip
    plan = Floorplan(footprint=corners, ceiling_height_m=2.5, rooms=[room], walls=[], passages=[], wishes=[])
    ball = Furniture(
        id="Ball", model_type="Ball", room="room", x=1.5, y=1.5, yaw=0.0, width_m=0.2, depth_m=0.2, height_m=0.2,
        movable=True,
    )  # fmt: skip
    return World(
        generator_version="rehearsal", floorplan_seed=0, interior_seed=0, floorplan=plan, furniture=[ball], wishes=[]
    )
