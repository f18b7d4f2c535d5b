"""Encoding and decoding of the agent protocol's messages: observations, actions, greetings and errors.

The form of messages is specified in `docs/robot-programs.md` and shared with the client (`agent_client`).
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import dm_env
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from ....schemas.wire.base import Model
from ..episode.context import ActionError, ObservationError
from .agent_client import (
    ACTION_HEADER,
    HAS_DISCOUNT,
    HAS_REWARD,
    HEADER,
    OBSERVATION,
    OBSERVATION_HEADER,
    VERSION,
    ProtocolError,
)
from .agent_layout import ArrayField, Layout, Path

MAX_WORDS_BYTES = 64 * 1024
"""Maximum size in bytes of a robot program's JSON messages (greeting, error)."""

_SHOWN_CHARACTERS = 80


class RobotHello(Model):
    """First message of a robot program: protocol version, mode and speed."""

    version: int = Field(description="Version of the protocol that it speaks.")
    mode: Literal["lockstep", "free"] = Field(description="Whether the simulation waits for each action.")
    timeout_s: float = Field(
        default=30.0, gt=0, le=86400, description="Time to answer an observation; in free mode the first one."
    )
    real_time_factor: float = Field(
        default=1.0, gt=0, le=1000, description="Speed of free mode, in simulated seconds per second."
    )


class ObservationWriter:
    """Encodes observations as messages; the same buffer is used for every message."""

    def __init__(self, layout: Layout) -> None:
        self.message = bytearray(HEADER.size + layout.size)
        """Buffer with the last encoded message."""
        HEADER.pack_into(self.message, 0, layout.size, OBSERVATION)
        content = memoryview(self.message)[HEADER.size :]
        self._targets = [(field, field.path, field.view(content), field.shape) for field in layout.fields]

    def write(self, number: int, time_s: float, timestep: dm_env.TimeStep) -> None:
        """Encodes a dm_env time step as an observation message.

        Args:
            number: Number of the observation, from 0.
            time_s: Simulated time in seconds; NaN if unknown.
            timestep: Time step that the environment returned.

        Raises:
            ObservationError: The time step does not match the environment's specs.
        """
        reward, discount = timestep.reward, timestep.discount
        flags = (HAS_REWARD if reward is not None else 0) | (HAS_DISCOUNT if discount is not None else 0)
        try:
            OBSERVATION_HEADER.pack_into(
                self.message, HEADER.size, number, time_s, reward or 0.0, discount or 0.0, timestep.step_type, flags
            )
        except Exception as error:
            raise ObservationError(f"reward {reward!r} and discount {discount!r} have to be numbers") from error
        for field, path, target, shape in self._targets:
            value = timestep.observation
            try:
                for key in path:
                    value = value[key]
            except (LookupError, TypeError):
                raise ObservationError(f"the observation has no {field.where}, which its spec has") from None
            if type(value) is np.ndarray and value.shape == shape and value.dtype == field.dtype:
                target[...] = value  # the usual case, quickly
                continue
            if getattr(value, "shape", None) != shape:
                value = _with_shape(value, field)
            try:
                np.copyto(target, value, casting="same_kind")
            except TypeError as error:
                raise ObservationError(_misfit(value, field)) from error


def read_action(layout: Layout, payload: memoryview, expected: range) -> Any:
    """Decodes the robot's action from a message's content, and returns it in the form of the action spec.

    Args:
        layout: Layout of the action's arrays.
        payload: Content of the message.
        expected: Numbers of the observations that the action may answer.

    Raises:
        ActionError: The action has the wrong size, answers another observation, or is not finite.
    """
    if len(payload) != layout.size:
        raise ActionError(
            f"the action has {len(payload)} bytes; it has to have {layout.size}: "
            f"{ACTION_HEADER.size} for the observation's number, then {layout.summary()}"
        )
    (number,) = ACTION_HEADER.unpack_from(payload)
    if number not in expected:
        last = expected[-1]
        right = f"{last}" if len(expected) == 1 else f"{expected[0]} to {last}"
        raise ActionError(f"the action answers observation {number}; it has to answer {right}")
    data = bytearray(payload)
    values = [_value(field, data) for field in layout.fields]
    if len(values) == 1 and not layout.fields[0].path:
        return values[0]
    places = dict(zip((field.path for field in layout.fields), values, strict=True))
    return _rebuilt(layout.spec, (), places)


def _value(field: ArrayField, data: bytearray) -> Any:
    array = field.view(data)
    kind = field.dtype.kind
    if kind == "f" and not np.isfinite(array).all():
        raise ActionError(f"the action{_of(field)} is {_shortened(array)}; it has to be finite")
    if kind == "b" and (array.view(np.uint8) > 1).any():
        raise ActionError(f"the action{_of(field)} has bytes that are neither 0 nor 1; it is of type bool")
    return array if array.ndim else array[()]


def read_hello(payload: memoryview) -> RobotHello:
    """Decodes and returns a robot program's first message, its greeting.

    Raises:
        ProtocolError: The message is malformed or of another protocol version; the text says what would be right.
    """
    content = read_words(payload)
    if content.get("version") != VERSION:
        raise ProtocolError(f"the greeting has version {content.get('version')!r}; the simulation speaks {VERSION}")
    try:
        return RobotHello.model_validate(content)
    except ValidationError as error:
        problems = (f"{'.'.join(map(str, item['loc']))}: {item['msg']}" for item in error.errors())
        raise ProtocolError(f"the greeting is wrong: {'; '.join(problems)}") from error


def read_words(payload: memoryview) -> dict[str, Any]:
    """Decodes a message that is a JSON object, and returns the object.

    Raises:
        ProtocolError: The message is not a JSON object.
    """
    try:
        content = json.loads(bytes(payload))
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"a message is not JSON in UTF-8: {error}") from error
    if not isinstance(content, dict):
        raise ProtocolError("a message is JSON, but not an object")
    return content


def _with_shape(value: Any, field: ArrayField) -> NDArray[Any]:
    """Converts numbers or nested lists of an observation to an array of the expected shape.

    Raises `ObservationError` if that is not possible.
    """
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ObservationError(f"the observation{_of(field)} is no array: {error}") from error
    if array.shape != field.shape:
        raise ObservationError(_misfit(array, field))
    return array


def _misfit(value: Any, field: ArrayField) -> str:
    array = np.asarray(value)
    return (
        f"the observation{_of(field)} is {array.dtype}{list(array.shape)}; "
        f"its spec says {field.dtype.name}{list(field.shape)}"
    )


def _of(field: ArrayField) -> str:
    return f" {field.where}" if field.path else ""


def _shortened(array: NDArray[Any]) -> str:
    text = str(array.tolist())
    return text if len(text) <= _SHOWN_CHARACTERS else text[:_SHOWN_CHARACTERS] + "…"


def _rebuilt(spec: Any, path: Path, values: Mapping[Path, Any]) -> Any:
    """Arranges values in the nested form of a spec: dictionaries, lists and tuples.

    Args:
        spec: The spec, or a part of it.
        path: Path of that part.
        values: Values by their paths.
    """
    if isinstance(spec, Mapping):
        return {key: _rebuilt(item, (*path, key), values) for key, item in spec.items()}
    if isinstance(spec, Sequence) and not isinstance(spec, str | bytes):
        items = [_rebuilt(item, (*path, index), values) for index, item in enumerate(spec)]
        return tuple(items) if isinstance(spec, tuple) else items
    return values[path]
