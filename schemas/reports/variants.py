"""Variants: settings in which the requests of one run's jobs differ, as short texts for a table."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, TypeAlias, cast

from ..runs.axes import cell_in_tags, value_text
from ..runs.trials import TRIALS_VARIABLE, planned_trials
from ..runs.variables import hide_secrets
from ..wire.arns import ResourceArn
from ..wire.errors import InvalidParameterException

_Path: TypeAlias = tuple[str, ...]
MAX_SHOWN = 3
"""Maximum number of settings in a job's text; those with the rarest values are shown."""

_MAX_CHARACTERS = 24
# Worlds have a column of their own; tokens and dates differ always and say nothing.
_LEFT_OUT = frozenset({"clientRequestToken", "worldConfigs"})
_REQUIREMENTS = "requirements"
_POLICY = ("policy",)
"""Setting that is named before all others: what drives the robot."""
_APPLICATIONS = {"robotApplications": "robot", "simulationApplications": "simulation"}


def variants(requests: Sequence[Mapping[str, Any]]) -> list[str]:
    """Describes how each simulation job request differs from the others: `SPEED=2, seed=7`; secrets are left out.

    A job of a step's axes is described by its cell and its seed, on which all else depends.

    Args:
        requests: Requests of simulation jobs, as JSON.

    Returns:
        One text for each request; empty where it has nothing of its own.
    """
    all_settings = _least_of_requirements([_of_cell(request) or _of_request(request) for request in requests])
    names = dict.fromkeys(name for settings in all_settings for name in settings)
    whole = _whole(requests, all_settings)
    differing = [name for name in names if len({_value(settings, name) for settings in whole}) > 1]
    counts = Counter((name, settings[name]) for settings in all_settings for name in differing if name in settings)
    return [
        _named({name: settings[name] for name in differing if name in settings}, counts) for settings in all_settings
    ]


def _whole(
    requests: Sequence[Mapping[str, Any]], all_settings: Sequence[Mapping[_Path, str]]
) -> Sequence[Mapping[_Path, str]]:
    """Returns all settings of requests, also those on which the cell of a job does not depend.

    They are needed only where some of the requests have a cell: what these have in common with the others is no
    difference.
    """
    cells = [_of_cell(request) for request in requests]
    if all(cells) or not any(cells):
        return all_settings
    return [{**cell, **_of_request(request)} for cell, request in zip(cells, requests, strict=True)]


def _value(settings: Mapping[_Path, str], name: _Path) -> str | None:
    """Returns the value of a setting; for an axis that a request lacks, that of its own member of the same name."""
    if name in settings or len(name) != 1:
        return settings.get(name)
    return next((value for path, value in settings.items() if _label(path) == name[0]), None)


def _least_of_requirements(all_settings: Sequence[Mapping[_Path, str]]) -> list[Mapping[_Path, str]]:
    """Leaves out requirements where other settings tell jobs apart, or their members where their names do."""
    ways = [
        [{path: each[path] for path in each if path[0] != _REQUIREMENTS} for each in all_settings],
        [{path: each[path] for path in each if path[:1] == path or path[0] != _REQUIREMENTS} for each in all_settings],
    ]
    different = len({frozenset(each.items()) for each in all_settings})
    told_apart = (way for way in ways if len({frozenset(each.items()) for each in way}) == different)
    return list(next(told_apart, all_settings))


def _of_cell(request: Mapping[str, Any]) -> dict[_Path, str]:
    """Returns the values of the step's axes and the seed of a request, as texts; without its world; empty: no axes."""
    cell = cell_in_tags(request.get("tags"))
    settings = {(name,): _short(value_text(value)) for name, value in cell.items() if ":world/" not in str(value)}
    step = {("step",): str(request["step"])} if "step" in request else {}
    return {**step, **settings, ("seed",): str(request.get("seed"))} if cell else {}


def _of_request(request: Mapping[str, Any]) -> dict[_Path, str]:
    """Returns the settings of a request; its trials are their number, as their axes vary in the job and not between."""
    plain = {name: value for name, value in hide_secrets(request).items() if name != "trials"}
    settings = {path: value for path, value in _settings(plain) if path[-1] != TRIALS_VARIABLE}
    if names := _names_of_requirements(plain.get(_REQUIREMENTS)):
        settings[(_REQUIREMENTS,)] = _short(names)
    trials = planned_trials(request)
    return {**settings, ("trials",): str(trials)} if trials else settings


def _names_of_requirements(asked: object) -> str:
    """Returns the names of a request's requirements: `soft, gentle`; empty: it has none."""
    items = cast("list[object]", asked) if isinstance(asked, list) else []
    each = (cast("Mapping[str, object]", item) for item in items if isinstance(item, Mapping))
    return ", ".join(str(item.get("name") or item.get("kind") or "") for item in each)


def _named(settings: Mapping[_Path, str], counts: Mapping[tuple[_Path, str], int]) -> str:
    """Selects the settings of a request that few other requests have, and formats them in the request's order."""
    rarest = sorted(settings, key=lambda name: (name != _POLICY, counts[name, settings[name]]))[:MAX_SHOWN]
    return ", ".join(_told(name, value) for name, value in settings.items() if name in rarest)


def _told(name: _Path, value: str) -> str:
    return f"{_REQUIREMENTS}: {value}" if name == (_REQUIREMENTS,) else f"{_label(name)}={value}"


def _settings(value: object, path: _Path = ()) -> Iterator[tuple[_Path, str]]:
    """Yields the scalars of a request with their paths; applications in lists are named by their role."""
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


def _label(path: _Path) -> str:
    """Returns the last part of a path that is a name and not a list index."""
    return next((part for part in reversed(path) if not part.isdigit()), path[-1])


def _short(text: str) -> str:
    with suppress(InvalidParameterException):
        text = ResourceArn.parse(text).name
    text = " ".join(text.split())
    return text if len(text) <= _MAX_CHARACTERS else f"{text[: _MAX_CHARACTERS - 1]}…"
