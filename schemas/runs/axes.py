"""Axes of trials: named quantities, besides the seed, that vary from trial to trial."""

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, TypeAlias, Union

from pydantic import AfterValidator, Field

from ..discovery import classes_of
from ..wire.base import Model, ShapeName
from ..wire.common import raise_all, text
from ..wire.json_values import is_mapping
from . import axis_kinds
from .axis_kinds.kind import Axis, AxisValue, NumberAxis, Value

MAX_AXES = 20
AS_BUILT = "as built"
"""Text for an axis, or all axes, for which a cell has no value."""
AXIS_KINDS: Mapping[str, type[Axis]] = classes_of(Axis, axis_kinds.__name__, "axes", Axis.names)
"""Kinds of axes by name."""

if TYPE_CHECKING:
    TrialAxis: TypeAlias = Axis
    """One axis; `kind` says which."""
else:
    _ANY = Union[tuple(AXIS_KINDS.values())]  # noqa: UP007 - the kinds are known at run time only
    TrialAxis = Annotated[_ANY, ShapeName("TrialAxis"), Field(discriminator="kind")]

_OF_THE_JOB = (
    *("ROBOMAKER_REQUIREMENTS", "ROBOMAKER_TRIALS", "ROBOMAKER_CHECKPOINT_EVERY_S", "ROBOMAKER_SEED"),
    *("ROBOMAKER_SECRETS", "ROBOMAKER_SIMULATION_JOB_ID", "ROBOMAKER_RECORD_CAMERA", "ROBOMAKER_VIDEO_FPS"),
    *("PYTHONHASHSEED", "MUJOCO_GL"),
    *("ROBOMAKER_OUTPUT_DIR", "ROBOMAKER_DATA_DIR", "ROBOMAKER_WORLD_DIR", "ROBOMAKER_JOB_ROOT"),
)
"""Names of launch variables that configure the whole job, so that axes cannot vary them."""
_VARIABLE = re.compile("[A-Z_][A-Z0-9_]*")
_NUMBER = re.compile("[a-z][a-z0-9_]*")


def _well_named(axes: dict[str, Axis]) -> dict[str, Axis]:
    """Raises ValueError for invalid axis names, and for two axes that change the same quantity; else returns the axes.

    Axes of variables and of numbers have names of different forms, so that a column in a table of several jobs has one
    type.
    """
    raise_all(_wrong_names(axes))
    return axes


def _wrong_names(axes: Mapping[str, Axis]) -> Iterator[str]:
    of_subject: dict[str, str] = {}
    for name, axis in axes.items():
        if not axis.is_number:
            if not _VARIABLE.fullmatch(name):
                yield (
                    f"{name}: it is named after an environment variable, of capital letters, digits and _; "
                    f"{name.upper()!r} would be one"
                )
            if name.startswith("AWS") or name in _OF_THE_JOB:
                yield f"{name} cannot differ from trial to trial; give it for the whole job"
        elif not _NUMBER.fullmatch(name):
            yield (
                f"{name}: an axis of kind {axis.kind} is named with small letters, digits and _; capital letters are "
                f"for environment variables, kind: variable"
            )
        elif (other := of_subject.setdefault(subject_of(axis.kind), name)) != name:
            if axis.kind == axes[other].kind:
                yield f"{name} and {other} are both of kind {axis.kind}, of which a job has one axis"
            else:
                yield (
                    f"{name} ({axis.kind}) and {other} ({axes[other].kind}) both change the {subject_of(axis.kind)}; "
                    "leave one out"
                )


AxisName = Annotated[str, ShapeName("AxisName"), text(1, 64, r"[a-zA-Z_][a-zA-Z0-9_]*")]
TrialAxes = Annotated[
    dict[AxisName, TrialAxis],
    ShapeName("TrialAxes"),
    Field(min_length=1, max_length=MAX_AXES),
    AfterValidator(_well_named),
]
CellValues = Annotated[dict[AxisName, AxisValue], ShapeName("CellValues"), Field(max_length=MAX_AXES)]
"""Values of axes, by axis name."""
CellList = Annotated[list[CellValues], ShapeName("CellList"), Field(min_length=1, max_length=1000)]


class AxisSetting(Model):
    """Value of an axis that a single run has: the kind of axis, and the number."""

    kind: str = Field(description="Kind of the axis, `robot_mass`.")
    value: float = Field(description="Value of the axis, in the unit of its kind.")


def number_kind(kind: str) -> type[NumberAxis]:
    """Returns the class of a numeric kind of axis, by name.

    There must be a kind of this name, and it must be numeric.
    """
    found = AXIS_KINDS[kind]
    assert issubclass(found, NumberAxis)
    return found


def subject_of(kind: str) -> str:
    """Returns words for the quantity that a kind of axis changes; a job can have only one kind with the same words."""
    found = AXIS_KINDS[kind]
    return (found.subject if issubclass(found, NumberAxis) else "") or kind


def value_text(value: Value) -> str:
    """Formats a value of an axis for people: a number with six digits at most, `0.333333`; a text as it is."""
    return value if isinstance(value, str) else f"{value:.6g}"


_MOST_NAMED_AXES = 4
_LONGEST_NAMED_VALUE = 24


def trial_in_words(number: int, values: Mapping[str, Value]) -> str:
    """Names a trial by the values of its axes: `friction 0.4, mass 2.1 (trial 17)`; without axes `trial 17`.

    Args:
        number: Number of the trial.
        values: Values of its axes by name; numbers are rounded to three digits, long texts and lists are cut.
    """
    named = [f"{name} {_briefly(value)}" for name, value in list(values.items())[:_MOST_NAMED_AXES]]
    named += [f"{len(values) - _MOST_NAMED_AXES} more"] if len(values) > _MOST_NAMED_AXES else []
    return f"{', '.join(named)} (trial {number})" if named else f"trial {number}"


def _briefly(value: Value) -> str:
    if not isinstance(value, str):
        return f"{value:.3g}"
    return value if len(value) <= _LONGEST_NAMED_VALUE else f"{value[: _LONGEST_NAMED_VALUE - 1]}…"


AXIS_TAG = "robomaker:axis:"
"""Beginning of the tags of a job that say its cell, of the axes of its step; the name of the axis follows."""
_TAG_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?(e[-+]?[0-9]+)?")
_ALLOWED = re.compile(r"[^a-zA-Z0-9 _.\-/+:]")
_ESCAPED = re.compile(r"(?:=[0-9A-F]{2})+")


def tag_value(value: Value) -> str:
    """Returns the tag that says a value of an axis: a number as it is, a text with `=2C` for a comma.

    Of a text that could be read as a number, such as `0.5` of a variable, the first digit is written so, too (`=30.5`):
    tags have no types, and variables are texts, which are other values than numbers.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    text = _ALLOWED.sub(lambda found: "".join(f"={byte:02X}" for byte in found[0].encode()), value)
    return f"={ord(text[0]):02X}{text[1:]}" if _TAG_NUMBER.fullmatch(text) else text


def cell_in_tags(tags: object) -> dict[str, Value]:
    """Returns the cell (a value for each axis) that a job's tags say; empty for a job without axes.

    Args:
        tags: The tags of a request, if it has any.
    """
    found = tags.items() if is_mapping(tags) else ()
    return {
        str(name).removeprefix(AXIS_TAG): _said(str(text)) for name, text in found if str(name).startswith(AXIS_TAG)
    }


def tag_in_words(name: str, value: str) -> str:
    """Formats a tag for people: an axis as `stop = 0.5`, any other one as `team=red`."""
    if not name.startswith(AXIS_TAG):
        return f"{name}={value}"
    return f"{name.removeprefix(AXIS_TAG)} = {value_text(_said(value))}"


def _said(text: str) -> Value:
    if _TAG_NUMBER.fullmatch(text):
        return float(text)
    return _ESCAPED.sub(lambda found: bytes.fromhex(found[0].replace("=", "")).decode(errors="replace"), text)
