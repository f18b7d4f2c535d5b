"""Plans cut many at a time are the plans cut one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.worldforge.floorplans.brief import Brief, shared_spans
from prefect_robomaker.tasks.worldforge.floorplans.partition import Partition, area, contacts
from prefect_robomaker.tasks.worldforge.floorplans.partition_costs import BatchEvaluator, all_trees, as_partition, cut


def brief(areas: list[float]) -> Brief:
    count = len(areas)
    names = tuple(map(str, range(count)))
    return Brief(names, ("Living",) * count, tuple(areas), (1.0,) * count, 4 / 3, ())


@given(st.lists(st.floats(10, 300), min_size=2, max_size=5), st.integers(0, 2**31), st.floats(0.5, 2))
def test_rooms_tile_their_footprint_with_their_areas(areas: list[float], seed: int, ratio: float) -> None:
    trees = all_trees(len(areas))
    some = trees.take(np.array([seed % trees.plans]))
    plan = as_partition(cut(some, np.array(areas)[:, None] * 400, np.array([ratio]), exact=True), 0)
    assert sum(map(area, plan.rooms)) == plan.width * plan.height
    total = sum(areas)
    for corners, wished in zip(plan.rooms, areas, strict=True):
        # Each side is off by a unit at most.
        assert abs(area(corners) - wished * 400) <= 2 * (plan.width + plan.height) + total


@pytest.mark.parametrize(("rooms", "plans"), [(2, 2), (3, 12), (4, 144), (5, 2760)])
def test_all_plans_are_there_once_mirror_images_aside(rooms: int, plans: int) -> None:
    trees = all_trees(rooms)
    assert trees.plans == plans
    columns = np.concatenate([trees.first, trees.second, trees.sideways]).T
    assert len(np.unique(columns, axis=0)) == plans


def test_a_plan_is_valid_when_doors_join_its_rooms() -> None:
    areas = [26.0, 14.0, 16.0, 10.0]
    evaluator, trees = BatchEvaluator(brief(areas)), all_trees(4)
    footprint = np.full(trees.plans, np.log(4 / 3))
    cuts = cut(trees, np.tile(evaluator.areas, trees.plans), np.exp(footprint), exact=True)
    nature = evaluator.evaluate(cuts)
    for number in range(trees.plans):
        plan = as_partition(cuts, number)
        assert nature.valid[number] == (min(plan.arms) >= 44 and joined(plan))


def joined(plan: Partition) -> bool:
    """Whether walls long enough for doors join all rooms."""
    assert contacts(plan.rooms)
    reached = {0}
    pairs = [pair for pair, span in shared_spans(plan) if span >= 30]
    for _ in plan.rooms:
        reached |= {room for pair in pairs if reached & {*pair} for room in pair}
    return len(reached) == len(plan.rooms)
