"""Sensitivities of margins: what they say, and where they are refused."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from prefect_robomaker.schemas.reports.causes import Sensitivity
from prefect_robomaker.tasks.causes.evidence import evidence_of
from prefect_robomaker.tasks.causes.sensitivity import sensitivities

from .conftest import Row, table_of


def rows(worlds: int, trials: int, slope: float, of_worlds: float = 0.0) -> list[Row]:
    """Trials whose margin changes with the axis, and by a world's own amount."""
    chance = np.random.default_rng(5)
    made: list[Row] = []
    for world in range(worlds):
        for _ in range(trials):
            value = float(chance.random()) + of_worlds * world
            margin = 1 + slope * (value - of_worlds * world) - of_worlds * world + float(chance.normal(0, 0.1))
            made.append({"world": world, "axes": {"noise": value}, "margin": margin})
    made[0]["outcome"] = "failed"
    return made


def found(made: list[Row]) -> tuple[list[Sensitivity], list[str]]:
    table = table_of(made)
    return sensitivities(table, evidence_of(table))


@pytest.mark.parametrize("worlds", [1, 8])
def test_a_slope_lies_in_its_interval(worlds: int) -> None:
    [one], refused = found(rows(worlds, 60, -0.5))
    assert refused == []
    assert (one.requirement, one.axis, one.unit) == ("polite", "noise", "m")
    assert one.low <= -0.5 * (one.end - one.start) <= one.high
    assert one.is_shown


def test_worlds_that_differ_in_axis_and_margin_are_no_slope() -> None:
    [one], _ = found(rows(8, 40, 0.0, of_worlds=0.5))
    assert not one.is_shown


def test_too_few_trials_and_axes_that_do_not_vary_in_a_job_are_refused(made: Callable[..., Any]) -> None:
    few, sentences = found(rows(1, 12, -0.5))
    assert few == []
    assert sentences == ["sensitivity of polite to noise: an interval takes 20 trials with a margin, and there are 12"]
    constant = rows(4, 20, 0.0)
    for row in constant:
        row["axes"] = {"noise": float(row["world"])}
    _, [sentence] = found(constant)
    assert sentence.endswith("it is the same in all trials of each job; other values in each job would do")


def test_ten_copies_of_each_cell_are_no_ten_times_as_much_evidence() -> None:
    """The same 40 cells in nine worlds: what other things of a cell do to margins is seen nine times."""
    chance = np.random.default_rng(8)
    values, others = chance.random(40), chance.normal(0, 0.3, 40)
    made = [
        {"world": world, "axes": {"noise": float(value), "id": float(place)}, "margin": float(other)}
        for world in range(9)
        for place, (value, other) in enumerate(zip(values, others, strict=True))
    ]
    made[0]["outcome"] = "failed"
    one = next(each for each in found(made)[0] if each.axis == "noise")
    assert not one.is_shown
    assert one.high - one.low > 0.3
