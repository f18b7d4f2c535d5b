"""Signatures of plans: what leaves them as they are, what changes them, and the numbers that the search uses."""

from itertools import combinations
from random import Random

import numpy as np
import pytest
from helpers.many_plans import is_plain_outline
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.worlds.world import Floorplan
from prefect_robomaker.tasks.worldforge.floorplans.partition import Corners, Partition, outline
from prefect_robomaker.tasks.worldforge.floorplans.partition_costs import Cuts, all_trees, as_partition
from prefect_robomaker.tasks.worldforge.floorplans.partition_setbacks import put_together
from prefect_robomaker.tasks.worldforge.floorplans.plan_signature import (
    PlanSignature,
    forms_of,
    has_small_steps,
    is_plain,
    outline_corners,
    plan_signature,
)

Box = tuple[int, int, int, int]
LIVING, KITCHEN, BATH = (0, 0, 100, 100), (100, 0, 160, 60), (100, 60, 160, 100)


def corners(box: Box) -> Corners:
    x0, y0, x1, y1 = box
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def signature(*boxes: Box, doors: tuple[tuple[int, int], ...] = ()) -> PlanSignature:
    rooms = tuple(map(corners, boxes))
    width, height = (max(side) for side in zip(*(box[2:] for box in boxes), strict=True))
    return plan_signature(rooms, doors, len(outline(Partition(width, height, rooms, (1,) * len(rooms)))))


def test_a_signature_says_who_touches_whom_where_and_who_is_joined() -> None:
    assert signature(LIVING, KITCHEN, BATH, doors=((2, 0), (0, 2))) == (
        min(
            ((0, 1, side), (0, 2, side), (1, 2, other))
            for side in (1, 2, 3, 4)
            for other in (3, 4, 1, 2)
            if abs(side - other) > 1 or {side, other} == {2, 3}
        ),
        ((0, 2),),
        4,
    )


@pytest.mark.parametrize(
    "other",
    [
        signature(KITCHEN, LIVING, BATH),
        signature(LIVING, KITCHEN, BATH, doors=((0, 1),)),
        signature(LIVING, (100, 0, 160, 100), (160, 0, 200, 100)),
        signature(LIVING, KITCHEN, (100, 60, 160, 120)),
    ],
    ids=["rooms exchanged", "another door", "another side", "more corners"],
)
def test_plans_that_differ_have_other_signatures(other: PlanSignature) -> None:
    mine = signature(LIVING, KITCHEN, BATH)
    if other.touches == mine.touches:
        assert (other.doors, other.corners) != (mine.doors, mine.corners)
    assert other.key != mine.key


@st.composite
def plans(draw: st.DrawFn) -> Cuts:
    """A plan of two to five rooms, set back where they do not meet."""
    count = draw(st.integers(2, 5))
    sides = [draw(st.tuples(st.integers(40, 200), st.integers(40, 200))) for _ in range(count)]
    trees = all_trees(count)
    return put_together(
        trees.take(np.array([draw(st.integers(0, trees.plans - 1))])), np.array(sides, float).T[:, :, None]
    )[0]


@given(plans(), st.booleans(), st.booleans(), st.booleans(), st.integers(-500, 500))
def test_turning_mirroring_and_moving_leave_a_signature(cuts: Cuts, x: bool, y: bool, swapped: bool, by: int) -> None:
    plan = as_partition(cuts, 0)
    moved: list[Corners] = []
    for room in plan.rooms:
        points = [((-u if x else u) + by, (-v if y else v) - by) for u, v in room]
        points = [(v, u) for u, v in points] if swapped else points
        box = min(points), max(points)
        moved.append(corners((*box[0], *box[1])))
    doors = [(0, 1)]
    assert plan_signature(moved, doors, 4) == plan_signature(plan.rooms, doors, 4)


@given(st.lists(plans(), min_size=2, max_size=6))
def test_numbers_of_forms_are_equal_where_signatures_are(some: list[Cuts]) -> None:
    for one, other in combinations([each for each in some if each.low.shape == some[0].low.shape], 2):
        both = Cuts(np.concatenate([one.low, other.low], axis=2), np.concatenate([one.high, other.high], axis=2))
        if not (has_one_outline(one) and has_one_outline(other)):
            continue
        signatures = [plan_signature(as_partition(each, 0).rooms, (), len(around(each))) for each in (one, other)]
        first, second = forms_of(both).tolist()
        assert (first == second) == (signatures[0] == signatures[1])


def around(cuts: Cuts) -> Corners:
    return outline(as_partition(cuts, 0))


def has_one_outline(cuts: Cuts) -> bool:
    """Whether there is neither a yard, which `outline` does not go around, nor a corner that it comes to twice."""
    try:
        return len(around(cuts)) == outline_corners(cuts)[0]
    except ValueError:
        return False


def test_an_outline_that_touches_itself_is_an_error_and_no_endless_walk() -> None:
    rooms = of((0, 0, 80, 80), (80, 80, 120, 120), (80, 120, 160, 160), (120, 0, 240, 120))
    with pytest.raises(ValueError, match=r"twice to the corner \(120, 80\)"):
        around(rooms)


def of(*rooms: Box) -> Cuts:
    ends = np.array(rooms, float)
    return Cuts(ends[:, :2].T[:, :, None], ends[:, 2:].T[:, :, None])


OUTLINES = {
    "rectangle": ([(0, 0, 60, 60), (60, 0, 90, 60)], 4, True),
    "L": ([(0, 0, 60, 60), (60, 0, 90, 30)], 6, True),
    "T": ([(0, 0, 90, 40), (30, 40, 60, 80)], 8, True),
    "U": ([(0, 0, 30, 80), (30, 0, 60, 40), (60, 0, 90, 80)], 8, True),
    "Z": ([(0, 0, 60, 40), (30, 40, 90, 80)], 8, False),
    "stairs": ([(0, 0, 30, 90), (30, 0, 60, 60), (60, 0, 90, 30)], 8, False),
    "plus": ([(30, 0, 60, 90), (0, 30, 30, 60), (60, 30, 90, 60)], 12, False),
}


@pytest.mark.parametrize("name", OUTLINES)
def test_rectangles_and_clean_l_t_and_u_are_plain_outlines(name: str) -> None:
    rooms, count, plain = OUTLINES[name]
    assert outline_corners(of(*rooms)).tolist() == [count] == [len(around(of(*rooms)))]
    assert is_plain(of(*rooms)).tolist() == [plain]
    drawn = Floorplan.model_construct(footprint=[(float(x), float(y)) for x, y in around(of(*rooms))])
    assert is_plain_outline(drawn) == plain, "the count over many plans sees it as the search does"


def test_a_narrow_gap_counts_as_a_small_step() -> None:
    gap = of((0, 0, 30, 80), (30, 0, 40, 40), (40, 0, 90, 80))
    assert has_small_steps(gap, 16).tolist() == [True]
    assert has_small_steps(gap, 10).tolist() == [False]


def test_keys_of_plans_drawn_at_random_do_not_clash() -> None:
    dice = Random(1)
    found = {
        plan_signature([corners(box) for box in (LIVING, KITCHEN)], (), dice.randrange(10**9)) for _ in range(2000)
    }
    assert len({each.key for each in found}) == len(found)
