"""Forms that pictures alone show: panels of doors and weave of cloth."""

import numpy as np
import pytest

from prefect_robomaker.tasks.worldforge.pictures.fine_forms import drawn, is_cloth, is_panelled, panel, weave

DOOR_HALF_M = np.array((0.009, 0.2, 0.35))


def test_the_panel_of_a_door_slopes_down_from_its_frame_and_its_side_is_plain() -> None:
    front = DOOR_HALF_M[0]
    inside = np.array([(front, 0.0, 0.0), (front, 0.18, 0.0), (front, 0.14, 0.0), (front, 0.0, -0.29), (0.0, 0.2, 0.0)])
    turned, share = panel(inside, np.tile(DOOR_HALF_M, (len(inside), 1)))
    middle, frame, side_slope, lower_slope, side = range(5)
    assert share[side_slope] == pytest.approx(share[lower_slope])
    assert share[side_slope] < share[middle] < share[frame] == share[side] == 1
    # The slope looks towards the door's middle.
    assert turned[side_slope] == pytest.approx([0, -1, 0])
    assert turned[lower_slope] == pytest.approx([0, 0, 1])
    assert not turned[[middle, frame, side]].any()


def test_a_door_has_a_dark_gap_around_it() -> None:
    front, wide = DOOR_HALF_M[0], DOOR_HALF_M[1]
    inside = np.array([(front, wide - 0.001, 0.0), (front, wide - 0.01, 0.0), (front, 0.0, -DOOR_HALF_M[2] + 0.001)])
    share = panel(inside, np.tile(DOOR_HALF_M, (3, 1)))[1]
    assert share[0] == share[2] < 0.6
    assert share[1] == 1


def test_doors_have_panels_and_small_drawers_and_bodies_have_none() -> None:
    assert is_panelled("Storage_2.front-1-1", DOOR_HALF_M)
    assert is_panelled("cabinet_Storage_1_door_2", DOOR_HALF_M)
    assert not is_panelled("Nightstands_1.front-1-1", np.array((0.009, 0.2, 0.08)))
    assert not is_panelled("Storage_2.body", DOOR_HALF_M)


def test_cloth_covers_soft_furniture_and_hangs_at_windows_and_legs_are_bare() -> None:
    assert all(map(is_cloth, ("Sofas_1.base", "Beds_1.duvet", "rug_Beds_1", "rug_Beds_1_middle", "curtain_0_1")))
    bare = ("Sofas_1.leg-1", "Beds_1.frame_seen", "Beds_1.headboard", "curtain_3_rod", "blind_0_bar", "Desks_1.top")
    assert not any(map(is_cloth, bare))


def test_weave_makes_cloth_neither_lighter_nor_darker() -> None:
    share = weave(np.random.default_rng(1).uniform(-3, 3, (20_000, 3)))
    assert abs(share.mean() - 1) < 0.01
    assert 0.85 < share.min() < 0.95
    assert 1.05 < share.max() < 1.15


def test_a_print_is_darker_below_and_two_prints_differ() -> None:
    along, up = (axis.ravel() for axis in np.mgrid[-0.9:0.9:30j, -0.9:0.9:30j])
    inside = np.stack([0.3 * along, np.zeros(len(up)), 0.2 * up], axis=1)
    half = np.tile((0.3, 0.005, 0.2), (len(up), 1))
    plain = np.full((len(up), 3), 0.8)
    one, other = (drawn(plain, inside, half, np.full(len(up), number))[:, 0] for number in (3.0, 8.0))
    assert one[up > 0.6].mean() > one[up < -0.6].mean() + 0.1
    assert (one != other).mean() > 0.03
