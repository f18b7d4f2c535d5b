"""What a world costs; prints figures and asserts no time."""

import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from prefect_robomaker.schemas.world_template_body import WorldTemplateBody
from prefect_robomaker.tasks.worldforge.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for
from prefect_robomaker.tasks.worldforge.interior import furnish
from prefect_robomaker.tasks.worldforge.mjcf import world_mjcf
from prefect_robomaker.tasks.worldforge.preview import render_preview

WORLDS = 12
STEPS = 5000
ROOMS = (
    ("Living Room", "Living", 26.0),
    ("Kitchen", "Kitchen", 14.0),
    ("Bedroom", "Bedroom", 16.0),
    ("Bath", "Bathroom", 10.0),
)

ROBOT = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 0.05">
      <freejoint/>
      <geom type="cylinder" size="0.12 0.04" pos="0 0 0.03" mass="1.5"/>
      <geom type="sphere" size="0.015" pos="-0.09 0 -0.035" mass="0.02" friction="0.01" priority="1" condim="3"/>
      <body pos="0.02 0.1 0"><joint name="left" axis="0 1 0"/>
        <geom type="cylinder" size="0.05 0.01" euler="90 0 0" mass="0.05"/></body>
      <body pos="0.02 -0.1 0"><joint name="right" axis="0 1 0"/>
        <geom type="cylinder" size="0.05 0.01" euler="90 0 0" mass="0.05"/></body>
    </body>
  </worldbody>
  <actuator>
    <velocity joint="left" kv="0.05" forcerange="-0.1 0.1"/>
    <velocity joint="right" kv="0.05" forcerange="-0.1 0.1"/>
  </actuator>
</mujoco>
"""


def flat_template() -> WorldTemplateBody:
    shape = {"AspectRatio": {"x": 4.0, "y": 3.0}}
    rooms = [{"Name": name, "Type": kind, "DesiredShape": {"Area": area, **shape}} for name, kind, area in ROOMS]
    return WorldTemplateBody.model_validate({"Buildings": [{"Floors": [{"Floorplan": {"Rooms": rooms}}]}]})


def cpu_ms(work: Callable[[int], object]) -> str:
    """Median and worst CPU time over some worlds."""
    work(WORLDS)
    times = []
    for index in range(WORLDS):
        start = time.process_time()
        work(index)
        times.append(1e3 * (time.process_time() - start))
    return f"{np.median(times):6.1f} ms median, {max(times):6.1f} ms worst"


@pytest.mark.benchmark
def test_what_a_world_costs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    body = flat_template()
    worlds = [generate_world(body, *seeds_for(7, index, 0)) for index in range(WORLDS + 1)]
    plans = [generate_floorplan(body, np.random.default_rng(world.floorplan_seed)) for world in worlds]
    figures = {
        "floor plan": cpu_ms(lambda i: generate_floorplan(body, np.random.default_rng(i))),
        "interior": cpu_ms(lambda i: furnish(body, plans[i], np.random.default_rng(i))),
        "writing MJCF": cpu_ms(lambda i: world_mjcf(worlds[i])),
        "world, checked": cpu_ms(lambda i: generate_world(body, *seeds_for(7, i, 0), settle=False)),
        "world, checked and settled": cpu_ms(lambda i: generate_world(body, *seeds_for(7, i, 0))),
        "bundle without preview": cpu_ms(lambda i: write_bundle(worlds[i], tmp_path / f"{i}", preview=False)),
        "preview": cpu_ms(lambda i: render_preview(worlds[i])),
    }
    rates = [steps_per_second(world_mjcf(world)) for world in worlds[:4]]
    geoms = [world.checks.geoms for world in worlds if world.checks]
    pieces = [len(world.furniture) for world in worlds]
    with capsys.disabled():
        print()
        for name, figure in figures.items():
            print(f"{name:28s} {figure}")
        print(f"{'geoms':28s} {np.median(geoms):.0f} median, {max(geoms)} at most; {np.median(pieces):.0f} pieces")
        print(f"{'physics, robot driving':28s} {np.median(rates):.0f} steps/s (mj_step, nstep=10)")
    assert max(geoms) < 350


def steps_per_second(mjcf: str) -> float:
    """Steps per CPU second while a robot drives in circles and everything else sleeps."""
    world, robot = mujoco.MjSpec.from_string(mjcf), mujoco.MjSpec.from_string(ROBOT)
    world.worldbody.add_frame().attach_body(robot.body("base"), "robot/", "")
    model = world.compile()
    data = mujoco.MjData(model)
    data.ctrl[:] = 3.0, 2.0
    mujoco.mj_step(model, data, nstep=500)
    start = time.process_time()
    for _ in range(STEPS // 10):
        mujoco.mj_step(model, data, nstep=10)
    return STEPS / (time.process_time() - start)
