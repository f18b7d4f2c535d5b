"""Policies in ONNX files, run by onnxruntime on one thread, so that runs are bit-identical."""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from dm_env import specs
from numpy.typing import NDArray

from ....schemas.extras import how_to_install
from ..episode.context import RobotProgramError
from ..episode.loading import LoadError
from .arrays import Observed, ObservedArrays, fits

_ACTION_NAMES = ("action", "actions")
_TYPES: Mapping[str, type] = {
    "tensor(float16)": np.float16,
    "tensor(float)": np.float32,
    "tensor(double)": np.float64,
    "tensor(int8)": np.int8,
    "tensor(int32)": np.int32,
    "tensor(int64)": np.int64,
    "tensor(uint8)": np.uint8,
    "tensor(bool)": np.bool_,
}
"""NumPy types by the type names of onnxruntime."""

_MAX_WORDS = 200


@dataclass(frozen=True)
class _Input:
    """An input of the network, and the observation arrays that are fed into it."""

    name: str
    dtype: type
    shape: tuple[int, ...]
    """Shape of the fed array, with a batch size of one if the network has batches."""
    read: Callable[[Observed], NDArray[Any]]


class OnnxPolicy:
    """Policy of an ONNX neural network, called with the arrays of an observation.

    An input with the name of an array gets that array; a network whose only input has another name gets all numbers as
    one vector. The action is the output `action`, or the only output.

    Args:
        path: Path of the ONNX file.
        policy: Policy as the specification names it, for messages.
        arrays: Arrays of the observation.
        action: Spec of the action.

    Raises:
        LoadError: Onnxruntime is missing, the file is no network, or it does not fit the environment.
    """

    def __init__(self, path: Path, policy: str, arrays: ObservedArrays, action: specs.Array) -> None:
        self._policy = policy
        self._session = _session(path, policy)
        self._inputs = [self._input(each, arrays) for each in self._session.get_inputs()]
        self._output = self._action_output(action)

    def __call__(self, observed: Observed) -> NDArray[Any]:
        """Runs the network on an observation, and returns the action.

        Raises `RobotProgramError` if it cannot be computed.
        """
        feed = {each.name: self._fed(each, each.read(observed)) for each in self._inputs}
        try:
            return np.asarray(self._session.run([self._output], feed)[0])
        except Exception as error:  # onnxruntime's exceptions have no common class but this
            raise RobotProgramError(f"policy {self._policy} cannot be computed: {_error_in_words(error)}") from None

    def _fed(self, into: _Input, numbers: NDArray[Any]) -> NDArray[Any]:
        with np.errstate(over="ignore"):
            converted = np.ascontiguousarray(numbers.reshape(into.shape).astype(into.dtype))
        if not fits(numbers.reshape(into.shape), converted):
            raise RobotProgramError(
                f"policy {self._policy}: its input {into.name!r} has type {np.dtype(into.dtype)}, which cannot hold "
                f"what was observed, up to {np.max(np.abs(numbers[np.isfinite(numbers)].astype(float))):g}"
            )
        return converted

    def state(self) -> dict[str, Any]:
        """Returns an empty state: a network has no memory between steps, so a killed run can be continued."""
        return {}

    def restore(self, state: dict[str, Any]) -> None:
        """Does nothing: the network has no state."""

    def _input(self, found: Any, arrays: ObservedArrays) -> _Input:
        dtype = _TYPES.get(found.type)
        if dtype is None:
            raise self._unfit(f"its input {found.name!r} is {found.type}; {', '.join(_TYPES)} can be fed")
        spec = arrays.specs.get(found.name)
        if spec is not None:
            kinds = "f" if np.dtype(spec.dtype).kind == "f" else "biuf"
            if np.dtype(dtype).kind not in kinds:
                raise self._unfit(f"its input {found.name!r} is {found.type}, and the observation has {spec.dtype}")
            shape = _fed_shape(found.shape, tuple(spec.shape))
            if shape is None:
                raise self._unfit(
                    f"its input {found.name!r} has shape {_shape(found.shape)}, and the observation has "
                    f"{list(spec.shape)}"
                )
            return _Input(found.name, dtype, shape, lambda observed: observed[found.name])
        if len(self._session.get_inputs()) > 1:
            names = ", ".join(repr(each.name) for each in self._session.get_inputs())
            raise self._unfit(f"its inputs are {names}, and {found.name!r} is none of the observation's: {arrays}")
        if np.dtype(dtype).kind != "f":
            raise self._unfit(f"its input {found.name!r} is {found.type}; all numbers in a row need tensor(float)")
        shape = _fed_shape(found.shape, (arrays.size,))
        if shape is None:
            raise self._unfit(
                f"its input {found.name!r} has shape {_shape(found.shape)}, and the observation has {arrays.size} "
                f"numbers: {arrays}"
            )
        return _Input(found.name, dtype, shape, arrays.vector)

    def _action_output(self, action: specs.Array) -> str:
        outputs = self._session.get_outputs()
        named = [each for each in outputs if each.name in _ACTION_NAMES] or outputs
        if len(named) != 1:
            names = ", ".join(repr(each.name) for each in outputs)
            raise self._unfit(f"its outputs are {names}; name the one that is the action 'action'")
        (output,) = named
        kind = np.dtype(_TYPES[output.type]).kind if output.type in _TYPES else "?"
        if kind not in ("iu" if np.dtype(action.dtype).kind in "iu" else "f"):
            raise self._unfit(f"its output {output.name!r} is {output.type}, and an action has {action.dtype}")
        if _fed_shape(output.shape, tuple(action.shape)) is None:
            raise self._unfit(
                f"its output {output.name!r} has shape {_shape(output.shape)}, and an action has "
                f"{math.prod(action.shape)} numbers: {action.name}"
            )
        return output.name

    def _unfit(self, why: str) -> LoadError:
        return LoadError(f"policy {self._policy} does not fit the environment: {why}")


def _session(path: Path, policy: str) -> Any:
    # Else its wheels send what they are used for to their makers, from the moment of the import on.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    try:
        import onnxruntime
    except ImportError as error:
        raise LoadError(
            f"policy {policy} needs onnxruntime, which cannot be imported here ({error}); {how_to_install('onnx')}"
        ) from None
    options = onnxruntime.SessionOptions()
    # Sums over several threads are added in the order in which these end, so that a run would not repeat to the bit.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = 3  # errors: its warnings are about the machine's devices
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions have no common class but this
        raise LoadError(f"policy {policy} is no network that onnxruntime can read: {_error_in_words(error)}") from None


def _fed_shape(declared: list[Any], needed: tuple[int, ...]) -> tuple[int, ...] | None:
    """Returns the shape to feed to a network input, with or without a batch of one; None if it does not fit.

    Dimensions with a name, or without a size, may have any length. A network may also leave the whole shape open, which
    onnxruntime reports as no dimensions.
    """
    if not declared:
        return (1, *needed) if needed else ()
    for shape in ((1, *needed), needed):
        if len(declared) == len(shape) and all(
            not isinstance(wanted, int) or wanted == length for wanted, length in zip(declared, shape, strict=True)
        ):
            return shape
    return None


def _shape(declared: list[Any]) -> str:
    return f"[{', '.join('any' if not isinstance(each, int) else str(each) for each in declared)}]"


def _error_in_words(error: Exception) -> str:
    """Returns the first line of an error of onnxruntime, without its code."""
    said = str(error).strip().splitlines() or [type(error).__name__]
    return said[0].rpartition(" : ")[2][:_MAX_WORDS]
