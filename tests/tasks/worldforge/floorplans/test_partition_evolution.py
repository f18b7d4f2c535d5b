"""Trees of more than six rooms are trees, whatever was changed in them, and better ones are found than by chance."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefect_robomaker.schemas.worlds.world import RoomType
from prefect_robomaker.tasks.worldforge.floorplans import partition_evolution
from prefect_robomaker.tasks.worldforge.floorplans.brief import Brief
from prefect_robomaker.tasks.worldforge.floorplans.partition_costs import BatchEvaluator, Trees, all_trees, cut
from prefect_robomaker.tasks.worldforge.floorplans.partition_evolution import trees_of
from prefect_robomaker.tasks.worldforge.floorplans.plan_signature import forms_of

TYPES: tuple[RoomType, ...] = ("Hallway", "Living", "Kitchen", "Bedroom", "Bedroom", "Bathroom", "Closet", "Dining")


@cache
def house(rooms: int) -> Brief:
    types = (TYPES * 2)[:rooms]
    areas = tuple(6.0 + 2.5 * number for number in range(rooms))
    return Brief(tuple(map(str, range(rooms))), types, areas, (1.4,) * rooms, 1.2, (((0, 1), "Doorway", 1),))


def check_trees(trees: Trees) -> None:
    """Each node but the root is the child of one cut, and a cut comes after the one that makes its rectangle."""
    rooms = trees.leaves
    children = np.concatenate([trees.first, trees.second])
    expected = [number for number in range(2 * rooms - 1) if number != rooms]
    assert (np.sort(children, axis=0) == np.array(expected)[:, None]).all()
    own = np.arange(rooms, 2 * rooms - 1)[:, None]
    for part in (trees.first, trees.second):
        assert ((part < rooms) | (part > own)).all()


@given(rooms=st.integers(2, 12), seed=st.integers(0, 2**32), changes=st.integers(1, 12))
@settings(max_examples=30, deadline=None)
def test_a_changed_tree_is_a_tree(rooms: int, seed: int, changes: int) -> None:
    dice = np.random.default_rng(seed)
    trees = partition_evolution._random_trees(rooms, dice)  # pyright: ignore[reportPrivateUsage]
    check_trees(trees)
    for _ in range(changes):
        trees = partition_evolution._changed(  # pyright: ignore[reportPrivateUsage]
            trees, dice.random(trees.plans) < 0.8, dice
        )
    check_trees(trees)
    low, high = cut(trees, np.full((rooms, trees.plans), 400.0), np.ones(trees.plans))
    assert (high - low).prod(axis=0) == pytest.approx(400.0)


def test_up_to_six_rooms_have_all_trees() -> None:
    assert trees_of(house(6)) is all_trees(6)


def test_the_trees_of_a_brief_are_the_same_each_time_and_better_than_those_of_chance() -> None:
    brief = house(8)
    found = trees_of(brief)
    check_trees(found)
    partition_evolution._bred_trees.cache_clear()  # pyright: ignore[reportPrivateUsage]
    again = trees_of(brief)
    assert all((one == other).all() for one, other in zip(found, again, strict=True))
    evaluator = BatchEvaluator(brief)
    chance = partition_evolution._random_trees(8, np.random.default_rng(7))  # pyright: ignore[reportPrivateUsage]
    costs = [
        partition_evolution._plans(trees, evaluator)[1].cost.min()  # pyright: ignore[reportPrivateUsage]
        for trees in (found, chance)
    ]
    assert costs[0] < 0.5 * costs[1]


@pytest.mark.parametrize("rooms", [7, 8, 12])
def test_forms_of_many_rooms_are_told_apart_and_known_again_turned(rooms: int) -> None:
    evaluator = BatchEvaluator(house(rooms))
    trees = partition_evolution._random_trees(rooms, np.random.default_rng(3))  # pyright: ignore[reportPrivateUsage]
    cuts = partition_evolution._plans(trees, evaluator)[0]  # pyright: ignore[reportPrivateUsage]
    forms = forms_of(cuts)
    turned = cuts._replace(low=cuts.low[::-1], high=cuts.high[::-1])
    assert (forms_of(turned) == forms).all()
    assert len(np.unique(forms)) > 0.9 * trees.plans
