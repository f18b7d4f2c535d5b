"""Each axis of a run has an answer: what changes with it, by how much at most, or no claim."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from prefect_robomaker.schemas.reports.causes import AxisEffects
from prefect_robomaker.tasks.causes.effects import axis_effects
from prefect_robomaker.tasks.causes.explanation import explain

from .conftest import Row, table_of


def drawn(fails: Any, margin: Any, count: int = 400) -> list[Row]:
    """Trials of cells that were drawn by chance, in one world."""
    chance = np.random.default_rng(5)
    rows: list[Row] = []
    for seed in range(count):
        axes = {
            "mass": float(chance.random()),
            "idle": float(chance.random()),
            "KIND": str(chance.choice(["a", "b", "c"])),
        }
        outcome = "failed" if chance.random() < fails(axes) else "passed"
        rows.append({"axes": axes, "seed": seed, "outcome": outcome, "margin": margin(axes) + 0.1 * chance.normal()})
    return rows


def effects_of(rows: list[Row]) -> dict[str, AxisEffects]:
    table = table_of(rows)
    return {each.axis: each for each in axis_effects(table, explain(table))}


def test_axes_of_drawn_cells_are_told_apart_from_those_that_change_nothing() -> None:
    found = effects_of(drawn(lambda axes: 0.1 + 0.5 * axes["mass"], lambda axes: 0.5 * (axes["KIND"] == "b")))

    assert {name: each.answer for name, each in found.items()} == {
        "mass": "changes failures", "idle": "too few to tell", "KIND": "changes margin of polite",
    }  # fmt: skip
    [failures] = [each for each in found["mass"].effects if each.is_shown]
    assert failures.low < 0.8 * 0.5 < failures.high  # eight tenths of the axis, half a failure from end to end
    assert found["mass"].told == [failures.in_words]
    change = r"failures \+[\d.]+ points \(\+[\d.]+ to \+[\d.]+\) from 0\.\d+ to 0\.\d+"
    assert re.fullmatch(rf"polite: mass ≥ 0\.\d+; {change}", failures.in_words)
    assert [each.value for each in found["KIND"].effects if each.is_shown] == ["b"]
    # What claims nothing says how large an effect may be at most.
    assert [each.low < 0 < each.high for each in found["idle"].effects] == [True, True]
    assert len(found["idle"].told) == 2


def test_what_is_too_rare_for_an_interval_is_no_claim_and_says_so() -> None:
    found = effects_of(drawn(lambda axes: 0.0 if axes["mass"] < 0.98 else 1.0, lambda _: 0.0))
    [mass] = [each for each in found["mass"].effects if not each.on]
    assert mass.refused.startswith("an interval takes 10 failures, and there ")
    assert found["mass"].answer == "too few to tell"


def test_values_that_few_trials_have_are_no_cause_though_none_of_them_fails() -> None:
    """Twenty trials that fail once in twenty times all pass in one of three cases, with no spread among them."""
    chance = np.random.default_rng(4)
    rows: list[Row] = [
        {"axes": {"KIND": "rare" if seed % 15 == 0 else "usual"}, "seed": seed, "margin": float(chance.normal())}
        | {"outcome": "failed" if seed % 15 and chance.random() < 0.05 else "passed"}
        for seed in range(300)
    ]
    [failures, margin] = effects_of(rows)["KIND"].effects
    assert re.fullmatch(
        r"an interval takes 5 failures to be expected with its rarer values, and there are 0[\d.]+",
        failures.refused,
    )
    assert not margin.refused


def test_an_axis_with_the_same_states_at_each_value_changes_nothing() -> None:
    rows: list[Row] = [
        {"axes": {"gain": gain, "unread": unread}, "seed": seed, "state_digest": f"{gain} {seed}"}
        for gain in (0.0, 1.0)
        for unread in ("x", "y")
        for seed in range(12)
    ]
    found = effects_of(rows)
    assert found["unread"].answer.startswith("changes nothing")
    assert found["gain"].answer == "no effect shown"


def test_an_axis_whose_one_value_always_fails_is_not_called_harmless() -> None:
    """Six of six jobs fail with one value, and none of six with the other: too few for an interval."""
    rows: list[Row] = [
        {"axes": {"margin": margin}, "seed": seed, "outcome": "failed" if margin < 0.2 else "passed"}
        for seed in range(6)
        for margin in (0.28, 0.19)
    ]
    assert effects_of(rows)["margin"].answer == "too few to tell"


def grid(fails: Callable[[float, str], bool], seeds: int = 16) -> list[Row]:
    """Trials of all cells of two axes, which do the same with each seed."""
    return [
        {
            "axes": {"noise": noise, "SPEED": speed}, "seed": seed, "outcome": "failed" if fails(noise, speed) else
            "passed", "margin": 0.1 * (speed == "slow") + 0.01 * seed, "state_digest": f"{noise} {speed} {seed}",
        }
        for seed in range(seeds) for noise in (0.1, 0.7, 0.9) for speed in ("slow", "fast")
    ]  # fmt: skip


def test_an_error_of_rounding_is_no_effect_and_trials_that_are_all_alike_have_an_interval() -> None:
    found = effects_of(grid(lambda _, speed: speed == "fast"))

    assert {name: each.answer for name, each in found.items()} == {
        "noise": "too few to tell", "SPEED": "changes failures, margin of polite",
    }  # fmt: skip
    assert all(each.high > each.low for axis in found.values() for each in axis.effects)
    assert [each.change for each in found["noise"].effects] == [0, 0]
    [failures, margin] = found["SPEED"].effects
    # Of 16 seeds, none did otherwise: at most a share of 1 - (0.05 / 4) ** (1 / 16) does, and changes by 2 at most.
    assert max(abs(failures.low), abs(failures.high)) == 1
    assert failures.high - failures.low == pytest.approx(2 * (1 - (0.05 / 4) ** (1 / 16)))
    assert margin.high - margin.low > 0.01


@pytest.mark.parametrize("rate", [0.0, 0.15, 0.5])
@pytest.mark.parametrize("seed", range(4))
def test_failures_depend_on_an_axis_exactly_where_why_claims_a_cause_with_it(rate: float, seed: int) -> None:
    chance = np.random.default_rng(seed)
    rows: list[Row] = [
        {
            "axes": {"KIND": kind, "mass": float(chance.random())}, "seed": number,
            "outcome": "failed" if chance.random() < (0.1 + rate if kind == "a" else 0.1) else "passed",
        }
        for number in range(120) for kind in "ab"
    ]  # fmt: skip
    table = table_of(rows)
    why = explain(table)
    assert why is not None
    claimed = {axis for group in why.groups for claim in group.claims for axis in claim.axes}
    changing = {each.axis for each in axis_effects(table, why) if "failures" in each.answer}
    assert changing == claimed


def test_a_margin_has_one_interval_in_why_and_in_the_effects_of_axes() -> None:
    table = table_of(drawn(lambda _: 0.3, lambda axes: 0.5 * axes["mass"], 100))
    why = explain(table)
    assert why is not None
    effects = {
        (each.axis, effect.on): (effect.low, effect.high)
        for each in axis_effects(table, why)
        for effect in each.effects
    }
    assert why.sensitivities
    for each in why.sensitivities:
        assert (each.low, each.high) == effects[each.axis, each.requirement]


def test_an_axis_of_which_no_claim_was_tested_is_not_left_to_chance_by_tests() -> None:
    """Eleven failures have an interval, and are too few for a claim of one of three axes."""
    rows: list[Row] = [
        {
            "axes": {"SPEED": speed, "FLOOR": "ab"[seed % 2], "LIGHT": "cd"[seed // 2 % 2]}, "seed": seed,
            "outcome": "failed" if speed == "fast" and seed < 11 else "passed",
        }
        for seed in range(24) for speed in ("fast", "slow")
    ]  # fmt: skip
    found = effects_of(rows)["SPEED"].effects[0]
    assert (found.claim, found.low > 0 or found.high < 0) == ("", True)
    assert found.in_words.endswith(", which is no claim, as none with this axis was tested; Why says the reason")


def test_what_happens_in_one_cell_of_each_seed_is_told_by_the_corner_and_not_by_the_line_alone() -> None:
    def alone(noise: float, speed: str) -> bool:
        return speed == "fast" and noise == 0.9

    few, many = (effects_of(grid(alone, seeds))["SPEED"].effects[0] for seeds in (12, 60))
    assert few.low < 0 < few.high, "a straight line of few seeds shows nothing"
    assert few.is_shown
    assert few.in_words.startswith("polite: SPEED = fast and noise ≥ 0.9; failures ")
    assert few.change == pytest.approx(many.change)


@pytest.mark.parametrize(
    "rows", [[{"outcome": "broken", "axes": {"mass": 1.0}}], [{}], [{"axes": {"mass": 1.0}}, {"axes": {"mass": None}}]]
)
def test_any_table_has_an_answer(rows: list[Row]) -> None:
    table = table_of(rows)
    assert all(not effect.is_shown for each in axis_effects(table, explain(table)) for effect in each.effects)
