"""Planned numbers of trials grow as effects get smaller, and so many trials do tell the effect."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.causes.evidence import Evidence, evidence_of
from prefect_robomaker.tasks.causes.explanation import explain
from prefect_robomaker.tasks.causes.groups import Group, groups_of
from prefect_robomaker.tasks.causes.lift import lift_of
from prefect_robomaker.tasks.causes.needed import trials_needed

from .conftest import Row, table_of


def pairs(seeds: int, slow: float, fast: float, seed: int) -> list[Row]:
    chance = np.random.default_rng(seed)
    return [
        {
            "axes": {"SPEED": speed}, "seed": number, "state_digest": f"{speed} {number}",
            "outcome": "failed" if chance.random() < rate else "passed",
        }
        for number in range(seeds) for speed, rate in (("slow", slow), ("fast", fast))
    ]  # fmt: skip


def sides(rows: list[Row]) -> tuple[Evidence, Group, np.ndarray]:
    found = evidence_of(table_of(rows))
    [axis] = found.axes
    return found, groups_of(found)[0], axis.codes == axis.values.index("fast")


@examples(40)
@given(st.floats(0.05, 0.5), st.floats(0.05, 0.4), st.floats(0.001, 0.05))
def test_a_smaller_effect_and_a_smaller_error_take_more(base: float, rise: float, alpha: float) -> None:
    found, group, fast = sides(pairs(12, 0.3, 0.7, 1))
    lift = lift_of(found, group, fast)
    assert lift is not None

    def needed(by: float, error: float) -> int:
        planned = trials_needed(found, group, fast, replace(lift, inside=base + by, outside=base), 1, error)
        return len(found) if planned is None else planned.trials

    assert needed(rise, alpha) <= needed(rise / 2, alpha)
    assert needed(rise, alpha) <= needed(rise, alpha / 2)
    assert trials_needed(found, group, fast, replace(lift, inside=base, outside=base + rise), 1, alpha) is None


def test_so_many_trials_tell_the_effect_in_most_runs() -> None:
    found, group, fast = sides(pairs(10, 0.2, 0.6, 4))
    lift = lift_of(found, group, fast)
    assert lift is not None
    seen = replace(lift, inside=0.6, outside=0.2)
    planned = trials_needed(found, group, fast, seen, 10, 0.05 / 2)
    assert planned is not None
    claimed = 0
    for seed in range(20):
        why = explain(table_of(pairs(planned.trials // 2, 0.2, 0.6, 100 + seed)))
        claimed += why is not None and bool(why.groups[0].claims)
    assert claimed >= 12, "16 are expected"


@pytest.mark.parametrize("worlds", [6, 10])
def test_where_worlds_decide_more_worlds_are_asked_for(worlds: int) -> None:
    rows = [{**row, "world": world} for world in range(worlds) for row in pairs(2, 0.3, 0.6, world)]
    found, group, fast = sides(rows)
    lift = lift_of(found, group, fast)
    assert lift is not None
    planned = trials_needed(found, group, fast, replace(lift, inside=0.5, outside=0.3), 10, 0.01)
    assert planned is not None
    assert planned.worlds is not None
    assert planned.worlds > worlds
    assert planned.trials == planned.worlds * 4
