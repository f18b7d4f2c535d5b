"""Random formulas of signal temporal logic, and signals for them."""

import random

from prefect_robomaker.schemas.runs.formulas import Comparison, Formula, Join, Number, Temporal

PERIOD_S = 0.1
SIGNALS = ("a", "b", "c")
_SAMPLES = 25
"""Samples of a signal: more than most formulas look ahead, fewer than some do."""


def random_samples(dice: random.Random) -> dict[str, list[float]]:
    """Draws signals that stay for some time where they are."""
    return {name: [dice.uniform(-5, 5) for _ in range(_SAMPLES)] for name in SIGNALS}


def random_formula(dice: random.Random, depth: int = 4, *, bounded_until: bool = True) -> Formula:
    """Draws a formula.

    Args:
        dice: Where it is drawn from.
        depth: How deeply it may be nested.
        bounded_until: Whether `until` may have bounds; mtl has none.
    """
    if depth == 0 or dice.random() < 0.1:
        sign = dice.choice(("<", "<=", ">", ">="))
        return Comparison(sign, Number(dice.choice(SIGNALS)), Number(round(dice.uniform(-4, 4), 3)))

    def part() -> Formula:
        return random_formula(dice, depth - 1, bounded_until=bounded_until)

    word = dice.choice(("not", "and", "or", "->", "always", "eventually", "until", "always", "eventually"))
    if word == "not":
        return Join(word, (part(),))
    if word in ("and", "or", "->"):
        return Join(word, (part(), part()))
    first, width = dice.randrange(4), dice.randrange(5)
    bounds = (round(first * PERIOD_S, 1), round((first + width) * PERIOD_S, 1)) if dice.random() < 0.7 else None
    if word == "until":
        return Temporal(word, (part(), part()), bounds if bounded_until else None)
    return Temporal(word, (part(),), bounds)
