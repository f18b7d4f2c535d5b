"""Prims of USD as text: what a stage is written with, without USD's own library."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .export_scene import Matrix

_DIGITS = 6


@dataclass(slots=True)
class Prim:
    """One prim with its attributes and children, as lines of a `.usda` file."""

    kind: str
    """`Xform`, `Cube`, …"""
    name: str
    """A name that USD takes, see `prim_name`."""
    schemas: list[str] = field(default_factory=list)
    """API schemas that are applied to it."""
    metadata: list[str] = field(default_factory=list)
    attributes: list[str] = field(default_factory=list)
    """Lines such as `double size = 2`."""
    children: list["Prim"] = field(default_factory=list)

    def set(self, kind: str, name: str, value: str) -> None:
        """Adds an attribute."""
        self.attributes.append(f"{kind} {name} = {value}")

    def lines(self, indent: str = "") -> list[str]:
        """The prim and what is in it."""
        head = list(self.metadata)
        if self.schemas:
            head.insert(0, f"prepend apiSchemas = [{', '.join(map(quoted, self.schemas))}]")
        inner = indent + "    "
        made = [f'{indent}def {self.kind} "{self.name}"' + (" (" if head else "")]
        if head:
            made += [*(inner + line for line in head), f"{indent})"]
        made += [f"{indent}{{", *(inner + line for line in self.attributes)]
        for child in self.children:
            made += child.lines(inner)
        return [*made, f"{indent}}}"]


class PrimNames:
    """Names of prims below one parent, each given once."""

    def __init__(self) -> None:
        self._given: set[str] = set()

    def take(self, text: str) -> str:
        """A name for something: letters, digits and underscores, and not yet given."""
        first = name = prim_name(text)
        number = 1
        while name in self._given:
            number += 1
            name = f"{first}_{number}"
        self._given.add(name)
        return name


def prim_name(text: str) -> str:
    """The text as USD names prims: letters, digits and underscores, no digit first."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return name if name and not name[0].isdigit() else f"_{name}"


def quoted(text: str) -> str:
    """A string or token."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def number(value: float) -> str:
    """One number."""
    return f"{round(float(value), _DIGITS) + 0.0:.10g}"


def numbers(values: Iterable[float]) -> str:
    """A vector."""
    return f"({', '.join(map(number, values))})"


def vectors(rows: NDArray[np.float64], *, times: int = 1) -> str:
    """An array of vectors; formatted at once, since meshes have a hundred thousand numbers.

    Args:
        rows: shape (vectors, components).
        times: how often each vector stands there, one after the other.
    """
    each = f"({', '.join(['%.10g'] * rows.shape[1])})"
    text = "\n".join([each] * len(rows)) % tuple((np.round(rows, _DIGITS) + 0.0).ravel().tolist())
    return f"[{', '.join([', '.join([row] * times) for row in text.splitlines()])}]"


def integers(values: Sequence[int]) -> str:
    """An array of whole numbers."""
    return f"[{', '.join(map(str, values))}]"


def quaternion(rotation: Matrix) -> str:
    """A rotation as USD has it: w, x, y, z."""
    # The largest of the four is worked out first: nothing near 0 divides.
    trace = float(np.trace(rotation))
    squares = np.array([trace, *(2 * np.diag(rotation) - trace)])
    largest = int(squares.argmax())
    across = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    rows = np.zeros((4, 4))
    rows[0] = [1 + trace, *across]
    for axis in range(3):
        rows[axis + 1, 0] = across[axis]
        for other in range(3):
            rows[axis + 1, other + 1] = rotation[axis, other] + rotation[other, axis]
        rows[axis + 1, axis + 1] = 1 + 2 * rotation[axis, axis] - trace
    found = rows[largest]
    return numbers(found / np.linalg.norm(found))
