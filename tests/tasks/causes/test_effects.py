"""Each axis of a run has an answer: what changes with it, by how much at most, or no claim."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from prefect_robomaker.schemas.reports.causes import AxisEffects
from prefect_robomaker.tasks.causes.effects import axis_effects

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
    return {each.axis: each for each in axis_effects(table_of(rows))}


def test_axes_of_drawn_cells_are_told_apart_from_those_that_change_nothing() -> None:
    found = effects_of(drawn(lambda axes: 0.1 + 0.5 * axes["mass"], lambda axes: 0.5 * (axes["KIND"] == "b")))

    assert {name: each.answer for name, each in found.items()} == {
        "mass": "changes failures", "idle": "no effect shown", "KIND": "changes margin of polite",
    }  # fmt: skip
    [failures] = [each for each in found["mass"].effects if each.is_shown]
    assert failures.low < 0.8 * 0.5 < failures.high  # eight tenths of the axis, half a failure from end to end
    assert found["mass"].told == [failures.in_words]
    assert re.fullmatch(r"failures \+[\d.]+ points \(\+[\d.]+ to \+[\d.]+\) from 0\.\d+ to 0\.\d+", failures.in_words)
    assert [each.value for each in found["KIND"].effects if each.is_shown] == ["b"]
    # What claims nothing says how large an effect may be at most.
    assert [each.low < 0 < each.high for each in found["idle"].effects] == [True, True]
    assert len(found["idle"].told) == 2


def test_what_is_too_rare_for_an_interval_is_no_claim_and_says_so() -> None:
    found = effects_of(drawn(lambda axes: 0.0 if axes["mass"] < 0.98 else 1.0, lambda _: 0.0))
    [mass] = [each for each in found["mass"].effects if not each.on]
    assert mass.refused.startswith("an interval takes 10 failures, and there ")
    assert found["mass"].answer == "no effect shown"


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
        "noise": "no effect shown", "SPEED": "changes failures, margin of polite",
    }  # fmt: skip
    assert all(each.high > each.low for axis in found.values() for each in axis.effects)
    assert [each.change for each in found["noise"].effects] == [0, 0]
    [failures, margin] = found["SPEED"].effects
    # Of 16 seeds, none did otherwise: at most a share of 1 - (0.05 / 4) ** (1 / 16) does, and changes by 2 at most.
    assert max(abs(failures.low), abs(failures.high)) == 1
    assert failures.high - failures.low == pytest.approx(2 * (1 - (0.05 / 4) ** (1 / 16)))
    assert margin.high - margin.low > 0.01


def test_what_happens_in_one_cell_of_each_seed_is_no_claim_of_few_seeds() -> None:
    def alone(noise: float, speed: str) -> bool:
        return speed == "fast" and noise == 0.9

    few, many = (effects_of(grid(alone, seeds))["SPEED"] for seeds in (12, 60))
    assert "failures" not in few.answer
    assert many.effects[0].is_shown
    assert few.effects[0].change == pytest.approx(many.effects[0].change)


@pytest.mark.parametrize(
    "rows", [[{"outcome": "broken", "axes": {"mass": 1.0}}], [{}], [{"axes": {"mass": 1.0}}, {"axes": {"mass": None}}]]
)
def test_any_table_has_an_answer(rows: list[Row]) -> None:
    assert all(not effect.is_shown for each in axis_effects(table_of(rows)) for effect in each.effects)
