"""Named arrays of an observation, as policies and `gymnasium` environments have them, and checked actions.

Names of nested observations are joined by `/`. Booleans become numbers 0 and 1 of type `int8`, and names are in
alphabetical order, as in the `Dict` spaces of `gymnasium`: one vector of all numbers is what
`gymnasium.wrappers.FlattenObservation` makes.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_env import specs
from numpy.typing import NDArray

from ..episode.context import RobotProgramError
from ..episode.loading import LoadError

ALONE = "observation"
"""Name of the observation if it is a single array."""

_KINDS = "biuf"
"""Kind codes of NumPy types that are numbers or booleans."""

_SHOWN = 80

Observed = dict[str, NDArray[Any]]


class NotFiniteError(RobotProgramError):
    """Raised when a policy's action contains infinite numbers or NaN."""


class ObservedArrays:
    """Converts observations of an environment to the arrays that a policy gets.

    Args:
        spec: Observation spec of the environment.
    """

    def __init__(self, spec: Any) -> None:
        found = dict(_leaves(spec))
        self.specs: dict[str, specs.Array] = {name: found[name] for name in sorted(found) if _is_numeric(found[name])}
        """dm_env specs of the arrays by name, in alphabetical order."""
        self.left_out = sorted(set(found) - set(self.specs))
        """Names of parts of the observation that are no numeric arrays, such as text."""
        self.size = sum(math.prod(each.shape) for each in self.specs.values())
        """Total number of values in all arrays."""

    def read(self, observation: Any) -> Observed:
        """Returns copies of the arrays of an observation, by name."""
        values = dict(_leaves(observation))
        return {name: _as_numbers(values[name], spec) for name, spec in self.specs.items()}

    def vector(self, observed: Observed) -> NDArray[Any]:
        """Returns all numbers of an observation, array after array, as one vector."""
        rows = [observed[name].reshape(-1) for name in self.specs]
        return np.concatenate(rows) if rows else np.zeros(0)

    def __str__(self) -> str:
        """Lists the names and sizes of the arrays: `pose 3, scan 360`."""
        return ", ".join(f"{name} {math.prod(each.shape)}" for name, each in self.specs.items()) or "nothing"


def number_type(spec: specs.Array) -> "np.dtype[Any]":
    """Returns the NumPy type of an array's numbers for a policy; booleans become `int8`."""
    return np.dtype(np.int8) if spec.dtype == np.bool_ else np.dtype(spec.dtype)


def _as_numbers(value: Any, spec: specs.Array) -> NDArray[Any]:
    return np.array(value, dtype=number_type(spec)).reshape(spec.shape)


def _leaves(value: Any, name: str = "") -> list[tuple[str, Any]]:
    if not isinstance(value, Mapping):
        return [(name or ALONE, value)]
    inside = ((f"{name}/{key}" if name else str(key), item) for key, item in value.items())
    return [leaf for key, item in inside for leaf in _leaves(item, key)]


def _is_numeric(spec: Any) -> bool:
    dtype = getattr(spec, "dtype", None)
    return dtype is not None and np.dtype(dtype).kind in _KINDS and hasattr(spec, "shape")


def single_action(spec: Any, policy: str) -> specs.Array:
    """Returns the action spec of an environment whose action is a single array.

    Raises:
        LoadError: The action of the environment is not a single array of numbers.
    """
    if isinstance(spec, specs.Array) and _is_numeric(spec):
        return spec
    raise LoadError(f"policy {policy}: the environment's action is not one array of numbers, and that is what it gives")


def checked_action(action: Any, spec: specs.Array, giver: str) -> NDArray[Any]:
    """Checks a policy's action, converts it to the environment's type, and returns it.

    Args:
        action: The action.
        spec: Action spec of the environment.
        giver: Source of the action, for messages, such as `policy walk.onnx`.

    Raises:
        RobotProgramError: The action does not fit the environment's action spec, or is not finite.
    """
    wanted = math.prod(spec.shape)
    try:
        found = np.asarray(action)
    except ValueError:  # lists of lists of different lengths
        found = np.asarray(None)
    if found.dtype.kind not in _KINDS or found.size != wanted:
        raise RobotProgramError(
            f"{giver} gave {_shown(action)}; an action has {wanted} {'number' if wanted == 1 else 'numbers'}"
            f"{_named(spec)}"
        )
    if not np.isfinite(found).all():
        raise NotFiniteError(f"{giver} gave {_shown(action)}, which is not finite")
    if np.dtype(spec.dtype).kind in "iu" and found.dtype.kind == "f":
        raise RobotProgramError(f"{giver} gave {_shown(action)}; an action has whole numbers{_named(spec)}")
    with np.errstate(over="ignore", invalid="ignore"):
        converted = found.astype(spec.dtype)
    if not fits(found, converted):
        raise RobotProgramError(
            f"{giver} gave {_shown(action)}; an action has numbers of type {spec.dtype}{_named(spec)}"
        )
    return converted.reshape(spec.shape)


def fits(numbers: NDArray[Any], converted: NDArray[Any]) -> bool:
    """Returns whether numbers kept their values in a conversion, apart from rounding: 300 becomes 44 in `int8`."""
    if converted.dtype.kind == "f":
        return bool((np.isfinite(converted) == np.isfinite(numbers)).all())
    return bool((converted == numbers).all())


def _named(spec: specs.Array) -> str:
    return f": {spec.name}" if spec.name else ""


def _shown(action: Any) -> str:
    return " ".join(repr(action).split())[:_SHOWN]
