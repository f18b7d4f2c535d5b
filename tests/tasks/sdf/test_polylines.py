"""Polylines in polylines: holes, islands in holes, and parts beside each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.sdf.polylines import Ring, parts_of


def square(x: float, y: float, side: float, *, left: bool = True) -> Ring:
    ring = ((x, y), (x + side, y), (x + side, y + side), (x, y + side))
    return ring if left else ring[::-1]


def area_m2(ring: Ring) -> float:
    x, y = np.array(ring).T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum()) / 2


@given(turns=st.lists(st.booleans(), min_size=5, max_size=5), order=st.permutations(range(5)))
def test_holes_are_taken_out_and_islands_are_parts(turns: list[bool], order: list[int]) -> None:
    """A yard with two holes, an island in one of them, and a shed beside it; in any direction and order."""
    rings = [square(*at) for at in ((0, 0, 10), (1, 1, 4), (6, 6, 3), (2, 2, 1), (20, 0, 2))]
    rings = [ring if turn else ring[::-1] for ring, turn in zip(rings, turns, strict=True)]
    parts = parts_of([rings[number] for number in order])
    assert sorted(map(area_m2, parts)) == pytest.approx([1, 4, 100 - 16 - 9])


def test_a_single_line_stays_as_it_is() -> None:
    ring = square(0, 0, 2)
    assert parts_of([ring]) == (ring,)
