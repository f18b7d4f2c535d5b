"""Reaches of geoms, against points that MuJoCo's own ray casting finds on their surfaces, and by hand."""

import math

import mujoco
import numpy as np
import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.runtime.robots.robot_yaml.size_checks import geom_reach_m, solid_reach_m

WEDGE = "0 0 0  0.3 0 0  0 0.1 0  0 0 0.1"


def stand(*geoms: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="wedge" vertex="{WEDGE}"/></asset>'
        f"<worldbody><body>{''.join(f'<geom {geom}/>' for geom in geoms)}</body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize(
    ("geom", "reach_m"),
    [
        ('type="cylinder" size="0.16 0.05"', 0.16),
        ('type="cylinder" size="0.16 0.05" pos="0.03 0.04 1"', 0.21),
        ('type="cylinder" size="0.03 0.4" euler="0 90 0"', math.hypot(0.4, 0.03)),
        ('type="sphere" size="0.02" pos="0.12 -0.05 0"', 0.15),
        ('type="capsule" size="0.02 0.1" euler="90 0 0" pos="0 0.05 0"', 0.17),
        ('type="ellipsoid" size="0.1 0.2 0.3"', 0.2),
        ('type="box" size="0.3 0.4 0.1"', 0.5),
        ('type="box" size="0.1 0.1 0.1" euler="0 0 45"', 0.1 * math.sqrt(2)),
        ('type="mesh" mesh="wedge" pos="0.1 0 0"', 0.4),
    ],
)
def test_reaches_by_hand(geom: str, reach_m: float) -> None:
    assert solid_reach_m(*stand(geom)) == pytest.approx(reach_m, rel=2e-5)


def test_what_cannot_be_touched_does_not_count() -> None:
    ghost = 'type="sphere" size="0.5" contype="0" conaffinity="0"'
    assert solid_reach_m(*stand('type="sphere" size="0.1"', ghost)) == pytest.approx(0.1)
    assert solid_reach_m(*stand(ghost)) == 0.0


@examples(40)
@given(
    kind=st.sampled_from(("sphere", "capsule", "cylinder", "ellipsoid", "box")),
    size=st.tuples(*[st.floats(0.02, 0.4)] * 3),
    turn=st.tuples(*[st.floats(-180, 180)] * 3),
    place=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    seed=st.integers(0, 99),
)
def test_no_point_of_the_surface_is_farther_and_some_is_as_far(
    kind: str, size: tuple[float, ...], turn: tuple[float, ...], place: tuple[float, ...], seed: int
) -> None:
    text = {name: " ".join(f"{value:.6f}" for value in each) for name, each in
            (("size", size), ("euler", turn), ("pos", place))}  # fmt: skip
    model, data = stand(f'type="{kind}" ' + " ".join(f'{name}="{value}"' for name, value in text.items()))
    reach_m = geom_reach_m(model, data, 0)
    ways = np.random.default_rng(seed).normal(size=(2000, 3))
    # Every second one along the geom: few of all directions meet the end of one that is long and thin.
    ways[::2] = (ways[::2] * model.geom_aabb[0, 3:]) @ data.geom_xmat[0].reshape(3, 3).T
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    middle, hit = np.array(data.geom_xpos[0]), np.zeros(1, dtype=np.int32)
    far = middle + 3.0 * ways
    found_m = 0.0
    for start, way in zip(far, ways, strict=True):
        surface = start - mujoco.mj_ray(model, data, start, -way, None, 1, -1, hit, None) * way
        found_m = max(found_m, math.hypot(surface[0], surface[1]))
    assert hit[0] == 0
    assert found_m <= reach_m * (1 + 2e-5) + 1e-6
    assert found_m > 0.85 * reach_m
