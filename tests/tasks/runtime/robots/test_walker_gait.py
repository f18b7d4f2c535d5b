import math

import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.runtime.robots.walker import LEGS, Angles, GaitSettings, Motion, TrotGait

STILL = Motion(0.0, 0.0, 0.0, 0.0, 0.0)
SETTINGS = GaitSettings()
DT_S = 0.01


def foot_of(leg: int, angles: Angles) -> tuple[float, float, float]:
    """Where a leg's foot is in the body's frame: forward kinematics, which the gait never computes."""
    abduction, hip, knee = angles
    hip_x, hip_y = LEGS.hips[leg]
    x = -LEGS.thigh_m * math.sin(hip) - LEGS.shank_m * math.sin(hip + knee)
    down = LEGS.thigh_m * math.cos(hip) + LEGS.shank_m * math.cos(hip + knee)
    out = math.copysign(LEGS.offset_m, hip_y)
    y = out * math.cos(abduction) + down * math.sin(abduction)
    z = out * math.sin(abduction) - down * math.cos(abduction)
    return hip_x + x, hip_y + y, z


def test_feet_stand_below_the_legs_when_it_stands() -> None:
    angles = TrotGait(LEGS, SETTINGS).advance(DT_S, 0.0, 0.0, STILL)
    for leg, (hip_x, hip_y) in enumerate(LEGS.hips):
        x, y, z = foot_of(leg, angles[leg])
        assert (x, abs(y), z) == pytest.approx((hip_x, abs(hip_y) + LEGS.offset_m, -LEGS.stance_height_m))


@examples(50)
@given(linear=st.floats(-0.4, 0.4), angular=st.floats(-1.6, 1.6))
def test_feet_on_the_floor_move_as_the_floor_does_and_diagonal_pairs_take_turns(linear: float, angular: float) -> None:
    gait = TrotGait(LEGS, SETTINGS)
    motion = Motion(linear, 0.0, angular, 0.0, 0.0)
    before = [foot_of(leg, angles) for leg, angles in enumerate(gait.advance(DT_S, linear, angular, motion))]
    lowest = -LEGS.stance_height_m
    for _ in range(80):
        after = [foot_of(leg, angles) for leg, angles in enumerate(gait.advance(DT_S, linear, angular, motion))]
        standing = [leg for leg in range(4) if max(before[leg][2], after[leg][2]) < lowest + 1e-9]
        assert {0, 3} <= set(standing) or {1, 2} <= set(standing)
        for leg in standing:
            (x, y, _), (to_x, to_y, _) = before[leg], after[leg]
            assert to_x - x == pytest.approx((-linear + angular * y) * DT_S, abs=1e-4)
            assert to_y - y == pytest.approx(-angular * x * DT_S, abs=1e-4)
        assert all(lowest - 1e-9 <= foot[2] <= lowest + SETTINGS.lift_m + 1e-9 for foot in after)
        before = after


@examples(50)
@given(
    linear=st.floats(-0.4, 0.4), angular=st.floats(-1.6, 1.6), speed=st.floats(-2, 2), side=st.floats(-2, 2),
    turning=st.floats(-9, 9), roll=st.floats(-1, 1), pitch=st.floats(-1, 1),
)  # fmt: skip
def test_angles_are_finite_and_legs_reach_whatever_the_body_does(
    linear: float, angular: float, speed: float, side: float, turning: float, roll: float, pitch: float
) -> None:
    gait = TrotGait(LEGS, SETTINGS)
    for _ in range(60):
        angles = gait.advance(DT_S, linear, angular, Motion(speed, side, turning, roll, pitch))
        assert all(math.isfinite(angle) for leg in angles for angle in leg)
        # Knees never bend the wrong way.
        assert all(-math.pi < knee <= 0 for _, _, knee in angles[:2])
        assert all(0 <= knee < math.pi for _, _, knee in angles[2:])


def test_it_comes_to_rest_with_all_feet_on_the_floor() -> None:
    gait = TrotGait(LEGS, SETTINGS)
    for _ in range(37):
        gait.advance(DT_S, 0.3, 0.5, STILL)
    for _ in range(round(2 * SETTINGS.period_s / DT_S)):
        gait.advance(DT_S, 0.0, 0.0, STILL)
    one, other = (gait.advance(DT_S, 0.0, 0.0, STILL) for _ in range(2))
    assert one == other
    assert [foot_of(leg, angles)[2] for leg, angles in enumerate(one)] == pytest.approx([-LEGS.stance_height_m] * 4)


def test_tilted_it_stretches_the_legs_that_are_low() -> None:
    level = TrotGait(LEGS, SETTINGS).advance(DT_S, 0.0, 0.0, STILL)
    nose_down = TrotGait(LEGS, SETTINGS).advance(DT_S, 0.0, 0.0, Motion(0.0, 0.0, 0.0, 0.0, 0.1))
    rise = [foot_of(leg, nose_down[leg])[2] - foot_of(leg, level[leg])[2] for leg in range(4)]
    assert rise[0] == rise[1] == pytest.approx(SETTINGS.levelling * 0.1 * LEGS.hip_x_m)
    assert rise[2] == pytest.approx(-rise[0])
