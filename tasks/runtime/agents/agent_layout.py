"""Layout of observations and actions in messages of the agent protocol (`docs/robot-programs.md`)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .agent_client import ITEM_FORMATS

_ALIGNMENT = 8
_MAX_CONTENT_BYTES = 2**30

Path = tuple[str | int, ...]


@dataclass(frozen=True)
class ArrayField:
    """Position, type and shape of one array in a message between simulation and robot program."""

    path: Path
    """Keys and indices that lead to the array in the spec; empty if the spec is a single array."""

    spec: Any
    """The environment's dm_env spec of the array; it has at least `shape` and `dtype`."""

    dtype: np.dtype
    """Little-endian type of the array's items."""

    offset: int
    """Position of the array's first byte in a message's content, in bytes."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the observation's or action's array."""
        return tuple(self.spec.shape)

    @property
    def where(self) -> str:
        """Path of the array in the observation or action as text, for error messages; empty if it is the whole."""
        return "/".join(map(str, self.path))

    def view(self, content: bytearray | memoryview) -> NDArray[Any]:
        """Returns the array in a message's content as a NumPy view, which shares the content's memory."""
        return np.ndarray(self.shape, self.dtype, content, self.offset)

    def describe(self) -> dict[str, Any]:
        """Returns the array's description for the handshake with the robot program, without absent bounds and texts."""
        description = {
            "path": list(self.path),
            "dtype": self.dtype.name,
            "shape": list(self.shape),
            "offset": self.offset,
        }
        for name in ("minimum", "maximum"):
            bound = _plain_bound(getattr(self.spec, name, None), self.shape)
            if bound is not None:
                description[name] = bound
        text = getattr(self.spec, "name", None)
        return {**description, "description": text} if isinstance(text, str) else description


class Layout:
    """Layout of an observation's or action's arrays in a message between simulation and robot program.

    Every array is little-endian, in C order, and begins at a multiple of eight bytes.
    """

    def __init__(self, spec: Any, header_bytes: int) -> None:
        """Computes the positions of the arrays of an observation's or action's spec in a message.

        Args:
            spec: A dm_env spec, or nested mappings and sequences of dm_env specs.
            header_bytes: Bytes of the header before the arrays.

        Raises:
            ValueError: A name is no text, or all of it is larger than 1 GiB.
        """
        self.fields: list[ArrayField] = []
        self.left_out: list[str] = []
        """Paths of parts of the spec without a fixed size, such as text, which are not sent."""
        offset = header_bytes
        for path, leaf in _leaves(spec):
            dtype = _item_type(leaf)
            if dtype is None:
                self.left_out.append("/".join(map(str, path)) or "all of it")
                continue
            field = ArrayField(path, leaf, dtype, offset)
            self.fields.append(field)
            offset += math.prod(field.shape) * dtype.itemsize
            offset += -offset % _ALIGNMENT
        if offset > _MAX_CONTENT_BYTES:
            raise ValueError(f"it has {offset} bytes; a message may have {_MAX_CONTENT_BYTES}")
        self.size = offset
        self.spec = spec
        """The environment's own dm_env spec."""

    def describe(self) -> dict[str, Any]:
        """Returns the layout's description for the handshake with the robot program."""
        return {"size": self.size, "arrays": [field.describe() for field in self.fields], "left_out": self.left_out}

    def summary(self) -> str:
        """Returns the layout as text: `float64[2]`, or `grip: bool[], wheels: float32[4]`."""
        shown = (
            (f"{field.where}: " if field.path else "") + f"{field.dtype.name}{list(field.shape)}"
            for field in self.fields
        )
        return ", ".join(shown) or "nothing"


def _leaves(spec: Any, path: Path = ()) -> list[tuple[Path, Any]]:
    if isinstance(spec, Mapping):
        for key in spec:
            if not isinstance(key, str):
                raise ValueError(f"{'/'.join(map(str, path)) or 'it'} has the key {key!r}; keys have to be text")
        return [leaf for key, item in spec.items() for leaf in _leaves(item, (*path, key))]
    if isinstance(spec, Sequence) and not isinstance(spec, str | bytes):
        return [leaf for index, item in enumerate(spec) for leaf in _leaves(item, (*path, index))]
    return [(path, spec)]


def _item_type(leaf: Any) -> np.dtype | None:
    """Returns the little-endian item type of a dm_env spec; None if the spec is no array that the protocol can send."""
    try:
        dtype = np.dtype(leaf.dtype)
        if not all(isinstance(length, int | np.integer) for length in leaf.shape):
            return None
    except (AttributeError, TypeError):
        return None
    return dtype.newbyteorder("<") if dtype.name in ITEM_FORMATS else None


def _plain_bound(bound: Any, shape: tuple[int, ...]) -> Any:
    """Converts a bound to JSON: one number if it is the same for all items, else a list, with null for no bound."""
    if bound is None or math.prod(shape) == 0:
        return None
    values = np.broadcast_to(np.asarray(bound), shape).reshape(-1)
    if (values == values[0]).all():
        values = values[:1]
    plain = [item if math.isfinite(item) else None for item in values.tolist()]
    return plain if len(plain) > 1 else plain[0]
