"""Few failures name the value that they go with, as no claim, and chance names none."""

import re
from collections.abc import Callable
from itertools import product

import numpy as np
import pytest

from prefect_robomaker.tasks.causes.explanation import explain

from .conftest import Row, missed, table_of


def small_night(fails: Callable[[float, float, int], bool], seeds: int = 1) -> list[Row]:
    """Jobs of a step with two axes of two values each, in three worlds."""
    places = product(range(3), (0.3, 0.6), (0.28, 0.19), range(seeds))
    made: list[Row] = []
    for number, (world, speed, margin, seed) in enumerate(places):
        row: Row = {"world": world, "axes": {"speed": speed, "margin": margin}, "trial": None, "seed": seed}
        made.append(row | {"job": f"sim-{number}", "outcome": "failed" if fails(speed, margin, world) else "passed"})
    return made


@pytest.mark.parametrize(("seeds", "failed"), [(1, 6), (2, 12)])
def test_a_value_with_which_all_jobs_fail_is_named_however_few_they_are(seeds: int, failed: int) -> None:
    """It is no claim, and says how many jobs would make it one."""
    why = explain(table_of(small_night(lambda _, margin, __: margin < 0.2, seeds)))
    assert why is not None
    [group] = why.groups
    said = f"all {failed} have margin = 0.19 ({failed} of {failed}, elsewhere 0 of {failed})"
    assert (group.claims, group.failed) == ([], failed)
    assert said in group.nothing
    assert re.search(r"too few (jobs to tell|to claim): ", group.nothing)
    now = {1: "12, such as 3 seeds instead of 1", 2: "24, such as 3 seeds instead of 2"}
    assert group.nothing.endswith(f"to tell so large an effect takes 32 jobs instead of {now[seeds]}")


def trials_of_a_grid(seeds: int, values: int = 2) -> list[Row]:
    """Trials of one job and world, with two axes, of which one value fails always."""
    grid = product((0.0, 0.5), range(values), range(seeds))
    return [
        {"axes": {"delay": delay, "mass": mass}, "seed": seed, "outcome": "failed" if delay else "passed"}
        | {"trial": number, "state_digest": str(number)}
        for number, (delay, mass, seed) in enumerate(grid)
    ]


@pytest.mark.parametrize(
    "made",
    [trials_of_a_grid, lambda seeds: trials_of_a_grid(seeds, 5), lambda s: small_night(lambda _, m, __: m < 0.2, s)],
    ids=["trials", "many values", "jobs"],
)
@pytest.mark.parametrize("seeds", [1, 2, 4])
def test_whoever_runs_as_many_seeds_as_were_advised_gets_the_answer(
    made: Callable[[int], list[Row]], seeds: int
) -> None:
    before = explain(table_of(made(seeds)))
    assert before is not None
    if not before.groups[0].claims:
        [advised] = re.findall(r"such as (\d+) seeds? instead", before.groups[0].nothing)
        seeds = int(advised)
    after = explain(table_of(made(seeds)))
    assert after is not None
    assert [claim.region for claim in after.groups[0].claims] in (["delay = 0.5"], ["margin = 0.19"])


@pytest.mark.parametrize(
    ("parameters", "again", "command"),
    [
        ({"seeds": 2}, "robomaker run night.yaml", "robomaker run night.yaml --set seeds=8"),
        ({"seeds": 2}, "robomaker run night.yaml --set seeds=2", "robomaker run night.yaml --set seeds=8"),
        ({"seeds": 5}, "robomaker run night.yaml --set seeds=5", "robomaker run night.yaml --set seeds=5"),
        ({}, "robomaker run night.yaml", "robomaker run night.yaml"),
    ],
    ids=["a default", "set before", "of something else", "no parameter"],
)
def test_the_command_that_is_named_runs_as_many_seeds_as_were_advised(
    parameters: dict[str, int], again: str, command: str
) -> None:
    why = explain(table_of(trials_of_a_grid(2)), again=again)
    assert why is not None
    told = why.model_copy(update={"parameters": parameters}).headline
    assert told.endswith(f"such as 8 seeds instead of 2; then {command}")


def test_failures_of_few_jobs_that_come_by_chance_name_no_value() -> None:
    named = 0
    for seed in range(40):
        chance = np.random.default_rng(seed)
        why = explain(table_of(small_night(lambda *_, draw=chance: draw.random() < 0.5)))
        named += why is not None and re.search("may go with|^all ", why.groups[0].nothing) is not None
    assert named <= 2
    hard = explain(table_of(small_night(lambda _, __, world: world == 0)))
    assert hard is not None
    assert re.search("may go with|^all ", hard.groups[0].nothing) is None, "a hard world makes no axis guilty"


def test_of_many_axes_few_failures_by_chance_name_none() -> None:
    """An interval of one of many regions leaves out chance in most runs."""
    named = 0
    for run in range(30):
        chance = np.random.default_rng(run)
        failed = set(chance.choice(24, 2, replace=False).tolist())
        rows: list[Row] = [
            {"axes": {f"a{axis}": float(chance.integers(12)) for axis in range(4)}, "seed": number, "trial": number}
            | {"state_digest": str(number), "outcome": "failed" if number in failed else "passed"}
            for number in range(24)
        ]
        why = explain(table_of(rows))
        named += why is not None and "may go with" in why.groups[0].nothing
    assert named <= 3


def two_speeds(slow: int, fast: int, others: int = 0) -> list[Row]:
    """Trials of 16 seeds at two speeds: how many fail at each, and how many slow ones fail otherwise."""
    made: list[Row] = []
    for number in range(32):
        speed, seed = ("slow", "fast")[number % 2], number // 2
        row: Row = {"axes": {"SPEED": speed}, "seed": seed, "state_digest": str(number)}
        if seed < (fast if speed == "fast" else slow):
            row |= {"outcome": "failed"}
        elif speed == "slow" and seed < slow + others:
            row |= {"outcome": "failed", "requirements": [missed("upright")]}
        made.append(row)
    return made


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (
            two_speeds(11, 16),
            "too few trials to tell: it may go with SPEED = fast (16 of 16, elsewhere 11 of 16); to tell so large an "
            "effect takes 48 trials instead of 32, such as 24 seeds instead of 16",
        ),
        (
            two_speeds(0, 13, others=14),
            "too few trials to tell: it may go with SPEED = fast (13 of 16, elsewhere 0 of 2, without 14 that failed "
            "otherwise); to tell so large an effect takes 160 trials instead of 32, such as 80 seeds instead of 16",
        ),
    ],
    ids=["more often", "what hides the rest"],
)
def test_an_axis_that_may_be_the_cause_is_named_where_trials_are_too_few(rows: list[Row], said: str) -> None:
    why = explain(table_of(rows))
    assert why is not None
    [group] = [each for each in why.groups if each.requirement == "polite"]
    assert (group.claims, group.nothing) == ([], said)


def cells_of(draws: Callable[[], float], axes: int) -> list[Row]:
    """Trials of 36 cells with a seed each, of which four fail."""
    rows: list[Row] = []
    for number in range(36):
        listed = {"speed": 0.1 * (number % 6), "margin": 0.1 * (number // 6)}
        own = listed if axes == 2 else {"margin": 0.05 * number}
        rows.append({"axes": {name: value + draws() for name, value in own.items()}, "seed": 0})
    return [row | {"outcome": "failed" if number in (3, 11, 20, 29) else "passed"} for number, row in enumerate(rows)]


@pytest.mark.parametrize("axes", [1, 2])
def test_only_drawn_cells_are_told_to_have_more_points(axes: int) -> None:
    """A grid refuses `points`, however many cells it has."""
    chance = np.random.default_rng(1)
    grid, drawn = explain(table_of(cells_of(lambda: 0.0, axes))), explain(table_of(cells_of(chance.random, axes)))
    assert grid is not None
    assert drawn is not None
    assert re.search(r"such as \d seeds instead of 1$", grid.groups[0].nothing)
    assert re.search(r"such as \d+ points instead of 36$", drawn.groups[0].nothing)


def test_few_failures_say_first_what_they_share() -> None:
    """One of 4 delays, in which each world has a trial: no interval and no test leaves out chance."""
    rows: list[Row] = [
        {
            "axes": {"delay": delay}, "world": world, "job": f"sim-{world}", "trial": place, "seed": 1,
            "outcome": "failed" if delay == 0.6 else "passed",
        }
        for world in range(3) for place, delay in enumerate((0, 0.1, 0.2, 0.6))
    ]  # fmt: skip
    why = explain(table_of(rows))
    assert why is not None
    assert why.groups[0].nothing == (
        "all 3 have delay ≥ 0.6 (3 of 3, elsewhere 0 of 9); too few to claim: that takes 10 failures, and there are 3; "
        "at this rate that takes 40 trials instead of 12, such as 4 seeds instead of 1"
    )
