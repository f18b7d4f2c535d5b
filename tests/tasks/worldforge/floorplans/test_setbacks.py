"""Plans that are set back from a rectangle: rooms keep their sides, and the outline stays one that can be built."""

from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.worldforge.floorplans.brief import Brief
from prefect_robomaker.tasks.worldforge.floorplans.partition import Partition, area, border, outline
from prefect_robomaker.tasks.worldforge.floorplans.partition_choice import find_partition
from prefect_robomaker.tasks.worldforge.floorplans.partition_costs import Cuts, all_trees, as_partition
from prefect_robomaker.tasks.worldforge.floorplans.partition_setbacks import (
    outline_cost,
    put_together,
    setback_shortlist,
)
from prefect_robomaker.tasks.worldforge.floorplans.partition_shortlist import LEAST_EDGE
from prefect_robomaker.tasks.worldforge.floorplans.plan_seed import PlanSeed
from prefect_robomaker.tasks.worldforge.floorplans.plan_signature import has_small_steps


def box(x0: int, y0: int, x1: int, y1: int) -> tuple[tuple[int, int], ...]:
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def of_boxes(*rooms: tuple[tuple[int, int], ...]) -> Partition:
    corners = [spot for room in rooms for spot in room]
    return Partition(max(x for x, _ in corners), max(y for _, y in corners), rooms, (1,) * len(rooms))


@given(st.lists(st.tuples(st.integers(40, 300), st.integers(40, 300)), min_size=2, max_size=5), st.integers(0, 10**6))
def test_rooms_keep_their_sides_and_do_not_overlap(sides: list[tuple[int, int]], seed: int) -> None:
    trees = all_trees(len(sides))
    some = trees.take(np.array([seed % trees.plans]))
    cuts, _ = put_together(some, np.array(sides, float).T[:, :, None])
    got = (cuts.high - cuts.low)[:, :, 0]
    # Rooms are stretched by less than a setback at each of the cuts above them.
    longer = got.T - np.array(sides)
    assert (longer >= 0).all()
    assert (longer <= LEAST_EDGE * len(sides)).all()
    plan = as_partition(cuts, 0)
    cells = np.zeros((plan.width, plan.height), int)
    for (x0, y0), _, (x1, y1), _ in plan.rooms:
        cells[x0:x1, y0:y1] += 1
    assert cells.max() == 1


def test_the_outline_goes_around_the_building_once() -> None:
    plan = of_boxes(box(0, 0, 100, 60), box(0, 60, 40, 100), box(100, 20, 130, 60))
    assert outline(plan) == ((0, 0), (100, 0), (100, 20), (130, 20), (130, 60), (40, 60), (40, 100), (0, 100))
    assert sum(side.end - side.start for side in border(plan.rooms)) == 2 * (130 + 100)


def test_small_steps_are_seen_where_the_outline_has_them_and_nowhere_else() -> None:
    stepped = [[(0, 0, 50, 60), (50, 0, 90, 63)], [(0, 3, 50, 60), (50, 0, 90, 60)], [(0, 0, 60, 50), (0, 50, 64, 90)]]
    plain = [[(0, 0, 50, 60), (50, 0, 90, 60)], [(0, 0, 50, 60), (50, 0, 90, 80)]]
    for rooms, small in (*((rooms, True) for rooms in stepped), *((rooms, False) for rooms in plain)):
        assert has_small_steps(of(rooms), 8).tolist() == [small], rooms
    # Inside, walls may end near each other.
    assert not has_small_steps(of([(0, 0, 50, 60), (50, 0, 90, 63), (0, 60, 50, 90), (50, 63, 90, 90)]), 8).any()


def of(rooms: list[tuple[int, int, int, int]]) -> Cuts:
    corners = np.array(rooms, float)
    return Cuts(corners[:, :2].T[:, :, None], corners[:, 2:].T[:, :, None])


def test_a_full_rectangle_costs_nothing_and_a_slot_more_than_a_corner() -> None:
    full, corner = [(0, 0, 50, 60), (50, 0, 90, 60)], [(0, 0, 50, 60), (50, 0, 90, 40)]
    slot = [(0, 0, 30, 60), (30, 0, 70, 40), (70, 0, 90, 60)]
    costs = [float(outline_cost(of(rooms), np.zeros(1, bool))[0]) for rooms in (full, corner, slot)]
    assert costs[0] == 0 < costs[1] < costs[2]


@pytest.mark.parametrize("seed", range(4))
def test_every_plan_of_a_list_has_one_outline_without_yards_and_small_steps(seed: int) -> None:
    dice = Random(seed)
    rooms = 3 + seed % 3
    areas = tuple(dice.uniform(10, 120) for _ in range(rooms))
    ratios = tuple(dice.uniform(1, 3) for _ in range(rooms))
    names = tuple(map(str, range(rooms)))
    brief = Brief(names, ("Living",) * rooms, areas, ratios, 4 / 3, ())
    best = setback_shortlist(brief)
    cuts, _ = best.plans.judged(best.evaluator)
    for number in range(len(best.cost)):
        plan = as_partition(cuts, number)
        sides = border(plan.rooms)
        around = outline(plan)
        assert area(around) == sum(map(area, plan.rooms)), "a yard has no open side"
        lengths = [abs(x - u) + abs(y - v) for (x, y), (u, v) in zip(around, (*around[1:], around[0]), strict=True)]
        assert sum(lengths) == sum(side.end - side.start for side in sides)
        assert min(lengths) >= LEAST_EDGE
    assert find_partition(brief, PlanSeed.of(1), Random(1)) == find_partition(brief, PlanSeed.of(1), Random(1))
