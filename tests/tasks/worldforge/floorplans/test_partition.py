"""Slicing trees and their borders."""

from random import Random

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.worldforge.floorplans.brief import clear_span, shared_spans
from prefect_robomaker.tasks.worldforge.floorplans.partition import (
    POCKETS,
    SIDE_BY_SIDE,
    STACKED,
    Contact,
    area,
    contacts,
    extent,
    partition,
)


@st.composite
def expressions(draw: st.DrawFn) -> list[int]:
    """Any tree over up to six rooms."""
    trees = [[room] for room in draw(st.permutations(range(draw(st.integers(1, 6)))))]
    while len(trees) > 1:
        index = draw(st.integers(0, len(trees) - 2))
        operator = draw(st.sampled_from([SIDE_BY_SIDE, STACKED, SIDE_BY_SIDE, STACKED, *POCKETS]))
        trees[index : index + 2] = [[*trees[index], *trees[index + 1], operator]]
    return trees[0]


def test_side_by_side_goes_east_and_stacked_goes_north() -> None:
    plan = partition([0, 1, SIDE_BY_SIDE, 2, STACKED], [1, 3, 4], [1, 1, 1], 80, 100)
    assert [extent(corners) for corners in plan.rooms] == [(0, 0, 20, 50), (20, 0, 80, 50), (0, 50, 80, 100)]
    assert plan.arms == (20, 50, 50)


def test_pockets_lie_in_the_corner_that_they_are_named_for() -> None:
    corners = []
    for pocket in POCKETS:
        plan = partition([0, 1, pocket], [15, 1], [1, 1], 100, 100)
        assert extent(plan.rooms[0]) == (0, 0, 100, 100)
        assert len(plan.rooms[0]) == 6
        assert area(plan.rooms[0]) + area(plan.rooms[1]) == 10_000
        box = extent(plan.rooms[1])
        corners.append((box.x0 == 0, box.y0 == 0))
    assert corners == [(True, True), (False, True), (True, False), (False, False)]


def test_a_corridor_around_a_large_pocket_is_equally_wide_on_both_sides() -> None:
    plan = partition([0, 1, POCKETS[0]], [4, 6], [1, 1], 100, 140)
    box = extent(plan.rooms[1])
    assert abs((100 - box.x1) - (140 - box.y1)) <= 1


def test_contacts_name_the_room_on_either_side() -> None:
    plan = partition([0, 1, SIDE_BY_SIDE], [1, 1], [1, 1], 100, 40)
    assert contacts(plan.rooms) == [Contact(low=0, high=1, horizontal=False, at=50, start=0, end=40)]


@given(expressions(), st.integers(0, 10_000))
def test_rooms_share_out_the_footprint(expression: list[int], seed: int) -> None:
    dice = Random(seed)
    count = (len(expression) + 1) // 2
    plan = partition(expression, [dice.uniform(10, 300) for _ in range(count)], [1.0] * count, 400, 300)
    assert sum(area(corners) for corners in plan.rooms) == 400 * 300


@given(expressions(), st.integers(0, 10_000))
def test_the_short_cut_for_rectangular_rooms_agrees_with_all_contacts(expression: list[int], seed: int) -> None:
    dice = Random(seed)
    straight = [token if token >= STACKED else STACKED for token in expression]
    count = (len(expression) + 1) // 2
    plan = partition(straight, [dice.uniform(10, 300) for _ in range(count)], [1.0] * count, 400, 300)
    slow = []
    for contact in contacts(plan.rooms):
        start, end = clear_span(contact, plan)
        slow.append((tuple(sorted((contact.low, contact.high))), end - start))
    assert sorted(shared_spans(plan)) == sorted(slow)
