"""Regions of axes: values above or below a cut, and single values; and products of those of several axes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .evidence import AxisColumn

CUTS = 9
"""Cuts of an axis by itself: tenths of its trials."""
CUTS_OF_PAIRS = 4
"""Cuts of an axis in a pair: fifths, so that a corner of both has a twenty-fifth of the trials."""
CUTS_OF_TRIPLES = 2
"""Cuts of one of three axes: thirds, so that a corner of all has a twenty-seventh."""


_SMALL = 0.1
"""Numbers below it have two digits behind their noughts, so that they are no longer than others."""


@dataclass(frozen=True)
class Region:
    """Part of an axis: the values from a cut on, those below it, or one value."""

    axis: str
    words: str
    """Such as `noise ≥ 0.021` or `FLOOR = carpet`."""
    codes: frozenset[int]
    """Numbers of its values in the column of the axis."""
    direction: Literal["≥", "<", "="]

    def weights(self, axis: AxisColumn) -> NDArray[np.float64]:
        """Returns the rank of each trial's value in the region's direction, from 0 to 1; the cut does not matter."""
        if self.direction == "=":
            return self.mask(axis).astype(np.float64)
        known = np.array([value is not None for value in axis.values])
        counts = np.bincount(axis.codes, minlength=len(known)) * known
        below = (np.cumsum(counts) - counts / 2) / max(1, counts.sum())
        ranks = np.where(known, below if self.direction == "≥" else 1 - below, 0.0)
        return ranks[axis.codes]

    def mask(self, axis: AxisColumn) -> NDArray[np.bool_]:
        """Returns a mask of the trials whose values lie in the region."""
        chosen = np.zeros(len(axis.values), dtype=np.bool_)
        chosen[list(self.codes)] = True
        return chosen[axis.codes]


def regions_of(axis: AxisColumn, cuts: int = CUTS) -> list[Region]:
    """Lists the regions of an axis that may be a cause.

    Args:
        axis: The axis.
        cuts: Number of cuts of an axis that has more values.
    """
    if not axis.is_number:
        return [_single(axis, code) for code in range(len(axis.values))]
    built = [_single(axis, code) for code, value in enumerate(axis.values) if value is None]
    known = [code for code, value in enumerate(axis.values) if value is not None]
    return [*(region for cut in _cuts(axis, known, cuts) for region in _halves(axis, known, cut)), *built]


def _single(axis: AxisColumn, code: int) -> Region:
    return Region(axis.name, f"{axis.name} = {axis.label(code)}", frozenset([code]), "=")


def _cuts(axis: AxisColumn, known: Sequence[int], cuts: int) -> list[int]:
    """Returns the numbers of the values at which an axis is cut, so that its parts have about equally many trials."""
    if len(known) <= cuts + 1:
        return list(known[1:])
    counts = np.bincount(axis.codes, minlength=len(axis.values))[list(known)]
    shares = np.cumsum(counts) / counts.sum()
    places = np.searchsorted(shares, np.arange(1, cuts + 1) / (cuts + 1)) + 1
    return [known[place] for place in sorted({*places.tolist()}) if 0 < place < len(known)]


def _halves(axis: AxisColumn, known: Sequence[int], cut: int) -> Iterator[Region]:
    least, limit = axis.label(known[0]), axis.label(cut)
    # Nothing lies between two values: each half is one of them, and is named so.
    above, below = (f"= {limit}", f"= {least}") if len(known) == 2 else (f"≥ {limit}", f"< {limit}")
    yield Region(axis.name, f"{axis.name} {above}", frozenset(code for code in known if code >= cut), "≥")
    yield Region(axis.name, f"{axis.name} {below}", frozenset(code for code in known if code < cut), "<")


def directions_of(axis: AxisColumn) -> int:
    """Returns the number of ways in which an axis can be a cause: larger, smaller, or each value that is no number."""
    built = sum(value is None for value in axis.values)
    return 2 + built if axis.is_number else len(axis.values)


def corners_of(axes: Sequence[AxisColumn], cuts: int) -> list[tuple[Region, ...]]:
    """Lists the corners of two axes or more: a region of each.

    Args:
        axes: The axes.
        cuts: Number of cuts of an axis that has more values.
    """
    return list(product(*(regions_of(axis, cuts) for axis in axes)))


def parts_of(axis: AxisColumn, most: int = 5) -> list[tuple[str, NDArray[np.bool_]]]:
    """Splits an axis into parts for a drawing, each with its words and its trials.

    Args:
        axis: The axis.
        most: Number of parts of an axis of numbers that has more values.
    """
    known = [code for code, value in enumerate(axis.values) if value is not None]
    if not axis.is_number or len(known) <= most:
        return [(axis.label(code), axis.codes == code) for code in range(len(axis.values))]
    starts = _cuts(axis, known, most - 1)
    edges = [known[0], *starts, known[-1] + 1]
    words = [_short(axis, start) for start in starts]
    labels = [f"< {words[0]}", *(f"{low}–{high}" for low, high in pairwise(words)), f"≥ {words[-1]}"]
    parts = [
        (label, (axis.codes >= low) & (axis.codes < high))
        for label, (low, high) in zip(labels, pairwise(edges), strict=True)
    ]
    built = [(axis.label(code), axis.codes == code) for code, value in enumerate(axis.values) if value is None]
    return [*parts, *built]


def _short(axis: AxisColumn, code: int) -> str:
    """Formats a value for a narrow column: with two or three significant digits."""
    value = float(axis.values[code] or 0.0)
    return f"{value:.2g}" if abs(value) < _SMALL else f"{value:.3g}"
