from pathlib import Path

import mujoco
import numpy as np
import pytest
from dm_control.rl.control import PhysicsError

from prefect_robomaker.tasks.runtime.applications.indoor_navigation.world_with_robot import (
    CONTACT_SAMPLE_STEPS,
    assemble,
)


def test_a_step_looks_in_between_and_at_its_end(make_context) -> None:
    physics = assemble(make_context().world_dir / "world.xml")
    times: list[float] = []
    physics.between_substeps = lambda: times.append(physics.data.time)
    physics.step(2 * CONTACT_SAMPLE_STEPS + 1)
    steps = np.array(times) / physics.timestep()
    assert steps == pytest.approx([CONTACT_SAMPLE_STEPS, 2 * CONTACT_SAMPLE_STEPS, 2 * CONTACT_SAMPLE_STEPS + 1])


def test_diverging_physics_say_what_is_wrong(make_context) -> None:
    physics = assemble(make_context().world_dir / "world.xml")
    physics.step(10)
    physics.data.qvel[0] = np.nan
    with pytest.raises(PhysicsError, match="MuJoCo warns of mjWARN_BADQVEL"):
        physics.step(10)
    physics.step(10)  # MuJoCo began anew; the warning of before does not count again


def test_names_are_there_when_somebody_asks_and_follow_the_data(make_context) -> None:
    world = make_context().world_dir / "world.xml"
    physics = assemble(world)
    before = physics.named
    assert physics.named is before
    assert physics.named.model.body_mass["scout/base"] > 0
    physics.named.data.qpos["scout/base"][0] = 0.25
    assert physics.data.qpos[int(physics.model.ptr.joint("scout/base").qposadr[0])] == 0.25
    physics.reload_from_xml_path(str(world))
    with pytest.raises(KeyError, match="scout/base"):
        physics.named.model.body_mass["scout/base"]


PLAIN = """
<mujoco><worldbody>
  <geom type="box" size="5 5 .1" pos="0 0 -.1"/>
  <body name="cup" pos="2 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  <body name="leaf" pos="-2 0 0"><joint name="leaf"/><geom type="box" size=".4 .02 1" pos=".4 0 1.1"/></body>
</worldbody></mujoco>
"""


def test_what_is_loose_in_a_plain_world_sleeps_until_something_touches_it(tmp_path: Path) -> None:
    (tmp_path / "world.xml").write_text(PLAIN)
    physics = assemble(tmp_path / "world.xml")
    model, data = physics.model.ptr, physics.data.ptr
    assert model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP
    for name in ("cup", "leaf"):
        policy = model.tree_sleep_policy[model.body_treeid[model.body(name).id]]
        assert policy == mujoco.mjtSleepPolicy.mjSLEEP_INIT
    robot = model.tree_sleep_policy[model.body_treeid[model.body("scout/base").id]]
    assert robot != mujoco.mjtSleepPolicy.mjSLEEP_INIT
    physics.step(50)
    bodies = model.geom_bodyid[data.contact.geom]
    assert not np.isin(bodies, [model.body("cup").id, model.body("leaf").id]).any(), "asleep, it has no contacts"
    data.qpos[model.joint("scout/base").qposadr[0]] = 1.78  # into the cup
    physics.step(5)
    assert np.isin(model.geom_bodyid[data.contact.geom], model.body("cup").id).any()


def test_wheels_slip_on_floors_of_stated_friction_and_slides_stay_slippery(tmp_path: Path) -> None:
    """Variations in friction state it by priority; of equal priorities MuJoCo would take the larger friction."""
    (tmp_path / "world.xml").write_text(PLAIN.replace('"5 5 .1"', '"5 5 .1" friction="0.3" priority="2"'))
    physics = assemble(tmp_path / "world.xml")
    model, data = physics.model.ptr, physics.data.ptr
    data.qpos[model.joint("scout/base").qposadr[0] + 2] = -0.003
    mujoco.mj_forward(model, data)
    found = {model.geom(int(geom)).name: float(each.friction[0]) for each in data.contact for geom in each.geom}
    assert {name: round(found[f"scout/{name}"], 3) for name in ("slide_front", "wheel_left", "wheel_right")} == {
        "slide_front": 0.01,
        "wheel_left": 0.3,
        "wheel_right": 0.3,
    }
