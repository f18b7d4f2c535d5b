"""Sabotages: named axis values with which a challenge impairs a robot, to see whether requirements catch it."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import Field, ValidationError

from ..runs.axes import AXIS_KINDS, MAX_AXES, TrialAxes, number_kind, subject_of
from ..runs.axis_kinds.kind import Value
from ..runs.trials import Trials
from ..wire.base import Model
from ..wire.errors import ConfigurationError, Problem, SpecError
from ..wire.json_values import is_mapping
from ..wire.request_problems import RequestProblem, nearest, problems_of
from .yaml_nodes import Node, key_place, plain, value_place

MAX_SABOTAGES = 50
"""Maximum number of sabotages in a file: each is run with every job."""

_NAME = re.compile(r"[a-zA-Z0-9][a-zA-Z0-9 _.\-/+=:]{0,59}")
"""Pattern of names, which become tags of jobs; 60 characters fit into a line of a table."""
_VARIABLE = re.compile("[A-Z_][A-Z0-9_]*")


class Sabotage(Model):
    """One way to sabotage a robot: values of axes, by kind or by name of the environment variable."""

    name: str = Field(description="Its name for people.")
    axes: dict[str, Value] = Field(
        description="Values by kind of axis, `motor_delay_s`; texts by name of the environment variable."
    )

    @property
    def trial_axes(self) -> dict[str, dict[str, Any]]:
        """Axes of the sabotage in the form of a request, each with one value."""
        return {
            name: {"kind": name if name in AXIS_KINDS else "variable", "values": [value]}
            for name, value in self.axes.items()
        }


BUILT_IN = (
    Sabotage(name="idle", axes={"command_gain": 0.0}),
    Sabotage(name="blind", axes={"lidar_dropout": 1.0}),
    Sabotage(name="late by 0.2 s", axes={"motor_delay_s": 0.2}),
    Sabotage(name="late by 0.5 s", axes={"motor_delay_s": 0.5}),
    # Left and right motors in each other's sockets: it drives forward as before, and turns the other way.
    Sabotage(name="left and right swapped", axes={"turn_gain": -1.0}),
    Sabotage(name="a motor at half gain", axes={"first_motor_gain": 0.5}),
    Sabotage(name="noise ten times as large", axes={"lidar_noise_factor": 10.0}),
)
"""Sabotages that every challenge has."""


def distinct(sabotages: Sequence[Sabotage]) -> list[Sabotage]:
    """Returns sabotages unchanged after checking that their names are unique.

    Args:
        sabotages: Sabotages from all sources.

    Raises:
        ConfigurationError: Two have the same name.
    """
    names = [each.name for each in sabotages]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigurationError(f"--sabotages: the specification has a sabotage {twice[0]!r} too; rename one")
    return list(sabotages)


class _Holder(Model):
    axes: TrialAxes


def read_sabotages(data: object) -> tuple[list[Sabotage], list[RequestProblem]]:
    """Parses sabotages (faults put into a robot) from plain values, and returns the problems of invalid ones.

    Args:
        data: Axis values by name of the sabotage: `{slippery: {robot_friction: 0.2}}`.

    Returns:
        Valid sabotages, and problems located inside the data.
    """
    if not is_mapping(data) or not data:
        words = "sabotages are names with values of axes, such as slippery: {robot_friction: 0.2}"
        return [], [RequestProblem((), words)]
    if len(data) > MAX_SABOTAGES:
        return [], [RequestProblem((), f"has {len(data)} sabotages; at most {MAX_SABOTAGES} would be right")]
    found: list[Sabotage] = []
    problems: list[RequestProblem] = []
    for name, axes in data.items():
        wrong = [*_name_problems(str(name)), *_axes_problems(str(name), axes)]
        problems += wrong
        if not wrong and is_mapping(axes):
            found.append(Sabotage(name=str(name), axes={str(axis): _value(str(axis), axes[axis]) for axis in axes}))
    return found, problems


def parse_sabotages(node: Node) -> list[Sabotage]:
    """Parses the sabotages of a separate file.

    Args:
        node: Parsed file.

    Raises:
        SpecError: The file has problems; all are listed with their places.
    """
    found, problems = read_sabotages(plain(node))
    if problems:
        raise SpecError(
            [
                Problem((key_place if each.about_key else value_place)(node, each.location), each.path, each.message)
                for each in problems
            ]
        )
    return found


def _name_problems(name: str) -> Iterator[RequestProblem]:
    if not _NAME.fullmatch(name):
        words = (
            "a sabotage's name has 1 to 60 letters, digits, spaces and characters of _.-/+=:, and begins with a letter "
            "or digit"
        )
        yield RequestProblem((name,), words, about_key=True)
    if name in {each.name for each in BUILT_IN}:
        words = "every challenge has a sabotage of this name; choose another one"
        yield RequestProblem((name,), words, about_key=True)


def _axes_problems(name: str, axes: object) -> list[RequestProblem]:
    if not is_mapping(axes) or not 1 <= len(axes) <= MAX_AXES:
        words = f"is {axes!r}; values of 1 to {MAX_AXES} axes, such as {{robot_friction: 0.2}}, would be right"
        return [RequestProblem((name,), words)]
    problems = [each for axis, value in axes.items() for each in _axis_problems(name, str(axis), value)]
    if problems:
        return problems
    # Two axes may exclude each other, which is no fault of either alone.
    made = Sabotage.model_construct(name=name, axes=dict(axes))
    return [RequestProblem((name,), message) for message in _refusals(made)]


def _axis_problems(name: str, axis: str, value: object) -> list[RequestProblem]:
    """Returns the problems of one axis of a sabotage."""
    where = (name, axis)
    if axis not in _NUMBERS and not _VARIABLE.fullmatch(axis):
        hint = nearest(axis, _NUMBERS) or f"; there are {', '.join(_NUMBERS)} and environment variables"
        return [RequestProblem(where, f"there is no axis {axis!r}{hint}", about_key=True)]
    if isinstance(value, str) and "${{" in value:
        words = f"is {value!r}; sabotages have no references, so write the value itself"
        return [RequestProblem(where, words)]
    if axis in _NUMBERS and (isinstance(value, bool) or not isinstance(value, str | int | float)):
        return [RequestProblem(where, f"is {json.dumps(value, default=str)}; {axis} is {number_kind(axis).possible()}")]
    made = Sabotage.model_construct(name=name, axes={axis: value})
    return [RequestProblem(where, message) for message in _refusals(made)]


def _refusals(sabotage: Sabotage) -> list[str]:
    """Returns reasons why a request could not have the axes of a sabotage; empty if it could."""
    try:
        _Holder.model_validate({"axes": sabotage.trial_axes})
    except ValidationError as error:
        return [each.message for each in problems_of(error, _Holder)]
    return []


def _value(axis: str, value: Any) -> Value:
    return float(value) if axis in _NUMBERS else value


_NUMBERS = tuple(name for name, kind in AXIS_KINDS.items() if kind.is_number)


def challenged_trials(trials: Trials | None, seed: int, sabotage: Sabotage | None) -> dict[str, Any]:
    """Returns the only trial of a challenged job: the job's first, with or without a fault put into the robot.

    An axis of the job that changes the same quantity as the sabotage is removed.

    Args:
        trials: Trials in the job's request; None: a single episode.
        seed: Seed of the job.
        sabotage: Sabotage to apply; None: the job is of the control arm, with an unchanged robot.
    """
    kinds: dict[str, str] = {name: axis.kind for name, axis in (trials.axes or {}).items()} if trials else {}
    first: Mapping[str, Value] = trials.trial(0, seed).axes if trials else {}
    axes: dict[str, dict[str, Any]] = {name: {"kind": kinds[name], "values": [value]} for name, value in first.items()}
    if sabotage is not None:
        changed = {_subject(name, axis["kind"]) for name, axis in sabotage.trial_axes.items()}
        kept = {
            name: axis
            for name, axis in axes.items()
            if _subject(name, kinds[name]) not in changed and name not in sabotage.axes
        }
        axes = {**kept, **sabotage.trial_axes}
    # Nothing is recorded: each recording would run its trial once more.
    return {"seeds": 1, "record_failed": 0, **({"axes": axes} if axes else {})}


def _subject(name: str, kind: str) -> str:
    """Returns words for the quantity that an axis changes; each variable is a quantity of its own."""
    return subject_of(kind) if AXIS_KINDS[kind].is_number else name
