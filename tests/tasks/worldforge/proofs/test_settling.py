"""Small pushes: what stands well stays, what stands badly falls, and a ball may roll."""

import mujoco
import pytest

from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.worldforge.model.mjcf import world_mjcf
from prefect_robomaker.tasks.worldforge.proofs.guarantees import MAX_DRIFT_M, violations
from prefect_robomaker.tasks.worldforge.proofs.overlaps import drift_m, measure_stability

FLOOR = '<geom type="box" size="3 3 .1" pos="0 0 -.1"/>'
BOX = '<body name="box" pos="1 0 .05"><freejoint/><geom type="box" size=".05 .05 .05" mass=".3"/></body>'
BALL = '<body name="ball" pos="-1 0 .1"><freejoint/><geom size=".1" mass=".3" condim="4"/></body>'
BOARD = '<body name="board" pos="0 0 .1"><freejoint/><geom type="box" size=".002 .08 .1" mass=".5"/></body>'


def model_of(*things: str) -> mujoco.MjModel:
    option = '<option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="10"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{FLOOR}{''.join(things)}</worldbody></mujoco>")


def test_what_stands_well_stays_and_a_ball_may_roll() -> None:
    stability = measure_stability(model_of(BOX, BALL), 1)
    assert stability.max_moved_m < 0.01
    assert stability.max_sunk_m < 0.001


def test_what_stands_badly_falls_though_it_rests_by_itself(flat: World) -> None:
    model = model_of(BOX, BOARD)
    assert drift_m(model, 2.0).max() < 0.01
    stability = measure_stability(model, 1)
    assert stability.furthest == "board"
    assert stability.max_sunk_m > 0.08
    assert flat.checks is not None
    (broken,) = violations(flat.checks.model_copy(update={"stability": stability}))
    assert broken.startswith("board, pushed a little, moves ")


@pytest.mark.parametrize(
    ("form", "size", "half_m"),
    [("box", ".1 .075 .015", 0.015), ("box", ".02 .02 .12", 0.12), ("cylinder", ".12 .01", 0.01)],
)
@pytest.mark.parametrize("over_mm", [-1.0, -0.2, -0.1, -0.03, -0.001, 0.0, 0.001, 0.1])
def test_what_is_balanced_on_an_edge_is_judged_as_if_nothing_ever_slept(
    form: str, size: str, half_m: float, over_mm: float
) -> None:
    table = '<geom type="box" pos="-.5 0 .35" size=".5 .5 .35"/>'
    geom = f'<geom type="{form}" size="{size}" mass=".5" condim="4" friction=".8 .02 .002"/>'
    thing = f'<body name="thing" pos="{1e-3 * over_mm} 0 {0.7 + half_m}"><freejoint/>{geom}</body>'
    model = model_of(table, thing)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=1000)
    falls = float(data.body("thing").xpos[2]) < 0.6
    assert falls or over_mm < 0
    assert (drift_m(model, 2.0).max() > MAX_DRIFT_M) == falls


def test_the_same_seed_pushes_the_same_way() -> None:
    assert measure_stability(model_of(BOX), 3) == measure_stability(model_of(BOX), 3)
    assert measure_stability(model_of(BOX), 3) != measure_stability(model_of(BOX), 4)


@pytest.mark.deep
def test_loose_objects_of_a_generated_flat_stay_when_pushed(flat: World) -> None:
    stability = measure_stability(mujoco.MjModel.from_xml_string(world_mjcf(flat)), 1)
    assert flat.checks is not None
    assert violations(flat.checks.model_copy(update={"stability": stability})) == []
