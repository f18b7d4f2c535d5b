"""Robustness of signal temporal logic formulas over a run, by rtamt: the margin by which a formula holds.

A run ends, but formulas may depend on later times: `eventually[0, 3]` at its last second. So there are two numbers: the
minimum and the maximum of the robustness over everything that could follow the end. They are equal if the run decides
the formula. Operators without bounds end with the run, so nothing later counts for them.

rtamt computes both: the samples are extended beyond the end as far as the formula needs, with the worst values for one
and the best for the other. Each comparison becomes a signal for it, once for each direction that is good.
"""

import importlib
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from .formulas import Arithmetic, Comparison, Formula, Join, Number, Temporal, in_words, signals_of

_FAR = 1e300
"""Robustness of something certain, larger than that of any signal."""
_STRICT = 1e-12
"""Robustness of a comparison whose sides are equal: `<` is then violated and `<=` satisfied; 0 would be ambiguous."""

_SMALLER = 16
"""Number of test values for all smaller values of a signal, as comparisons of products and `abs` may change twice."""

Samples = Mapping[str, Sequence[float]]


@dataclass(frozen=True)
class Robustness:
    """Lower and upper bound of a formula's robustness, the margin by which a run satisfies it."""

    least: float
    """Robustness with the worst continuation after the end; above 0 the formula holds in any case."""
    most: float
    """Robustness with the best continuation after the end; below 0 the formula is violated in any case."""
    violated_at: int | None = None
    """Index of the first sample at which a violation is certain; None: there is none, or only the end shows it."""
    idle: tuple[Formula, ...] = ()
    """Conditions, left of `->`, that never held, so that their consequences were not tested."""


def robustness(formula: Formula, samples: Samples, period_s: float) -> Robustness:
    """Computes the robustness of a temporal logic formula: the margin by which samples satisfy it.

    Args:
        formula: Formula whose time bounds are multiples of the period.
        samples: Values of its signals over the whole run, all of one length.
        period_s: Seconds between two samples.

    Raises:
        ImportError: Rtamt is not installed.
        OverflowError: A comparison has numbers that are too large.
    """
    least, most = (_at_all_times(formula, samples, period_s, is_worst=each)[0] for each in (True, False))
    violated_at = _first_violation(formula, samples, period_s) if most < 0 else None
    idle = tuple(each for each in _conditions(formula) if not _ever_holds(each, samples, period_s))
    return Robustness(least, most, violated_at, idle)


def differs_below(formula: Formula, samples: Samples, signal: str, bound: float) -> Comparison | None:
    """Finds a comparison that would change at any sample if a signal were smaller, from 0 to a bound.

    Args:
        formula: The formula.
        samples: Values of its signals.
        signal: Name of the signal.
        bound: Value below which the signal was not measured.

    Returns:
        The first such comparison; `None` if there is none.
    """
    if not isinstance(formula, Comparison):
        found = (differs_below(part, samples, signal, bound) for part in formula.parts)
        return next((each for each in found if each is not None), None)
    if signal not in signals_of(formula) or bound <= 0:
        return None
    length = len(next(iter(samples.values())))

    def holds(value: float) -> list[bool]:
        with_it = {**samples, signal: [value] * length}
        return [each > 0 for each in _values(formula, with_it, length)]

    at_bound = holds(bound)
    smaller = (bound * step / _SMALLER for step in range(_SMALLER))
    return formula if any(holds(each) != at_bound for each in smaller) else None


def horizon(formula: Formula, period_s: float) -> int:
    """Returns how many samples ahead of a time a formula reads; operators without bounds do not read beyond the end."""
    if isinstance(formula, Comparison):
        return 0
    inner = max(horizon(part, period_s) for part in formula.parts)
    bounds = formula.bounds if isinstance(formula, Temporal) else None
    return inner + (0 if bounds is None else round(bounds[1] / period_s))


def _first_violation(formula: Formula, samples: Samples, period_s: float) -> int | None:
    """Returns the index of the first sample at which a condition that always has to hold is violated; else `None`."""
    if isinstance(formula, Join) and formula.word == "and":
        found = [_first_violation(part, samples, period_s) for part in formula.parts]
        return min((each for each in found if each is not None), default=None)
    if not isinstance(formula, Temporal) or formula.word != "always":
        return None
    (part,) = formula.parts
    first, last = formula.bounds or (0.0, float("inf"))
    values = _at_all_times(part, samples, period_s, is_worst=False)
    times = (number for number, value in enumerate(values) if value < 0)
    return next((number for number in times if first - 1e-9 <= number * period_s <= last + 1e-9), None)


def _conditions(formula: Formula) -> list[Formula]:
    if isinstance(formula, Comparison):
        return []
    own = [formula.parts[0]] if isinstance(formula, Join) and formula.word == "->" else []
    return [*own, *(each for part in formula.parts for each in _conditions(part))]


def _ever_holds(formula: Formula, samples: Samples, period_s: float) -> bool:
    return any(value > 0 for value in _at_all_times(formula, samples, period_s, is_worst=False))


def _at_all_times(formula: Formula, samples: Samples, period_s: float, *, is_worst: bool) -> list[float]:
    """Computes the robustness at each sample, by rtamt."""
    with warnings.catch_warnings():  # its parser's runtime of 2017 uses what Python has deprecated since
        warnings.simplefilter("ignore")
        rtamt: Any = importlib.import_module("rtamt")
        length = len(next(iter(samples.values())))
        beyond = horizon(formula, period_s) + 1  # one at least, so that there is an end
        text = _Text(samples, length, beyond, period_s, is_worst)
        specification = rtamt.StlDiscreteTimeOfflineSpecification()
        specification.spec = text.of(formula, is_good=True)
        for name in text.signals:
            specification.declare_var(name, "float")
        specification.parse()
        found: list[list[float]] = specification.evaluate({"time": list(range(length + beyond)), **text.signals})
    return [value for _, value in found[:length]]


@dataclass
class _Text:
    """Text of a formula for rtamt, and the signals in it."""

    samples: Samples
    length: int
    beyond: int
    period_s: float
    is_worst: bool
    signals: dict[str, list[float]] = field(default_factory=dict[str, list[float]])

    def of(self, formula: Formula, *, is_good: bool) -> str:
        """Returns the text of a formula.

        Args:
            formula: Formula, or part of one.
            is_good: Whether more robustness of this part makes the whole more robust; `not` reverses that.
        """
        if isinstance(formula, Comparison):
            return self._signal(_values(formula, self.samples, self.length), self._unknown(is_good=is_good))
        if isinstance(formula, Join):
            if formula.word == "->":
                left, right = formula.parts
                return f"((not {self.of(left, is_good=not is_good)}) or {self.of(right, is_good=is_good)})"
            if formula.word == "not":
                return f"(not {self.of(formula.parts[0], is_good=not is_good)})"
            return _balanced(formula.word, [self.of(part, is_good=is_good) for part in formula.parts])
        parts = [self.of(part, is_good=is_good) for part in formula.parts]
        if formula.bounds is None:
            return self._to_the_end(formula.word, parts, self._unknown(is_good=is_good))
        first, last = (round(end / self.period_s) for end in formula.bounds)
        if formula.word != "until":
            return f"({formula.word}[{first}:{last}] {parts[0]})"
        # rtamt takes the square of the bounds for this; in these words it is the same, and fast.
        hold = f"(always[0:{first - 1}] {parts[0]}) and " if first else ""
        reach = f"(eventually[{first}:{last}] {parts[1]})"
        return f"({hold}({reach} and (eventually[{first}:{first}] ({parts[0]} until {parts[1]}))))"

    def _to_the_end(self, word: str, parts: Sequence[str], unknown: float) -> str:
        """Makes the text of an operator without bounds, which ignores samples and results beyond the end."""
        during, after = [_FAR] * self.length, [-_FAR] * self.length
        is_during = self._signal(during, -_FAR)
        is_known = self._signal(during, unknown)
        is_later = self._signal(after, unknown)
        if word == "always":
            return f"((always ((not {is_during}) or {parts[0]})) and {is_known})"
        if word == "eventually":
            return f"((eventually ({is_during} and {parts[0]})) or {is_later})"
        return f"(({parts[0]} until ({is_during} and {parts[1]})) or {is_later})"

    def _unknown(self, *, is_good: bool) -> float:
        """Returns the robustness of a part beyond the end of the run."""
        return -_FAR if self.is_worst == is_good else _FAR

    def _signal(self, values: Sequence[float], beyond: float) -> str:
        name = f"s{len(self.signals)}"
        self.signals[name] = [*values, *[beyond] * self.beyond]
        return f"({name} >= 0)"


def _balanced(word: str, parts: Sequence[str]) -> str:
    """Joins texts by a word so that brackets are not nested deeply."""
    if len(parts) == 1:
        return parts[0]
    half = len(parts) // 2
    return f"({_balanced(word, parts[:half])} {word} {_balanced(word, parts[half:])})"


def _values(comparison: Comparison, samples: Samples, length: int) -> list[float]:
    """Computes the robustness of a comparison at each sample, positive where it holds.

    Raises OverflowError if its numbers are too large to compare.
    """
    left, right = (_numbers(side, samples, length) for side in (comparison.left, comparison.right))
    is_below = comparison.sign in ("<", "<=")
    equal = -_STRICT if comparison.sign in ("<", ">") else _STRICT
    apart = [b - a if is_below else a - b for a, b in zip(left, right, strict=True)]
    if not all(map(math.isfinite, apart)):  # what is not a number is neither met nor missed
        raise OverflowError(f"{in_words(comparison)}: its numbers are too large to compare")
    return [value if value else equal for value in apart]


def _numbers(node: Number | Arithmetic, samples: Samples, length: int) -> Sequence[float]:
    if isinstance(node, Number):
        return samples[node.value] if isinstance(node.value, str) else [node.value] * length
    parts = [_numbers(part, samples, length) for part in node.parts]
    if node.sign == "abs":
        return [abs(value) for value in parts[0]]
    pairs = zip(*parts, strict=True)
    if node.sign == "*":
        return [a * b for a, b in pairs]
    return [a + b for a, b in pairs] if node.sign == "+" else [a - b for a, b in pairs]
