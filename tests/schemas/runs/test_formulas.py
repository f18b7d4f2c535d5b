"""Formulas of signal temporal logic: read as text, and judged by their robustness.

`robustness_by_definition` writes the definition down and knows nothing of the product. Another library, mtl, was asked
for `formula_robustness.txt`; `tests/schemas/runs/record_formulas.py` says how.
"""

import math
import random
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest
from helpers.random_formulas import PERIOD_S, SIGNALS, random_formula, random_samples

from prefect_robomaker.schemas.runs.formulas import (
    Arithmetic,
    Comparison,
    Formula,
    FormulaError,
    Join,
    Number,
    in_words,
    read_formula,
)
from prefect_robomaker.schemas.runs.robustness import robustness

RECORDED = Path(__file__).with_name("formula_robustness.txt")

Interval = tuple[float, float]


def robustness_by_definition(formula: Formula, samples: Mapping[str, Sequence[float]], at: int) -> Interval:  # noqa: C901
    """Least and most robustness at a sample, from the definitions of the operators."""
    count = len(next(iter(samples.values())))

    def number(node: Number | Arithmetic, time: int) -> float:
        if isinstance(node, Number):
            return samples[node.value][time] if isinstance(node.value, str) else node.value
        parts = [number(part, time) for part in node.parts]
        if node.sign == "abs":
            return abs(parts[0])
        signs: Mapping[str, Callable[[float, float], float]] = {
            "+": lambda a, b: a + b, "-": lambda a, b: a - b, "*": lambda a, b: a * b,
        }  # fmt: skip
        return signs[node.sign](*parts)

    def least_of(pairs: Sequence[Interval]) -> Interval:
        return min((a for a, _ in pairs), default=math.inf), min((b for _, b in pairs), default=math.inf)

    def most_of(pairs: Sequence[Interval]) -> Interval:
        return max((a for a, _ in pairs), default=-math.inf), max((b for _, b in pairs), default=-math.inf)

    def value(node: Formula, time: int) -> Interval:
        if isinstance(node, Comparison):
            if time >= count:
                return -math.inf, math.inf
            apart = number(node.right, time) - number(node.left, time)
            apart = apart if node.sign in ("<", "<=") else -apart
            return apart, apart
        if isinstance(node, Join):
            parts = [value(part, time) for part in node.parts]
            if node.word in ("not", "->"):
                parts[0] = (-parts[0][1], -parts[0][0])
            return least_of(parts) if node.word == "and" else most_of(parts)
        if node.bounds is None:
            if time >= count:
                return -math.inf, math.inf
            times = range(time, count)
        else:
            first, last = (round(end / PERIOD_S) for end in node.bounds)
            times = range(time + first, time + last + 1)
        if node.word == "until":
            hold, reach = node.parts
            ways = [[value(reach, each), *(value(hold, before) for before in range(time, each))] for each in times]
            return most_of([least_of(way) for way in ways])
        parts = [value(node.parts[0], each) for each in times]
        return least_of(parts) if node.word == "always" else most_of(parts)

    return value(formula, at)


def assert_same(formula: Formula, samples: Mapping[str, Sequence[float]]) -> None:
    least, most = robustness_by_definition(formula, samples, 0)
    found = robustness(formula, samples, PERIOD_S)
    if math.isfinite(least):
        assert found.least == pytest.approx(least, abs=1e-9), in_words(formula)
    else:
        assert found.least == math.copysign(1e300, least), in_words(formula)
    if math.isfinite(most):
        assert found.most == pytest.approx(most, abs=1e-9), in_words(formula)
    else:
        assert found.most == math.copysign(1e300, most), in_words(formula)


@pytest.mark.parametrize("count", [60, pytest.param(400, marks=pytest.mark.endurance)])
def test_random_formulas_have_the_robustness_of_the_definition(count: int) -> None:
    decided = 0
    for seed in range(count):
        dice = random.Random(seed)
        formula, samples = random_formula(dice), random_samples(dice)
        assert_same(read_formula(in_words(formula), SIGNALS), samples)
        least, most = robustness_by_definition(formula, samples, 0)
        decided += least > 0 or most < 0
    assert count / 3 < decided < count, "runs that are too short for their formulas have to occur, and others too"


@pytest.mark.parametrize("every", [20, pytest.param(4, marks=pytest.mark.deep)])
def test_another_library_has_found_the_same(every: int) -> None:
    """It continues a run by its last sample: one of the ways in which it could go on.

    Its robustness of `until` has the right sign only: it leaves out the left side where the right one fails.
    So of formulas with `until` only the answer is compared; `robustness_by_definition` checks their numbers.
    """
    lines = RECORDED.read_text().splitlines()
    assert len(lines) == 1000
    compared = 0
    for seed in range(0, len(lines), every):
        dice = random.Random(seed)
        formula, samples = random_formula(dice, bounded_until=False), random_samples(dice)
        found, other = robustness(formula, samples, PERIOD_S), float(lines[seed])
        if "until" not in in_words(formula):
            compared += 1
            assert found.least - 1e-6 <= other <= found.most + 1e-6, in_words(formula)
        elif found.least > 0 or found.most < 0:
            assert (found.least > 0) == (other > 0), in_words(formula)
    assert compared > 500 / every


def judged(text: str, **samples: Sequence[float]) -> tuple[float, float]:
    found = robustness(read_formula(text, [*samples]), samples, PERIOD_S)
    return found.least, found.most


def test_what_the_run_did_not_last_for_is_open() -> None:
    """A run that ends before it could be wrong must not pass."""
    speeds = [1.0, 1.0, 1.0]
    assert judged("always[0, 0.5] speed < 2", speed=speeds) == (-1e300, 1.0)
    assert judged("always[0, 0.2] speed < 2", speed=speeds) == (1.0, 1.0)
    assert judged("eventually[0, 0.5] speed > 2", speed=speeds) == (-1.0, 1e300)
    assert judged("eventually speed > 2", speed=speeds) == (-1.0, -1.0), "until the run ends, and it has ended"
    assert judged("always eventually[0, 0.1] speed > 2", speed=[1.0, 1.0, 1.0, 1.0]) == (-1.0, -1.0)
    assert judged("always (speed > 2 -> eventually[0, 0.3] speed < 1)", speed=[1.0, 3.0, 3.0]) == (-1.0, 1e300)


@pytest.mark.parametrize(("sign", "holds"), [("<", False), ("<=", True), (">", False), (">=", True)])
def test_equal_sides_are_told_apart(sign: str, holds: bool) -> None:
    """A robot that stands still has exactly the speed 0, and `speed > 0` must not hold for it."""
    least, _ = judged(f"always speed {sign} 0", speed=[0.0, 0.0])
    assert (least > 0) == holds
    assert (judged(f"not eventually speed {sign} 0", speed=[0.0, 0.0])[0] > 0) != holds


def test_the_first_violation_and_idle_conditions_are_found() -> None:
    formula = read_formula("always (near < 1 -> speed < 2) and always[0.1, 0.2] speed < 9", ["near", "speed"])
    fast = robustness(formula, {"near": [5, 0, 0, 0], "speed": [5, 1, 3, 4]}, PERIOD_S)
    assert (fast.most, fast.violated_at, fast.idle) == (-1, 2, ())
    far = robustness(formula, {"near": [5, 5, 5, 5], "speed": [5, 1, 3, 4]}, PERIOD_S)
    assert [in_words(each) for each in far.idle] == ["near < 1"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("speed", "speed is a number, and a formula says yes or no; compare it, as in speed < 1"),
        ("always sped < 1", "column 8: there is no signal 'sped'; did you mean 'speed'?"),
        ("always foo < 1", "there is no signal 'foo'; there are speed, near"),
        ("1 < 2", "it uses no signal, so it could not be missed; there are speed, near"),
        ("speed == 3", "column 7, '==': two measured numbers are never the same; write abs(a - b) < 0.1"),
        ("always[3, 1] speed < 1", "column 11, '1': the bounds end before they begin, at 3"),
        ("always[0] speed < 1", "bounds have two numbers; write [0, 3], seconds from now"),
        ("always[a, 1] speed < 1", "a bound is a number of seconds"),
        ("0 < speed < 1", "a comparison has two sides; join two of them by and"),
        ("(speed < 1", "column 11, the end: a bracket is open; close it with )"),
        ("speed < 1)", "column 10, ')': the formula is over here"),
        ("speed < 1 & near > 2", "write and"),
        ("(speed < 1) + 2 < 3", "speed < 1 is no number"),
        ("speed < 1 and near", "near is a number"),
        ("speed / 2 < 1", "write * 0.5 for / 2"),
        ("speed < 1 until near < 1 until speed > 2", "which until comes first is not clear"),
        ("always", "column 7, the end: a signal, a number or a bracket has to be here"),
        ("speed < 1 $", "column 11: '$' is no part of a formula"),
        ("(" * 40 + "speed < 1" + ")" * 40, "it is nested more than 30 deep"),
        ("not " * 40 + "speed < 1", "it is nested more than 30 deep"),
        ("-" * 40 + "speed < 1", "it is nested more than 30 deep"),
    ],
)  # fmt: skip
def test_what_is_no_formula_is_told_with_its_column_and_a_remedy(text: str, words: str) -> None:
    with pytest.raises(FormulaError) as told:
        read_formula(text, ["speed", "near"])
    assert words in str(told.value)


def test_what_binds_more_tightly() -> None:
    text = (
        "always speed < 1 + 2 * near or not speed > 3 and eventually[0, .5] near < 1 -> speed < 1 until[0, 1] near > 2"
    )
    assert in_words(read_formula(text, ["speed", "near"])) == (
        "((always (speed < (1 + (2 * near)))) or ((not (speed > 3)) and (eventually[0, 0.5] (near < 1))))"
        " -> ((speed < 1) until[0, 1] (near > 2))"
    )


def test_a_long_formula_is_no_deep_one() -> None:
    text = " and ".join(["speed < 1"] * 40)
    assert judged(text, speed=[0.5]) == (0.5, 0.5)
