"""What sets the jobs of one run apart: the settings in which their requests differ, short enough for a table."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, cast

from ..wire.arns import ResourceArn
from ..wire.errors import InvalidParameterException

MAX_SHOWN = 3
"""Settings named for a job; a request that differs in more is looked up by its number."""

_MAX_CHARACTERS = 24
# Worlds have a column of their own; tokens and dates differ always and say nothing.
_LEFT_OUT = frozenset({"clientRequestToken", "worldConfigs"})
_APPLICATIONS = {"robotApplications": "robot", "simulationApplications": "simulation"}


def variants(requests: Sequence[Mapping[str, Any]]) -> list[str]:
    """Says of each request what it has that not all of them have: `SPEED=2, seed=7`.

    Args:
        requests: Requests of simulation jobs, as JSON.

    Returns:
        One text for each request; empty where it has nothing of its own.
    """
    all_settings = [dict(_settings(request)) for request in requests]
    names = dict.fromkeys(name for settings in all_settings for name in settings)
    differing = [name for name in names if len({settings.get(name) for settings in all_settings}) > 1]
    return [
        ", ".join([f"{_label(name)}={settings[name]}" for name in differing if name in settings][:MAX_SHOWN])
        for settings in all_settings
    ]


def _settings(value: object, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], str]]:
    """The scalars of a request with their paths; an application's place in its list is named by its kind."""
    if isinstance(value, Mapping):
        for key, item in cast("Mapping[str, object]", value).items():
            if key not in _LEFT_OUT:
                yield from _settings(item, (*path, key))
    elif isinstance(value, list):
        for index, item in enumerate(cast("list[object]", value)):
            yield from _settings(item, (*path, str(index)))
    elif value is not None:
        is_application = path[-1:] == ("application",)
        named = (*path[:-1], _APPLICATIONS.get(path[0], "application")) if is_application else path
        yield named, _short(str(value))


def _label(path: tuple[str, ...]) -> str:
    """The last part of a path that is a name and no place in a list."""
    return next((part for part in reversed(path) if not part.isdigit()), path[-1])


def _short(text: str) -> str:
    with suppress(InvalidParameterException):
        text = ResourceArn.parse(text).name
    text = " ".join(text.split())
    return text if len(text) <= _MAX_CHARACTERS else f"{text[: _MAX_CHARACTERS - 1]}…"
