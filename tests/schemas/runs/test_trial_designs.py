"""Designs of trials: cells of grids, and points of designs that draw them."""

from typing import Any

import numpy as np
import pytest
from helpers.examples import examples
from helpers.variable_axes import variables
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.trials import Trials

DESIGNS = ("random", "latin-hypercube", "sobol")
GRID: dict[str, Any] = {
    **variables({"SPEED": ["slow", "fast"]}),
    "mass": {"kind": "robot_mass", "values": [0.8, 1, 1.2]},
}
RANGES: dict[str, Any] = {
    "mass": {"kind": "robot_mass", "range": [0.8, 1.2]},
    "noise": {"kind": "lidar_noise_std_m", "range": [0, 0.1]},
    **variables({"SPEED": ["slow", "fast"]}),
}


def cells(seed: int = 3, **members: Any) -> list[dict[str, Any]]:
    trials = Trials.model_validate({"seeds": 1, **members})
    return [dict(trials.trial(number, seed).axes) for number in range(trials.count)]


def test_an_excluded_cell_may_be_included_again() -> None:
    """As the last one, for example."""
    one = {"SPEED": "slow", "mass": 1}
    assert cells(axes=GRID, exclude=[one], include=[one])[-1] == one
    assert len(cells(axes=GRID, exclude=[one], include=[one])) == 6


def test_a_grid_leaves_out_and_takes_in_cells() -> None:
    whole = cells(axes=GRID)
    assert whole == [{"SPEED": speed, "mass": mass} for speed in ("slow", "fast") for mass in (0.8, 1.0, 1.2)]

    some = cells(
        axes=GRID, exclude=[{"SPEED": "fast", "mass": 1.2}, {"mass": 1}], include=[{}, {"SPEED": "fast", "mass": "2"}]
    )

    assert some == [
        {"SPEED": "slow", "mass": 0.8},
        {"SPEED": "slow", "mass": 1.2},
        {"SPEED": "fast", "mass": 0.8},
        {},
        {"SPEED": "fast", "mass": 2.0},
    ]


@given(st.sets(st.tuples(st.sampled_from(["slow", "fast", None]), st.sampled_from([0.8, 1.0, 1.2, None])), max_size=4))
def test_an_excluded_cell_is_one_that_has_all_its_values(excluded: set[Any]) -> None:
    lists = [{name: value for name, value in zip(("SPEED", "mass"), each, strict=True) if value} for each in excluded]
    lists = [each for each in lists if each]
    left = [cell for cell in cells(axes=GRID) if not any(each.items() <= cell.items() for each in lists)]
    if left:
        without: dict[str, Any] = {"exclude": lists} if lists else {}
        assert cells(axes=GRID, **without) == left


@pytest.mark.parametrize("design", DESIGNS)
def test_points_depend_on_the_seed_of_the_job_only(design: str) -> None:
    drawn = cells(axes=RANGES, design=design, points=50)
    assert drawn == cells(axes=RANGES, design=design, points=50)
    assert drawn != cells(seed=4, axes=RANGES, design=design, points=50)
    assert len({tuple(each.values()) for each in drawn}) == 50
    assert all(0.8 <= each["mass"] <= 1.2 and 0 <= each["noise"] <= 0.1 for each in drawn)
    # Each point is run with the same seeds.
    trials = Trials.model_validate({"seeds": 3, "axes": RANGES, "design": design, "points": 4})
    found = [trials.trial(number, 3) for number in range(12)]
    assert [each.seed for each in found] == [3, 4, 5] * 4
    assert [dict(each.axes) for each in found[::3]] == cells(axes=RANGES, design=design, points=4)


@given(st.sampled_from(DESIGNS), st.integers(1, 3), st.integers(1, 20), st.integers(0, 9), st.booleans())
@examples(40)
def test_no_trial_has_the_cell_and_the_seed_of_another(
    design: str, seeds: int, points: int, seed: int, includes: bool
) -> None:
    """A copy would count as evidence: it goes through the same states, and is judged the same."""
    more: dict[str, Any] = {"include": [{}, {"SPEED": "slow", "mass": 1}]} if includes else {}
    trials = Trials.model_validate({"seeds": seeds, "axes": GRID, "design": design, "points": points, **more})

    made = [trials.trial(number, seed) for number in range(trials.count)]

    assert len({(each.seed, *each.axes.items()) for each in made}) == trials.count
    assert all(seed <= each.seed < seed + trials.seeds_taken for each in made)
    if design == "random":
        assert {each.seed for each in made[: 6 * seeds]} == set(range(seed, seed + seeds))  # each of 6 cells once
        taken = sorted({each.seed for each in made})
        assert taken == list(range(seed, seed + len(taken)))
        assert len(taken) <= trials.seeds_taken


def test_chance_draws_other_cells_of_a_large_grid() -> None:
    """Too many for a permutation of all: what is drawn twice is drawn anew."""
    values = [number / 100 for number in range(50, 90)]
    large = {name: {"kind": name, "values": values} for name in ("robot_mass", "motor_gain")}
    drawn = cells(axes=large, design="random", points=700)
    assert len({tuple(each.values()) for each in drawn}) == 700


def test_points_are_what_they_were_when_this_was_written() -> None:
    """An earlier night's trials are repeated by their stored values; a new night has the same points all the same."""
    two = {name: RANGES[name] for name in ("mass", "noise")}
    assert cells(axes=two, design="random", points=2) == [
        {"mass": 1.0738107419754974, "noise": 0.017629699965514157},
        {"mass": 1.1165760550697812, "noise": 0.09365750370163647},
    ]


@pytest.mark.parametrize("points", [8, 64])
def test_designs_spread_points(points: int) -> None:
    def fullest_tenth(design: str) -> list[int]:
        drawn = cells(axes=RANGES, design=design, points=points)
        shares = np.array([((each["mass"] - 0.8) / 0.4, each["noise"] / 0.1) for each in drawn])
        return [int(np.bincount((column * points).astype(int), minlength=points).max()) for column in shares.T]

    assert fullest_tenth("latin-hypercube") == [1, 1]  # one point in each part of each axis
    assert fullest_tenth("sobol") == [1, 1]
    assert max(fullest_tenth("random")) > 1
    halves = [each["SPEED"] for each in cells(axes=RANGES, design="sobol", points=points)]
    assert halves.count("slow") == points / 2


@given(st.integers(1, 40), st.integers(1, 40))
def test_fewer_points_of_a_sobol_design_are_the_first_of_more(few: int, many: int) -> None:
    few, many = sorted((few, many))
    assert cells(axes=RANGES, design="sobol", points=few) == cells(axes=RANGES, design="sobol", points=many)[:few]


def test_a_normal_distribution_has_its_mean_and_spread_within_its_bounds() -> None:
    wide = {"mass": {"kind": "robot_mass", "normal": {"mean": 1, "std": 0.1}}}
    drawn = np.array([each["mass"] for each in cells(axes=wide, design="sobol", points=512)])
    assert (drawn.mean(), drawn.std()) == (pytest.approx(1, abs=0.002), pytest.approx(0.1, rel=0.03))
    cut = {"mass": {"kind": "robot_mass", "normal": {"mean": 1, "std": 0.1, "low": 0.95, "high": 1.3}}}
    drawn = np.array([each["mass"] for each in cells(axes=cut, design="sobol", points=512)])
    assert 0.95 <= drawn.min() < 0.955
    assert 1.15 < drawn.max() <= 1.3
    far = {"d": {"kind": "motor_delay_s", "normal": {"mean": 0, "std": 0.01}}}
    drawn = np.array([each["d"] for each in cells(axes=far, design="random", points=100)])
    assert drawn.min() >= 0  # no delay is negative
    assert drawn.std() < 0.01


@pytest.mark.deep
def test_a_million_trials_have_cells_too() -> None:
    trials = Trials.model_validate({"seeds": 1, "axes": RANGES, "design": "sobol", "points": 10**6})
    assert 0.8 <= trials.trial(999_999, 1).axes["mass"] <= 1.2  # type: ignore[operator]
