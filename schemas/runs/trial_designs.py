"""Designs of trials: the combinations of axis values (cells) that a job tries.

A grid has all combinations except excluded ones; other designs have a requested number of points. Explicitly included
cells come after all others.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from math import prod
from typing import TYPE_CHECKING, Annotated, Any, Literal

from ..wire.base import ShapeName
from .axis_kinds.kind import Axis, Value

if TYPE_CHECKING:
    from numpy.typing import NDArray

TrialDesign = Annotated[Literal["grid", "random", "latin-hypercube", "sobol"], ShapeName("TrialDesign")]
"""Ways to choose cells: all combinations, random, random with every part of each axis covered, or evenly spread."""

Cell = Mapping[str, Value]
"""Values of axes by name; axes that are missing keep their default value."""

_STREAM = 0x61786573  # "axes" in ASCII
"""Constant in the seed of designs, so that they differ from the random numbers of trials with the same seed."""


def wrong_excluded(axes: Mapping[str, Axis], excluded: Mapping[str, Value], place: str) -> Iterator[str]:
    """Yields reasons why an excluded combination matches no cell of a grid: unknown axis, or unknown value.

    Args:
        axes: Axes of the grid.
        excluded: Values by axis name.
        place: Path of the combination in the request, with which each problem begins.
    """
    if not excluded:
        yield f"{place}: it names no axis, which every cell would be like; name an axis and its value"
    for name, value in excluded.items():
        if value not in (listed := axes[name].listed or ()):
            shown = ", ".join(f"{each!r}" for each in listed[:10])
            yield f"{place}.{name}: the axis has no value {value!r}; it has {shown}"


def grid_size(axes: Mapping[str, Axis]) -> int:
    """Returns the number of cells of a grid, including excluded ones; 1 without axes."""
    return prod(len(axis.listed or ()) for axis in axes.values())


def kept_cells(axes: Mapping[str, Axis], excluded: Sequence[Mapping[str, Value]]) -> Sequence[int]:
    """Returns the numbers of the cells of a grid that are not excluded.

    The last axis changes from each cell to the next.

    Args:
        axes: Axes, each of which lists its values.
        excluded: Combinations of values of all axes or some; a cell with all values of one of them is left out.
    """
    if not excluded:
        return range(grid_size(axes))
    import numpy as np  # most requests exclude nothing

    listed = {name: list(axis.listed or ()) for name, axis in axes.items()}
    kept = np.ones([len(values) for values in listed.values()], np.bool_)
    for each in excluded:
        place = tuple(values.index(each[name]) if name in each else slice(None) for name, values in listed.items())
        kept[place] = False
    return np.flatnonzero(kept).tolist()


def grid_cell(axes: dict[str, Axis], number: int) -> dict[str, Value]:
    """Returns a cell (combination of axis values) of a grid by its number."""
    chosen: dict[str, Value] = {}
    for name, axis in reversed(axes.items()):
        listed = axis.listed or ()
        number, index = divmod(number, len(listed))
        chosen[name] = listed[index]
    return dict(reversed(chosen.items()))


def point(axes: Mapping[str, Axis], design: str, points: int, seed: int, number: int) -> dict[str, Value]:
    """Returns a point of a design that samples its points.

    Args:
        axes: The axes.
        design: `random`, `latin-hypercube` or `sobol`.
        points: Number of points.
        seed: Seed of the job, which determines all points.
        number: Number of the point, from 0.
    """
    shares = _shares(design, points, len(axes), seed)[number].tolist()
    return {name: axis.at(share) for (name, axis), share in zip(axes.items(), shares, strict=True)}


@lru_cache(maxsize=4)  # a job asks for one, point by point
def _shares(design: str, points: int, axes: int, seed: int) -> "NDArray[Any]":
    """Returns points in the unit cube, shape (points, axes)."""
    import numpy as np

    rng = np.random.default_rng([_STREAM, seed])
    if design == "random":
        return rng.random((points, axes))
    from scipy.stats import qmc  # pyright: ignore[reportMissingTypeStubs] - takes a second, which only jobs with such a design should pay

    if design == "latin-hypercube":
        return qmc.LatinHypercube(axes, rng=rng).random(points)
    # The sequence is balanced at powers of two; the first points of one are the points of a shorter one.
    return qmc.Sobol(axes, rng=rng).random_base2((points - 1).bit_length())[:points]
