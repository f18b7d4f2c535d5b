"""Trials: many episodes in one job, each with its own seed and axis values.

A job's request has them in its member `trials` or, for SDKs that do not know that member, as JSON in the launch
variable `ROBOMAKER_TRIALS`. Trials are numbered from 0. Each cell (combination of axis values) gets the same seeds: the
job's seed and those after it. The seed changes from trial to trial, then the cell.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, Self

from pydantic import Field, ValidationError, model_validator

from ..wire.base import Model, Shape, ShapeName, optional
from ..wire.common import MAX_SEED, raise_all
from ..wire.errors import InvalidParameterException
from ..wire.job_configs import MAX_VARIABLE_CHARACTERS, JobRequest, given_once, is_program, launches
from ..wire.json_values import is_list, is_mapping, load_strict
from ..wire.request_problems import nearest, parsed_member
from .axes import CellList, TrialAxes, value_text
from .axis_kinds.kind import Axis, Value
from .trial_designs import Cell, TrialDesign, grid_cell, grid_size, kept_cells, point, wrong_excluded

TRIALS_VARIABLE = "ROBOMAKER_TRIALS"
"""Name of the launch variable with trials as JSON."""
MAX_TRIALS = 1_000_000
"""Maximum number of trials of a job."""
MAX_RECORDED = 1000
"""Maximum number of recorded trials of a job, each with an output folder of its own."""

TrialCount = Annotated[int, ShapeName("TrialCount"), Field(ge=1, le=MAX_TRIALS)]
TrialNumber = Annotated[int, ShapeName("TrialNumber"), Field(ge=0, lt=MAX_TRIALS)]
RecordedTrials = Annotated[int, ShapeName("RecordedTrials"), Field(ge=0, le=MAX_RECORDED)]
TrialNumbers = Annotated[list[TrialNumber], ShapeName("TrialNumbers"), Field(max_length=MAX_RECORDED)]


class Trials(Shape):
    """Trials of a simulation job: how often the episode is repeated, over which seeds and values of axes."""

    seeds: TrialCount = Field(
        description="How many trials there are of each cell, that is of each combination of values of the axes: with "
        "the job's seed, 0 unless the request gives one, and with those after it."
    )
    axes: TrialAxes | None = optional(
        "Axes, along which cells differ, by name: an environment variable by its own name (`kind: variable`), or a "
        "number of robot, motors or sensors."
    )
    design: TrialDesign = Field(
        default="grid",
        description="How cells are chosen: `grid`: every combination of the values that all axes list; the others: as "
        "many as `points` says, `random`: by chance, `latin-hypercube`: with a value from each part of each axis, "
        "`sobol`: spread evenly over all axes.",
    )
    points: TrialCount | None = optional("How many cells there are, of a design that is no grid.")
    include: CellList | None = optional(
        "Cells beside those of the design: values by name of the axis. Axes that are left out are as built, or as the "
        "launch configuration says; `{}` is the cell without any change."
    )
    exclude: CellList | None = optional(
        "Cells that a grid does without: values by name of the axis, of all axes or of some."
    )
    record: TrialNumbers | None = optional(
        "Numbers of trials that are recorded, with a video if the job's policy is `always`, however they end."
    )
    record_failed: RecordedTrials = Field(
        default=10,
        description="How many of the trials that do not pass are recorded, the first ones, with a video if the job's "
        "policy is `on-failure` or `always`.",
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        raise_all([*self._wrong_design(), *self._wrong_cells()] or self._wrong_count())
        return self

    def _wrong_design(self) -> Iterator[str]:
        """Yields problems of a design: missing members, and members that it does not use."""
        if not self._axes:
            named = [name for name in ("include", "exclude") if getattr(self, name)]
            yield from (f"{name}: its cells are of axes, and there are none; give axes" for name in named)
        if self.design == "grid":
            for name, axis in self._axes.items():
                if axis.listed is None:
                    yield (
                        f"axes.{name}: a grid has values, and this is a range or a distribution; list `values`, or "
                        "choose a design such as sobol and how many points it has"
                    )
            if self.points is not None:
                yield "points: a grid has as many cells as its values make; leave it out, or give a design"
            return
        if not self._axes:
            yield f"design: {self.design} spreads points over axes, and there are none; give axes"
        if self.points is None:
            yield f"points is missing: a {self.design} design has as many cells as it says"
        if self.exclude:
            yield f"exclude: it leaves cells out of a grid, and a {self.design} design has none of its own"

    def _wrong_cells(self) -> Iterator[str]:
        """Yields problems of cells with unknown axes or values or that occur twice, and of too large grids."""
        if grid_size(self._axes) > MAX_TRIALS and self.design == "grid":
            cells = grid_size(self._axes)
            yield f"axes: a grid of them has {cells} cells; a job has at most {MAX_TRIALS} trials"
        if not self._axes:
            return
        included: list[Cell] = []
        for number, cell in enumerate(self.include or ()):
            parsed, wrong = self._parsed(cell, f"include[{number}]")
            yield from wrong
            if not wrong and parsed in included:
                yield f"include[{number}]: it is there twice; cells have to differ"
            included.append(parsed)
        are_listed = self.design == "grid" and all(axis.listed is not None for axis in self._axes.values())
        for number, cell in enumerate(self.exclude or ()):
            parsed, wrong = self._parsed(cell, f"exclude[{number}]")
            yield from wrong or (wrong_excluded(self._axes, parsed, f"exclude[{number}]") if are_listed else ())

    def _wrong_count(self) -> Iterator[str]:
        """Yields problems of grids without cells or with duplicate cells, and of wrong numbers of trials."""
        if self.exclude and not self._kept and not self.include:
            yield "exclude: it leaves no cell; exclude fewer, or include some"
            return
        for number, cell in enumerate(self._included if self.design == "grid" else ()):
            if self._has_cell(cell):
                yield f"include[{number}]: the grid has this cell already; leave it out"
        if self.count > MAX_TRIALS:
            yield (
                f"{self.seeds} seeds for each of {self.cells} cells are {self.count} trials; a job has at most "
                f"{MAX_TRIALS}"
            )
        for place, number in enumerate(self.record or ()):
            if number >= self.count:
                yield f"record[{place}]: there is no trial {number}; the trials are 0 to {self.count - 1}"

    def _has_cell(self, cell: Cell) -> bool:
        """Returns whether a grid of axis values contains a given cell."""
        listed = all(name in cell and cell[name] in (axis.listed or ()) for name, axis in self._axes.items())
        return listed and not any(excluded.items() <= cell.items() for excluded in self._excluded)

    @property
    def cells(self) -> int:
        """Number of cells (combinations of axis values); 1 without axes."""
        return self._drawn + len(self.include or ())

    @property
    def count(self) -> int:
        """Number of trials of the job: cells times seeds."""
        return self.seeds * self.cells

    @property
    def first_values(self) -> dict[str, Any]:
        """Axes of a grid as plain values, each with only the value of the first cell."""
        first = grid_cell(self._axes, self._kept[0] if self._kept else 0)
        return {name: {**axis.to_wire(), "values": [first[name]]} for name, axis in self._axes.items()}

    def trial(self, number: int, first_seed: int) -> "Trial":
        """Returns the trial of a given number, with its seed and the values of its axes.

        Args:
            number: Number of the trial, from 0.
            first_seed: Seed of the job.

        Raises:
            IndexError: The job has no trial of that number.
        """
        if not 0 <= number < self.count:
            raise IndexError(f"there is no trial {number}; the trials are 0 to {self.count - 1}")
        place, offset = divmod(number, self.seeds)
        # Seeds are a ring, so that the largest one may be followed too.
        return Trial(number, (first_seed + offset) % (MAX_SEED + 1), self._cell(place, first_seed))

    def _cell(self, place: int, seed: int) -> Cell:
        """Returns a cell (combination of axis values) by its number, from 0."""
        if place >= self._drawn:
            return self._included[place - self._drawn]
        if self.design == "grid":
            return grid_cell(self._axes, self._kept[place])
        return point(self._axes, self.design, self._drawn, seed, place)

    @property
    def _axes(self) -> dict[str, Axis]:
        return self.axes or {}

    @property
    def _drawn(self) -> int:
        """Number of cells without the explicitly included ones."""
        return len(self._kept) if self.points is None else self.points

    @cached_property
    def _kept(self) -> Sequence[int]:
        """Numbers of the cells of a grid that are not excluded."""
        return kept_cells(self._axes, self._excluded)

    @cached_property
    def _excluded(self) -> list[Cell]:
        return [self._parsed(cell, "")[0] for cell in self.exclude or ()]

    @cached_property
    def _included(self) -> list[Cell]:
        return [self._parsed(cell, "")[0] for cell in self.include or ()]

    def _parsed(self, cell: Mapping[str, str], place: str) -> tuple[Cell, list[str]]:
        """Converts the values of a cell in the request, and returns the problems of invalid ones with their paths."""
        parsed: dict[str, Value] = {}
        wrong: list[str] = []
        for name, text in cell.items():
            if name not in self._axes:
                hint = nearest(name, self._axes) or f"; there are {', '.join(self._axes) or 'none'}"
                wrong.append(f"{place}.{name}: there is no axis {name!r}{hint}")
                continue
            try:
                parsed[name] = self._axes[name].parse(text)
            except ValueError as error:
                wrong.append(f"{place}.{name}: {error}")
        return parsed, wrong


@dataclass(frozen=True)
class TrialCounts:
    """Progress of the trials of some jobs: how many are done, of how many."""

    finished: int
    total: int


@dataclass(frozen=True)
class Trial:
    """One trial of a simulation job: its number, its seed, and the values of its axes."""

    number: int
    seed: int
    axes: Cell = field(default_factory=dict[str, Value])
    """Values of axes by name; axes that are missing keep their default value."""

    @property
    def variables(self) -> dict[str, str]:
        """Environment variables of this trial, in addition to those of all trials."""
        return {name: value for name, value in self.axes.items() if isinstance(value, str)}

    def __str__(self) -> str:
        axes = "".join(f", {name}={value_text(value)}" for name, value in self.axes.items())
        return f"trial {self.number} (seed {self.seed}{axes})"


def number_axes(trials: Trials) -> dict[str, str]:
    """Returns the kind of each numeric axis, by axis name."""
    return {name: axis.kind for name, axis in (trials.axes or {}).items() if axis.is_number}


class _Holder(Model):
    trials: Trials


def trials_of(request: JobRequest) -> Trials | None:
    """Returns the trials that a simulation job request orders; `None` if its job is a single episode.

    Raises:
        InvalidParameterException: The variable's text does not describe trials, or they are given twice and differ.
    """
    return given_once(request, "trials", TRIALS_VARIABLE, _parse)[1]


def planned_trials(request: Mapping[str, Any]) -> int:
    """Counts the trials that a raw request orders, 0 for a single episode; fast, as batches have many requests.

    Args:
        request: Request, checked or not; invalid trials count as none.
    """
    for given in (request.get("trials"), *_texts(request)):
        with suppress(ValidationError, InvalidParameterException):
            if isinstance(given, str):
                return _parse(load_strict(given, TRIALS_VARIABLE, MAX_VARIABLE_CHARACTERS), TRIALS_VARIABLE).count
            if given is not None:
                return Trials.model_validate(given).count
    return 0


def _texts(request: Mapping[str, Any]) -> Iterator[str]:
    """Yields the values of the launch variable in an unchecked request."""
    for member in ("simulationApplications", "robotApplications"):
        configs = request.get(member)
        for config in configs if is_list(configs) else []:
            launch = config.get("launchConfig") if is_mapping(config) else None
            variables = launch.get("environmentVariables") if is_mapping(launch) else None
            text = variables.get(TRIALS_VARIABLE) if is_mapping(variables) else None
            if isinstance(text, str):
                yield text


def wrong_trials(request: JobRequest) -> Iterator[str]:
    """Yields problems of a request's launch variable for trials, and of programs, which cannot have trials.

    Args:
        request: Request whose member `trials` is valid.
    """
    try:
        trials = trials_of(request)
    except InvalidParameterException as error:
        yield from str(error).splitlines()
        return
    for place, launch in launches(request) if trials else ():
        member = "command" if launch.command else "launchFile"
        if is_program(launch):
            yield (
                f"trials: {place}.{member} launches a program, which cannot be begun anew for each trial; trials need "
                "applications that are factories (make_environment, make_agent), or a job for each seed"
            )


def _parse(data: object, place: str) -> Trials:
    return parsed_member(data, place, "trials", _Holder)
