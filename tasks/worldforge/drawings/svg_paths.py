"""The corners of SVG paths: the `d` attribute, of which only the ends of curves are kept."""

import re
from collections.abc import Sequence

from ....schemas.worlds.world import Point

_TOKENS = re.compile(r"([MmLlHhVvCcSsQqTtAaZz])|([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7}


class PathError(ValueError):
    """A path that cannot be read."""


def path_points(d: str) -> tuple[list[Point], bool, bool]:
    """Corners of the first part of a path, whether it is closed, and whether it has curves.

    Raises:
        PathError: it is no path.
    """
    points: list[Point] = []
    curved = closed = False
    x = y = 0.0
    for command, numbers in _commands(d):
        if command in "Zz":
            closed = True
            break
        if command in "Mm" and points:
            break
        x, y = _end(command, numbers, (x, y))
        curved |= command.upper() in "CSQTA"
        points.append((x, y))
    if len(points) > 3 and points[0] == points[-1]:
        closed = True
    return points, closed, curved


def _end(command: str, numbers: Sequence[float], at: Point) -> Point:
    """Where a command of a path leads to."""
    base = at if command.islower() else (0.0, 0.0)
    if command in "Hh":
        return base[0] + numbers[0], at[1]
    if command in "Vv":
        return at[0], base[1] + numbers[0]
    return base[0] + numbers[-2], base[1] + numbers[-1]


def _commands(d: str) -> list[tuple[str, list[float]]]:
    """Commands with their numbers; repeated numbers repeat the command, after `M` they are lines."""
    found: list[tuple[str, list[float]]] = []
    command, numbers = "", list[float]()
    for letter, number in _TOKENS.findall(d):
        if letter:
            if numbers:
                raise PathError(f"{command} has {len(numbers)} numbers too many")
            command = letter
            if letter in "Zz":
                found.append((letter, []))
            continue
        if command not in _COUNTS and command.upper() not in _COUNTS:
            raise PathError("it does not begin with M")
        numbers.append(float(number))
        if len(numbers) == _COUNTS[command.upper()]:
            found.append((command, numbers))
            numbers = []
            command = {"M": "L", "m": "l"}.get(command, command)
    if numbers:
        raise PathError(f"{command} lacks numbers")
    return found
