"""First command in which two runs of a robot program differ."""

from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..agents.action_log import ActionLog, ActionLogHeader

_MOST_VALUES = 4
"""Numbers of a command that are shown."""


class CommandDifference(NamedTuple):
    """First command that differs between two runs: its number from 0, its name, and both values in words."""

    number: int
    name: str
    """Name of the command with a space before it; empty: it has none."""

    values: str
    """Values in both runs: `1 and 0.1`; `none` where a run had sent all its commands."""

    steps: int
    """Number of commands of the first run."""

    def time_s(self, end_s: float) -> float:
        """Returns the simulated time of the command in seconds.

        Args:
            end_s: Simulated time at the end of the first run, in seconds.
        """
        return self.number * end_s / max(self.steps, 1)


def first_other_command(one: Path, other: Path) -> CommandDifference | None:
    """Finds the first command in which two runs differ; `None` if their commands are equal.

    Args:
        one: Action log of the first run.
        other: Action log of the second run.

    Raises:
        ActionLogError: A file is not an action log, or cannot be read.
    """
    log = ActionLog(one)
    pairs: Iterator[tuple[bytes | None, bytes | None]] = iter(zip_longest(log, ActionLog(other)))
    number, found = next(((number, pair) for number, pair in enumerate(pairs) if pair[0] != pair[1]), (0, None))
    if found is None:
        return None
    values = [_values(log.header, each) if each is not None else "none" for each in found]
    name = next((each.description or "" for each in log.header.arrays), "")
    return CommandDifference(number, f" {name}" if name else "", " and ".join(values), sum(1 for _ in log))


def _values(header: ActionLogHeader, action: bytes) -> str:
    numbers: list[str] = []
    for array in header.arrays:
        count = int(np.prod(array.shape)) if array.shape else 1
        numbers += [f"{value:.6g}" for value in np.frombuffer(action, array.dtype, count, array.offset)]
    shown = numbers[:_MOST_VALUES] + (["…"] if len(numbers) > _MOST_VALUES else [])
    return f"({', '.join(shown)})" if len(shown) != 1 else shown[0]
