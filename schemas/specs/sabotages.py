"""Sabotages: what a challenge does to a robot to see whether requirements catch it; values of axes under a name."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import Field

from ..runs.axes import AXIS_KINDS, MAX_AXES, TrialAxes, subject_of
from ..runs.axis_kinds.kind import Value
from ..runs.trials import Trials
from ..wire.base import Model
from ..wire.errors import ConfigurationError, InvalidParameterException
from ..wire.json_values import is_mapping
from ..wire.request_problems import nearest, parsed_member

MAX_SABOTAGES = 50
"""Largest number of sabotages of a file: each is run with every job."""

_NAME = re.compile(r"[a-zA-Z0-9][a-zA-Z0-9 _.\-/+=:]{0,59}")
"""Names are tags of jobs, which have these characters; 60 of them fit into a line of a table."""
_VARIABLE = re.compile("[A-Z_][A-Z0-9_]*")


class Sabotage(Model):
    """One way to sabotage a robot: values of axes, by kind or by name of the environment variable."""

    name: str = Field(description="Its name for people.")
    axes: dict[str, Value] = Field(
        description="Values by kind of axis, `motor_delay_s`; texts by name of the environment variable."
    )

    @property
    def trial_axes(self) -> dict[str, dict[str, Any]]:
        """The axes as a request has them, each with its one value."""
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
"""Sabotages of every challenge."""


def distinct(sabotages: Sequence[Sabotage]) -> list[Sabotage]:
    """Returns some sabotages as they are.

    Args:
        sabotages: Those of all sources.

    Raises:
        ConfigurationError: Two have one name.
    """
    names = [each.name for each in sabotages]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigurationError(f"--sabotages: the specification has a sabotage {twice[0]!r} too; rename one")
    return list(sabotages)


class _Holder(Model):
    axes: TrialAxes


def parse_sabotages(data: object, where: str) -> list[Sabotage]:
    """Returns the sabotages that a file describes: names with values of axes.

    Args:
        data: The file's values: `{slippery: {robot_friction: 0.2}}`.
        where: The file, for messages.

    Raises:
        ConfigurationError: It does not describe sabotages.
    """
    if not is_mapping(data) or not data:
        raise ConfigurationError(
            f"{where}: sabotages are names with values of axes, such as slippery: {{robot_friction: 0.2}}"
        )
    if len(data) > MAX_SABOTAGES:
        raise ConfigurationError(f"{where} has {len(data)} sabotages; at most {MAX_SABOTAGES} would be right")
    return [_parsed(str(name), axes, f"{where}: {name}") for name, axes in data.items()]


def _parsed(name: str, axes: object, where: str) -> Sabotage:
    if not _NAME.fullmatch(name):
        raise ConfigurationError(
            f"{where}: a sabotage's name has 1 to 60 letters, digits, spaces and characters of _.-/+=:, and begins "
            "with a letter or digit"
        )
    if name in {each.name for each in BUILT_IN}:
        raise ConfigurationError(f"{where}: every challenge has a sabotage of this name; choose another one")
    if not is_mapping(axes) or not 1 <= len(axes) <= MAX_AXES:
        raise ConfigurationError(
            f"{where}: is {axes!r}; values of 1 to {MAX_AXES} axes, such as {{robot_friction: 0.2}}, would be right"
        )
    for axis in axes:
        if axis not in _NUMBERS and not _VARIABLE.fullmatch(str(axis)):
            hint = nearest(str(axis), _NUMBERS) or f"; there are {', '.join(_NUMBERS)} and environment variables"
            raise ConfigurationError(f"{where}: there is no axis {axis!r}{hint}")
    made = Sabotage.model_construct(name=name, axes=dict(axes))
    try:
        found: Mapping[str, Any] = parsed_member(made.trial_axes, where, "axes", _Holder)
    except InvalidParameterException as error:
        raise ConfigurationError(str(error).partition("\n")[0]) from None
    return Sabotage(name=name, axes={axis: each.listed[0] for axis, each in found.items()})


_NUMBERS = tuple(name for name, kind in AXIS_KINDS.items() if kind.is_number)


def challenged_trials(trials: Trials | None, seed: int, sabotage: Sabotage | None) -> dict[str, Any]:
    """Returns the trials of a job that a challenge runs: a single one, the job's first, sabotaged or not.

    An axis of the job that changes what the sabotage changes gives way to it.

    Args:
        trials: Those that the job's request orders; None: it is one episode.
        seed: The job's seed.
        sabotage: The sabotage; None: the robot is as it is, in the control arm.
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
    """Words for what an axis changes; each variable changes something else."""
    return subject_of(kind) if AXIS_KINDS[kind].is_number else name
