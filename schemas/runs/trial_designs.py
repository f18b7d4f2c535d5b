"""Designs: which combinations of the values of axes the trials of a job, or the jobs of a step, have.

A grid has all combinations except excluded ones; other designs have a requested number of points. Explicitly included
cells come after all others. Where all axes list values, points may be more than combinations: a cell that is drawn
again has the next seeds, as a copy with the same cell and seed would count as evidence and is none.
"""

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import prod
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol

from ..wire.base import ShapeName
from ..wire.request_problems import nearest
from .axis_kinds.kind import Value

if TYPE_CHECKING:
    from numpy.typing import NDArray

TrialDesign = Annotated[Literal["grid", "random", "latin-hypercube", "sobol"], ShapeName("TrialDesign")]
"""Ways to choose cells: all combinations, random, random with every part of each axis covered, or evenly spread."""

Cell = Mapping[str, Value]
"""Values of axes by name; axes that are missing keep their default value."""


class CellAxis(Protocol):
    """Interface to an axis, as far as designs ask it for values."""

    @property
    def listed(self) -> Sequence[Value] | None:
        """Values of the axis; `None` if it has a range or a distribution."""
        ...

    def parse(self, text: Any) -> Value:
        """Returns the value that a cell of a request means.

        Raises:
            ValueError: It is no possible value.
        """
        ...

    def at(self, share: float) -> Value:
        """Returns the quantile of the axis's values at a probability, 0 to 1."""
        ...


@dataclass(frozen=True)
class Cells:
    """The cells that axes and a design make, each of which is run with so many seeds."""

    axes: Mapping[str, CellAxis]
    design: str
    points: int | None
    """Number of cells of a design that is no grid."""
    include: Sequence[Mapping[str, Any]]
    """Cells beside those of the design, with values as the request has them."""
    exclude: Sequence[Mapping[str, Any]]
    """Combinations of values that a grid does without."""
    seeds: int
    most: int
    """Limit on cells times seeds."""
    counted: str = "trials"
    """Noun in messages for what each cell and seed makes: `trials`, or `jobs` of a step."""
    holder: str = "a job"
    """Noun in messages for what has them, and a limit of them: `a job`, or `a step`."""

    def problems(self, wrong: Set[str] = frozenset()) -> list[str]:
        """Returns everything that is wrong, each after the path of its member.

        Args:
            wrong: Members that are wrong themselves, so that nothing is said that depends on them.
        """
        knows_design = self.axes and not wrong & {"design", "points"} if wrong else True
        found = [*(self._wrong_design() if knows_design else ()), *self._wrong_cells()]
        return found if found or wrong else [*self._wrong_count()]

    @property
    def count(self) -> int:
        """Number of cells that axes and a design make, those that are included with them."""
        return self._drawn + len(self.include)

    @property
    def first(self) -> dict[str, Value]:
        """The first cell of a grid: a value for each axis."""
        return grid_cell(self.axes, self._kept[0] if self._kept else 0)

    def cell(self, place: int, seed: int) -> Cell:
        """Returns the cell (a value for each axis) of a given number, from 0.

        Args:
            place: Its number.
            seed: The seed on which drawn points depend.
        """
        if place >= self._drawn:
            return self._included[place - self._drawn]
        if self.design == "grid":
            return grid_cell(self.axes, self._kept[place])
        if self._sizes:
            places: list[int] = _places(self.design, self._drawn, self._sizes, seed)[place].tolist()
            return {name: values[number] for (name, values), number in zip(self._listed.items(), places, strict=True)}
        return point(self.axes, self.design, self._drawn, seed, place)

    def repeats(self, place: int, seed: int) -> int:
        """Returns how many cells before a cell have the same values; its seeds come after theirs.

        Args:
            place: Number of the cell, from 0.
            seed: The seed on which drawn points depend.
        """
        if self.design == "grid" or not self._sizes:
            return 0  # cells of a grid differ, and so do points of ranges
        if place < self._drawn:
            return int(_repeats(self.design, self._drawn, self._sizes, seed)[place])
        included = self._included[place - self._drawn]
        if any(name not in included or included[name] not in values for name, values in self._listed.items()):
            return 0
        numbers = [values.index(included[name]) for name, values in self._listed.items()]
        return int((_places(self.design, self._drawn, self._sizes, seed) == numbers).all(axis=1).sum())

    @property
    def most_repeats(self) -> int:
        """Limit on `repeats`, whatever the seed is."""
        if self.design == "grid" or not self._sizes:
            return 0
        if self.design == "random" and prod(self._sizes) <= _MOST_NUMBERED:
            return -(-self._drawn // prod(self._sizes)) - (not self.include)
        return self.count - 1

    def _wrong_design(self) -> Iterator[str]:
        """Finds what a design needs and lacks, or has and cannot use."""
        if not self.axes:
            named = [name for name in ("include", "exclude") if getattr(self, name)]
            yield from (f"{name}: its cells are of axes, and there are none; give axes" for name in named)
        if self.design == "grid":
            for name, axis in self.axes.items():
                if axis.listed is None:
                    yield (
                        f"axes.{name}: a grid has values, and this is a range or a distribution; list `values`, or "
                        "choose a design such as sobol and how many points it has"
                    )
            if self.points is not None:
                yield "points: a grid has as many cells as its values make; leave it out, or give a design"
            return
        if not self.axes:
            yield f"design: {self.design} spreads points over axes, and there are none; give axes"
        if self.points is None:
            yield f"points is missing: a {self.design} design has as many cells as it says"
        if self.exclude:
            yield f"exclude: it leaves cells out of a grid, and a {self.design} design has none of its own"

    def _wrong_cells(self) -> Iterator[str]:
        """Finds cells that name what is not there, or are there twice, and grids that are too large."""
        if grid_size(self.axes) > self.most and self.design == "grid":
            cells = grid_size(self.axes)
            yield f"axes: a grid of them has {cells} cells; {self.holder} has at most {self.most} {self.counted}"
        if not self.axes:
            return
        included: list[Cell] = []
        for number, cell in enumerate(self.include):
            parsed, wrong = self._parsed(cell, f"include[{number}]")
            yield from wrong
            if not wrong and parsed in included:
                yield f"include[{number}]: it is there twice; cells have to differ"
            included.append(parsed)
        are_listed = self.design == "grid" and all(axis.listed is not None for axis in self.axes.values())
        for number, cell in enumerate(self.exclude):
            parsed, wrong = self._parsed(cell, f"exclude[{number}]")
            yield from wrong or (wrong_excluded(self.axes, parsed, f"exclude[{number}]") if are_listed else ())

    def _wrong_count(self) -> Iterator[str]:
        """Yields the problems of a grid that has no cell (a value for each axis), one twice, or too many trials."""
        if self.exclude and not self._kept and not self.include:
            yield "exclude: it leaves no cell; exclude fewer, or include some"
            return
        for number, cell in enumerate(self._included if self.design == "grid" else ()):
            if self._has_cell(cell):
                yield f"include[{number}]: the grid has this cell already; leave it out"
        if (found := self.seeds * self.count) > self.most:
            yield (
                f"{self.seeds} seeds for each of {self.count} cells are {found} {self.counted}; {self.holder} has at "
                f"most {self.most}"
            )

    def _has_cell(self, cell: Cell) -> bool:
        """Whether the grid has such a cell (a value for each axis): all values are listed, none excludes it."""
        listed = all(name in cell and cell[name] in (axis.listed or ()) for name, axis in self.axes.items())
        return listed and not any(excluded.items() <= cell.items() for excluded in self._excluded)

    @property
    def _drawn(self) -> int:
        """Number of cells of the grid or design, besides those that are included."""
        return len(self._kept) if self.points is None else self.points

    @cached_property
    def _listed(self) -> dict[str, Sequence[Value]]:
        """Values of all axes; empty if there are none, or one has a range or a distribution."""
        listed = {name: axis.listed or () for name, axis in self.axes.items()}
        return listed if all(listed.values()) else {}

    @cached_property
    def _sizes(self) -> tuple[int, ...]:
        return tuple(map(len, self._listed.values()))

    @cached_property
    def _kept(self) -> Sequence[int]:
        """Numbers of the cells of a grid that are not excluded."""
        return kept_cells(self.axes, self._excluded)

    @cached_property
    def _excluded(self) -> list[Cell]:
        return [self._parsed(cell, "")[0] for cell in self.exclude]

    @cached_property
    def _included(self) -> list[Cell]:
        return [self._parsed(cell, "")[0] for cell in self.include]

    def _parsed(self, cell: Mapping[str, Any], place: str) -> tuple[Cell, list[str]]:
        """Parses a cell of the request (a value for each axis); returns its values, and the problems of wrong ones."""
        parsed: dict[str, Value] = {}
        wrong: list[str] = []
        for name, given in cell.items():
            if name not in self.axes:
                hint = nearest(name, self.axes) or f"; there are {', '.join(self.axes) or 'none'}"
                wrong.append(f"{place}.{name}: there is no axis {name!r}{hint}")
                continue
            try:
                parsed[name] = self.axes[name].parse(given)
            except ValueError as error:
                wrong.append(f"{place}.{name}: {error}")
        return parsed, wrong


_MOST_NUMBERED = 2**62
"""Limit on the combinations that are drawn by their numbers: with more, a million points are never the same."""
_STREAM = 0x61786573  # "axes" in ASCII
"""Constant in the seed of designs, so that they differ from the random numbers of trials with the same seed."""


def wrong_excluded(axes: Mapping[str, CellAxis], excluded: Mapping[str, Value], place: str) -> Iterator[str]:
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


def grid_size(axes: Mapping[str, CellAxis]) -> int:
    """Returns the number of cells of a grid, including excluded ones; 1 without axes."""
    return prod(len(axis.listed or ()) for axis in axes.values())


def kept_cells(axes: Mapping[str, CellAxis], excluded: Sequence[Mapping[str, Value]]) -> Sequence[int]:
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


def grid_cell(axes: Mapping[str, CellAxis], number: int) -> dict[str, Value]:
    """Returns a cell (combination of axis values) of a grid by its number, from 0; the last axis varies fastest."""
    chosen: dict[str, Value] = {}
    for name, axis in reversed([*axes.items()]):
        listed = axis.listed or ()
        number, index = divmod(number, len(listed))
        chosen[name] = listed[index]
    return dict(reversed([*chosen.items()]))


def point(axes: Mapping[str, CellAxis], design: str, points: int, seed: int, number: int) -> dict[str, Value]:
    """Returns a point of a design that samples its points.

    Args:
        axes: The axes.
        design: `random`, `latin-hypercube` or `sobol`.
        points: Number of points.
        seed: The seed on which all of them depend, that of the job.
        number: Number of the point, from 0.
    """
    shares = _shares(design, points, len(axes), seed)[number].tolist()
    return {name: axis.at(share) for (name, axis), share in zip(axes.items(), shares, strict=True)}


@lru_cache(maxsize=4)
def _places(design: str, points: int, sizes: tuple[int, ...], seed: int) -> "NDArray[Any]":
    """Returns points of axes that list values, as numbers of these values; shape (points, axes).

    Points that are drawn by chance have each combination once before any comes again.
    """
    import numpy as np

    if design == "random" and prod(sizes) <= _MOST_NUMBERED:
        return np.stack(np.unravel_index(_drawn_cells(prod(sizes), points, seed), sizes), axis=1)
    return np.minimum((_shares(design, points, len(sizes), seed) * sizes).astype(np.int64), np.array(sizes) - 1)


def _drawn_cells(size: int, points: int, seed: int) -> "NDArray[Any]":
    """Draws numbers below a size, without replacement while any are left, then all of them again."""
    import numpy as np

    rng = np.random.default_rng([_STREAM, seed])
    if size <= 2 * points:
        return np.concatenate([rng.permutation(size) for _ in range(-(-points // size))])[:points]
    drawn = rng.integers(size, size=points)
    while len(first := np.unique(drawn, return_index=True)[1]) < points:  # at most half of them are there twice
        drawn = np.concatenate([drawn[np.sort(first)], rng.integers(size, size=points - len(first))])
    return drawn


@lru_cache(maxsize=4)
def _repeats(design: str, points: int, sizes: tuple[int, ...], seed: int) -> "NDArray[Any]":
    """Returns for each point how many points before it are the same; shape (points,)."""
    import numpy as np

    codes = np.zeros(points, np.int64)
    for column, size in zip(_places(design, points, sizes, seed).T, sizes, strict=True):
        codes = np.unique(codes * size + column, return_inverse=True)[1]  # small again, so that none overflows
    order = np.argsort(codes, kind="stable")
    begins = np.searchsorted(codes[order], codes[order])
    found = np.empty(points, np.int64)
    found[order] = np.arange(points) - begins
    return found


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
