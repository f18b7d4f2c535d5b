"""Trials: many episodes in one job, each with a seed of its own, in every combination of parameters.

A job's request orders them as its member `trials` or, for SDKs that do not know that member, as JSON in the launch
variable `ROBOMAKER_TRIALS`. Trials are numbered from 0. Each combination of parameters gets the same seeds, the job's
own and those after it; seeds change from trial to trial, then the parameter that is named last.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator

from ..wire.base import Model, Shape, ShapeName, optional
from ..wire.common import MAX_SEED
from ..wire.errors import InvalidParameterException
from ..wire.job_configs import (
    MAX_VARIABLE_CHARACTERS,
    EnvironmentVariableKey,
    EnvironmentVariableValue,
    JobRequest,
    given_once,
    is_program,
    launches,
)
from ..wire.json_values import is_list, is_mapping, load_strict
from ..wire.request_problems import parsed_member

TRIALS_VARIABLE = "ROBOMAKER_TRIALS"
"""The launch variable."""
MAX_TRIALS = 1_000_000
"""How many trials a job may have."""
MAX_PARAMETERS = 20
MAX_RECORDED = 1000
"""How many trials of a job may be recorded, each in a folder of its own."""
_OF_THE_JOB = (
    *("ROBOMAKER_REQUIREMENTS", TRIALS_VARIABLE, "ROBOMAKER_CHECKPOINT_EVERY_S", "ROBOMAKER_SEED"),
    *("ROBOMAKER_OUTPUT_DIR", "ROBOMAKER_DATA_DIR", "ROBOMAKER_WORLD_DIR", "ROBOMAKER_JOB_ROOT"),
)
"""Variables that say something about the whole job."""

TrialCount = Annotated[int, ShapeName("TrialCount"), Field(ge=1, le=MAX_TRIALS)]
TrialNumber = Annotated[int, ShapeName("TrialNumber"), Field(ge=0, lt=MAX_TRIALS)]
RecordedTrials = Annotated[int, ShapeName("RecordedTrials"), Field(ge=0, le=MAX_RECORDED)]
TrialNumbers = Annotated[list[TrialNumber], ShapeName("TrialNumbers"), Field(max_length=MAX_RECORDED)]


def _differ(values: list[str]) -> list[str]:
    if twice := sorted({value for value in values if values.count(value) > 1}):
        raise ValueError(f"values have to differ; {', '.join(map(repr, twice))} appears more than once")
    return values


def _possible(parameters: dict[str, list[str]]) -> dict[str, list[str]]:
    if reserved := sorted(name for name in parameters if name.startswith("AWS") or name in _OF_THE_JOB):
        raise ValueError(f"{', '.join(reserved)} cannot differ from trial to trial; give it for the whole job")
    if with_nul := sorted(name for name, values in parameters.items() if any("\0" in value for value in values)):
        raise ValueError(f"no variable can hold a NUL character; remove it from {', '.join(with_nul)}")
    return parameters


TrialValues = Annotated[
    list[EnvironmentVariableValue],
    ShapeName("TrialValues"),
    Field(min_length=1, max_length=1000),
    AfterValidator(_differ),
]
TrialParameters = Annotated[
    dict[EnvironmentVariableKey, TrialValues],
    ShapeName("TrialParameters"),
    Field(max_length=MAX_PARAMETERS),
    AfterValidator(_possible),
]


class Trials(Shape):
    """Trials of a simulation job: how often the episode is repeated, over which seeds and parameter values."""

    seeds: TrialCount = Field(
        description="How many trials there are of each combination of parameters: with the job's seed, 0 unless the "
        "request gives one, and with those after it."
    )
    parameters: TrialParameters | None = optional(
        "Values of environment variables, by name; there are trials of every combination. They take the "
        "place of launch variables of these names, of both applications."
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
    def _not_too_many(self) -> Self:
        if self.count > MAX_TRIALS:
            raise ValueError(
                f"{self.seeds} seeds for each of {self.combinations} combinations of parameters are {self.count} "
                f"trials; a job has at most {MAX_TRIALS}"
            )
        if missing := [number for number in self.record or () if number >= self.count]:
            raise ValueError(f"record: there is no trial {missing[0]}; the trials are 0 to {self.count - 1}")
        return self

    @property
    def combinations(self) -> int:
        """Number of combinations of parameter values; 1 without parameters."""
        return math.prod(len(values) for values in (self.parameters or {}).values())

    @property
    def count(self) -> int:
        """Number of trials: parameter combinations times repetitions."""
        return self.seeds * self.combinations

    def trial(self, number: int, first_seed: int) -> "Trial":
        """Returns the trial of a given number, with its seed and parameter values.

        Args:
            number: Its number, from 0.
            first_seed: The job's seed.

        Raises:
            IndexError: There is no such trial.
        """
        if not 0 <= number < self.count:
            raise IndexError(f"there is no trial {number}; the trials are 0 to {self.count - 1}")
        place, offset = divmod(number, self.seeds)
        chosen: dict[str, str] = {}
        for name, values in reversed((self.parameters or {}).items()):
            place, index = divmod(place, len(values))
            chosen[name] = values[index]
        # Seeds are a ring, so that the largest one may be followed too.
        return Trial(number, (first_seed + offset) % (MAX_SEED + 1), dict(reversed(chosen.items())))


@dataclass(frozen=True)
class TrialCounts:
    """Progress of the trials of some jobs: how many are done, of how many."""

    finished: int
    total: int


@dataclass(frozen=True)
class Trial:
    """One trial of a simulation job: its number, seed and parameter values."""

    number: int
    seed: int
    parameters: Mapping[str, str]
    """Environment variables of its own, besides those of all trials."""

    def __str__(self) -> str:
        parameters = "".join(f", {name}={value}" for name, value in self.parameters.items())
        return f"trial {self.number} (seed {self.seed}{parameters})"


class _Holder(Model):
    trials: Trials


def trials_of(request: JobRequest) -> Trials | None:
    """Returns the trials that a simulation job request orders; `None` if its job is a single episode.

    Raises:
        InvalidParameterException: the variable's text does not describe trials, or they are given twice and differ.
    """
    return given_once(request, "trials", TRIALS_VARIABLE, _parse)[1]


def planned_trials(request: Mapping[str, Any]) -> int:
    """Counts the trials that a raw request orders, 0 for a single episode; fast, as batches have many requests.

    Args:
        request: checked or not; what cannot be understood counts as no trials.
    """
    for given in (request.get("trials"), *_texts(request)):
        with suppress(ValidationError, InvalidParameterException):
            if isinstance(given, str):
                return _parse(load_strict(given, TRIALS_VARIABLE, MAX_VARIABLE_CHARACTERS), TRIALS_VARIABLE).count
            if given is not None:
                return Trials.model_validate(given).count
    return 0


def _texts(request: Mapping[str, Any]) -> Iterator[str]:
    """The values of the launch variable in a request that may be anything."""
    for member in ("simulationApplications", "robotApplications"):
        configs = request.get(member)
        for config in configs if is_list(configs) else []:
            launch = config.get("launchConfig") if is_mapping(config) else None
            variables = launch.get("environmentVariables") if is_mapping(launch) else None
            text = variables.get(TRIALS_VARIABLE) if is_mapping(variables) else None
            if isinstance(text, str):
                yield text


def check_trials(request: JobRequest) -> None:
    """Raises an error if a request's launch variable for trials is invalid, or an application is launched as a program.

    Raises:
        ValueError: it does not, or one is.
    """
    try:
        trials = trials_of(request)
    except InvalidParameterException as error:
        raise ValueError(str(error)) from None
    for place, launch in launches(request) if trials else ():
        member = "command" if launch.command else "launchFile"
        if is_program(launch):
            raise ValueError(
                f"trials: {place}.{member} launches a program, which cannot be begun anew for each trial; trials need "
                "applications that are factories (make_environment, make_agent), or a job for each seed"
            )


def _parse(data: object, place: str) -> Trials:
    return parsed_member(data, place, "trials", _Holder)
