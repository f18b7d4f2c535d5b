"""Ways through a room: the quick answer about a block is the same as that of a flood fill."""

from random import Random

import numpy as np
import pytest
from scipy import ndimage

from prefect_robomaker.tasks.worldforge.geometry.boxes import Box
from prefect_robomaker.tasks.worldforge.interiors.free_ways import Ways

CELL_M = 0.05
HALF_M = 0.3
ROOM: Box = (0.0, 0.0, 4.0, 3.0)
WALLS: list[Box] = [(0.0, 0.0, 4.0, 0.1), (0.0, 2.9, 4.0, 3.0), (0.0, 0.0, 0.1, 3.0), (3.9, 0.0, 4.0, 3.0)]
GATES = [(0.5, 0.5), (3.5, 2.5)]


def free_cells(blocks: list[Box]) -> np.ndarray:
    x, y = (np.arange(80) + 0.5) * CELL_M, ((np.arange(60) + 0.5) * CELL_M)[:, None]
    free = np.ones((60, 80), bool)
    for west, south, east, north in blocks:
        # Half a micrometre, so that neither side of a cell's middle depends on rounding.
        reach = HALF_M - 5e-7
        free &= ~((x >= west - reach) & (x < east + reach) & (y >= south - reach) & (y < north + reach))
    return free


def joined(blocks: list[Box], most_lost: float) -> bool:
    free = free_cells(blocks)
    labels = np.asarray(ndimage.label(free)[0])  # pyright: ignore[reportIndexIssue]
    found = {int(labels[int(y / CELL_M), int(x / CELL_M)]) for x, y in GATES}
    return len(found) == 1 and 0 not in found and int((free & (labels != min(found))).sum()) <= most_lost


@pytest.mark.parametrize("seed", range(12))
def test_a_block_may_stand_where_a_flood_fill_says_so(seed: int) -> None:
    dice = Random(seed)
    ways = Ways(ROOM, HALF_M, WALLS, [])
    ways.join(GATES)
    blocks, answers = list(WALLS), set[bool]()
    for _ in range(30):
        x, y = dice.uniform(0.1, 3.5), dice.uniform(0.1, 2.5)
        # Off the middles of cells, where either answer would be right.
        block = (round(x, 3) + 3e-4, round(y, 3) + 3e-4)
        box = (*block, block[0] + round(dice.uniform(0.1, 0.9), 3), block[1] + round(dice.uniform(0.1, 0.9), 3))
        expected = joined([*blocks, box], 0.06 * int(free_cells(WALLS).sum()))
        assert ways.stays_open(box) == expected
        answers.add(expected)
        if expected:
            ways.block(box)
            blocks.append(box)
    assert answers == {True, False}
    reached = ways.nearest((2.0, 1.5))
    assert free_cells(blocks)[int(reached[1] / CELL_M), int(reached[0] / CELL_M)]


def test_two_blocks_that_close_a_gap_together_are_refused_together() -> None:
    ways = Ways(ROOM, HALF_M, WALLS, [])
    ways.join(GATES)
    upper, lower = (2.0, 1.4, 2.3, 2.9), (2.0, 0.1, 2.3, 1.3)
    assert ways.stays_open(upper)
    assert ways.stays_open(lower)
    assert not ways.stays_open(upper, lower)


def test_a_way_that_begins_too_near_to_a_wall_or_a_door_begins_beside_it() -> None:
    ways = Ways(ROOM, HALF_M, WALLS, [])
    ways.join([(0.5, 0.38), (3.62, 2.5)])
    assert ways.joined
    assert ways.stays_open((1.5, 0.1, 2.0, 0.5))


def test_where_ways_do_not_meet_the_goal_is_on_the_side_of_most() -> None:
    across: Box = (1.0, 0.0, 1.4, 3.0)
    ways = Ways(ROOM, HALF_M, [*WALLS, across], [])
    ways.join([(0.5, 0.5), (3.5, 2.5), (3.5, 0.5)])
    assert not ways.joined
    x, y = ways.nearest((1.2, 1.5))
    assert x >= 1.4 + HALF_M
    assert abs(y - 1.5) < CELL_M
