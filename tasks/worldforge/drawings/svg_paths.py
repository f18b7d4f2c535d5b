"""The corners of SVG paths: the `d` attribute, of which only the ends of curves are kept."""

import re
from collections.abc import Iterator, Sequence

from ....schemas.worlds.world import Point

_TOKENS = re.compile(r"([MmLlHhVvCcSsQqTtAaZz])|([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7}


MOST_CORNERS = 10_000
"""Corners of one shape. Rooms have a dozen; a traced picture has some thousands and is no part of a plan."""


class PathError(ValueError):
    """A path that cannot be read."""


class TooManyCornersError(Exception):
    """A shape that is too large to be a part of a plan."""


def path_points(d: str) -> tuple[list[Point], bool, bool]:
    """Corners of the first part of a path, whether it is closed, and whether it has curves.

    Raises:
        PathError: it is no path.
    """
    points: list[Point] = []
    curved = closed = False
    x = y = 0.0
    for command, numbers in _commands(d):
        if len(points) >= MOST_CORNERS:
            raise TooManyCornersError(f"it has more than {MOST_CORNERS:,} corners")
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
    """End point of a path's command."""
    base = at if command.islower() else (0.0, 0.0)
    if command in "Hh":
        return base[0] + numbers[0], at[1]
    if command in "Vv":
        return at[0], base[1] + numbers[0]
    return base[0] + numbers[-2], base[1] + numbers[-1]


def _commands(d: str) -> Iterator[tuple[str, list[float]]]:
    """Commands with their numbers, as far as they are asked for; after `M`, repeated numbers are lines."""
    command, numbers = "", list[float]()
    for token in _TOKENS.finditer(d):
        letter, number = token.groups()
        if letter:
            if numbers:
                raise PathError(f"{command} has {len(numbers)} numbers too many")
            command = letter
            if letter in "Zz":
                yield letter, []
            continue
        if command not in _COUNTS and command.upper() not in _COUNTS:
            raise PathError("it does not begin with M")
        numbers.append(float(number))
        if len(numbers) == _COUNTS[command.upper()]:
            yield command, numbers
            numbers = []
            command = {"M": "L", "m": "l"}.get(command, command)
    if numbers:
        raise PathError(f"{command} lacks numbers")
