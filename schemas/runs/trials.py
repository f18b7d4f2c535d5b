"""Trials: many episodes in one job, each with its own seed and axis values.

A job's request has them in its member `trials` or, for SDKs that do not know that member, as JSON in the launch
variable `ROBOMAKER_TRIALS`. Trials are numbered from 0. Each cell (combination of axis values) gets the same seeds: the
job's seed and those after it; a cell that a design draws again gets the next ones. The seed changes from trial to
trial, then the cell.
"""

from collections.abc import Iterator, Mapping
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
from ..wire.request_problems import parsed_member
from .axes import CellList, TrialAxes, value_text
from .axis_kinds.kind import Value
from .trial_designs import Cell, Cells, TrialDesign

TRIALS_VARIABLE = "ROBOMAKER_TRIALS"
"""Name of the launch variable with trials as JSON."""
OF_ALL_TRIALS = "trials"
"""Requirement of a job with trials: that all of them pass."""
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
        default=1,
        description="How many trials there are of each cell, that is of each combination of values of the axes: with "
        "the job's seed, 0 unless the request gives one, and with those after it. A cell that a design has again gets "
        "the next ones.",
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
        raise_all(self._cells.problems() or self._wrong_records())
        return self

    def _wrong_records(self) -> Iterator[str]:
        for place, number in enumerate(self.record or ()):
            if number >= self.count:
                yield f"record[{place}]: there is no trial {number}; the trials are 0 to {self.count - 1}"

    @property
    def cells(self) -> int:
        """Number of cells (combinations of axis values); 1 without axes."""
        return self._cells.count

    @property
    def count(self) -> int:
        """Number of trials of the job: cells times seeds."""
        return self.seeds * self.cells

    @property
    def first_values(self) -> dict[str, Any]:
        """Axes of a grid as plain values, each with only the value of the first cell."""
        first = self._cells.first
        return {name: {**axis.to_wire(), "values": [first[name]]} for name, axis in (self.axes or {}).items()}

    @property
    def seeds_taken(self) -> int:
        """Number of seeds from the job's seed on that its trials have at most."""
        return self.seeds * (1 + self._cells.most_repeats)

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
        offset += self.seeds * self._cells.repeats(place, first_seed)
        # Seeds are a ring, so that the largest one may be followed too.
        return Trial(number, (first_seed + offset) % (MAX_SEED + 1), self._cells.cell(place, first_seed))

    @cached_property
    def _cells(self) -> Cells:
        return Cells(
            axes=self.axes or {},
            design=self.design,
            points=self.points,
            include=self.include or (),
            exclude=self.exclude or (),
            seeds=self.seeds,
            most=MAX_TRIALS,
        )


class TrialRecordings(Model):
    """Progress of a job that runs some of its trials again to record them."""

    finished: int = Field(description="Number of trials that are recorded.")
    total: int = Field(description="Number of trials to record.")
    trial: int = Field(description="Number of the trial that is being recorded, or was recorded last.")
    filmed: bool = Field(description="Whether a video of it is made.")

    def in_words(self, job: str) -> str:
        """Says what is recorded now: `records a video of trial 3 of job sim-1`; empty if all are recorded."""
        if self.finished >= self.total:
            return ""
        return f"records {'a video of ' if self.filmed else ''}trial {self.trial} of job {job}"


@dataclass(frozen=True)
class TrialCounts:
    """Progress of the trials of some jobs: how many are done, of how many, and how many are recorded again."""

    finished: int
    total: int
    recorded: int = 0
    to_record: int = 0
    """Number of trials to record, of the jobs that have begun to."""

    recording: str = ""
    """Text on the recording that goes on, `records a video of trial 3 of job sim-1`; empty: none does."""

    @property
    def work(self) -> tuple[int, int]:
        """Finished and total work: trials, and those that are run again to be recorded."""
        return self.finished + self.recorded, self.total + self.to_record


def trial_counts(finished: int, total: int, recordings: Mapping[str, TrialRecordings]) -> TrialCounts:
    """Sums up the trials of some jobs.

    Args:
        finished: Number of finished trials.
        total: Number of all trials.
        recordings: Progress of recording trials again, by id of the job; jobs that do not record are absent.
    """
    going = [words for job, each in recordings.items() if (words := each.in_words(job))]
    more = f" and {len(going) - 1} more" if len(going) > 1 else ""
    recorded, to_record = (sum(getattr(each, name) for each in recordings.values()) for name in ("finished", "total"))
    return TrialCounts(finished, total, recorded, to_record, f"{going[0]}{more}" if going else "")


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
    found = trials_in(request)
    return found.count if found else 0


def trials_seeds(request: Mapping[str, Any]) -> int:
    """Counts the seeds that the trials of a raw request take, 1 for a single episode; see `planned_trials`."""
    found = trials_in(request)
    return found.seeds_taken if found else 1


def trials_in(request: Mapping[str, Any]) -> Trials | None:
    """Returns the trials that a raw request orders; `None` for a single episode.

    Args:
        request: Request, checked or not; invalid trials count as none.
    """
    for given in (request.get("trials"), *_texts(request)):
        with suppress(ValidationError, InvalidParameterException):
            if isinstance(given, str):
                return _parse(load_strict(given, TRIALS_VARIABLE, MAX_VARIABLE_CHARACTERS), TRIALS_VARIABLE)
            if given is not None:
                return Trials.model_validate(given)
    return None


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
    """Yields problems of a request's launch variable for trials, and of programs, which cannot have several.

    A simulation that is a program has none at all, as no axis reaches it.

    Args:
        request: Request whose member `trials` is valid.
    """
    try:
        trials = trials_of(request)
    except InvalidParameterException as error:
        yield from str(error).splitlines()
        return
    if trials is None:
        return
    for place, launch in launches(request):
        member = "command" if launch.command else "launchFile"
        if is_program(launch) and not (trials.count == 1 and place.startswith("robotApplications")):
            yield (
                f"trials: {place}.{member} launches a program, which cannot be begun anew for each trial; trials need "
                "applications that are factories (make_environment, make_agent), or a job for each seed"
            )


def _parse(data: object, place: str) -> Trials:
    return parsed_member(data, place, "trials", _Holder)
