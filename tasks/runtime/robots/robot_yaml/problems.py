"""Problems of a robot that came with an application."""

from collections.abc import Collection, Iterable
from difflib import get_close_matches

from .....schemas.wire.errors import LaunchError

INVALID_ROBOT = "InvalidBundleRobotApplication"
"""Failure code of a job whose robot cannot be made from its files."""

_SHOWN_NAMES = 12


def invalid(where: object, message: str) -> LaunchError:
    """An error about a file of the robot, or a place in one."""
    return LaunchError(f"{where}: {message}", INVALID_ROBOT)


def alternatives(name: str, names: Iterable[str], what: str) -> str:
    """Suggests what to write instead of an unknown name: the nearest name, or all."""
    there: Collection[str] = [each for each in names if each]
    if near := get_close_matches(name, there, n=1):
        return f"did you mean {near[0]!r}?"
    shown = ", ".join(list(there)[:_SHOWN_NAMES])
    more = f" and {len(there) - _SHOWN_NAMES} more" if len(there) > _SHOWN_NAMES else ""
    return f"it has {what} {shown}{more}" if there else f"it has no {what}"
