"""Which ways between rooms exclude each other, against rectangles cut at random."""

from collections.abc import Iterator
from itertools import combinations, permutations
from random import Random

import numpy as np
import pytest

from prefect_robomaker.tasks.worldforge.floorplans.preferences import Pair, forbidden_together

ROOMS = 6
MOST_WAYS = 4
PAIRS = list(combinations(range(ROOMS), 2))
ORDERS = np.array(
    [[PAIRS.index((min(o[a], o[b]), max(o[a], o[b]))) for a, b in PAIRS] for o in permutations(range(ROOMS))]
)

Box = tuple[float, float, float, float]
Graph = frozenset[Pair]


def dissected(count: int, box: Box, dice: Random) -> Iterator[Box]:
    """A box cut at random into boxes, by cuts from side to side or into a windmill of five."""
    if count == 1:
        yield box
        return
    x0, y0, x1, y1 = box
    if count >= 5 and dice.random() < 0.4:
        (u0, u1), (v0, v1) = sorted(dice.uniform(x0, x1) for _ in "ab"), sorted(dice.uniform(y0, y1) for _ in "ab")
        parts = [(x0, y0, u1, v0), (u1, y0, x1, v1), (u0, v1, x1, y1), (x0, v0, u0, y1), (u0, v0, u1, v1)]
        counts = [1] * 5
        for _ in range(count - 5):
            counts[dice.randrange(5)] += 1
    else:
        first = dice.randrange(1, count)
        counts = [first, count - first]
        x, y = dice.uniform(x0, x1), dice.uniform(y0, y1)
        level = dice.random() < 0.5
        parts = [(x0, y0, x1, y), (x0, y, x1, y1)] if level else [(x0, y0, x, y1), (x, y0, x1, y1)]
    for part, some in zip(parts, counts, strict=True):
        yield from dissected(some, part, dice)


def touching(boxes: list[Box]) -> Graph:
    found = set()
    for one, other in PAIRS:
        (x0, y0, x1, y1), (u0, v0, u1, v1) = boxes[one], boxes[other]
        across, up = min(x1, u1) - max(x0, u0), min(y1, v1) - max(y0, v0)
        if (across == 0 and up > 0) or (up == 0 and across > 0):
            found.add((one, other))
    return frozenset(found)


def plain(graph: Graph) -> Graph:
    """The same for graphs that differ in the rooms' numbers only."""
    marks = np.array([pair in graph for pair in PAIRS])
    codes = marks[ORDERS] @ (1 << np.arange(len(PAIRS)))
    return frozenset(pair for pair, mark in zip(PAIRS, marks[ORDERS[codes.argmin()]], strict=True) if mark)


def with_parts(graphs: set[Graph]) -> set[Graph]:
    """Graphs and all that is left of them when ways are taken away."""
    found, fresh = set(graphs), set(graphs)
    while fresh:
        fresh = {plain(graph - {pair}) for graph in fresh for pair in graph} - found
        found |= fresh
    return found


@pytest.mark.deep
def test_ways_that_exclude_each_other_are_those_that_no_cut_rectangle_has() -> None:
    dice = Random(5)
    drawn = {touching(list(dissected(ROOMS, (0.0, 0.0, 1.0, 1.0), dice))) for _ in range(4000)}
    possible = with_parts({plain(graph) for graph in drawn})
    every = with_parts({plain(frozenset(PAIRS))})
    assert len(every) == 156, "there are so many graphs of six rooms"
    allowed = [
        graph for graph in every if all(sum(room in pair for pair in graph) <= MOST_WAYS for room in range(ROOMS))
    ]
    for graph in allowed:
        forbidden = {tuple(forbidden_together(graph, pair)) for pair in graph} - {()}
        assert bool(forbidden) == (graph not in possible), sorted(graph)
        for ways in forbidden:
            assert plain(frozenset(ways)) not in possible
            assert all(plain(frozenset(ways) - {way}) in possible for way in ways), "a smaller set is forbidden too"
