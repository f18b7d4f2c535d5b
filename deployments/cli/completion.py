"""Shell completion of commands, options, operations, runs and specification files.

The shell calls `robomaker` itself at each press of the Tab key, so the completions are always current.
"""

import argparse
import os
from collections.abc import Callable, Iterator
from typing import TypeAlias

from argcomplete.completers import FilesCompleter
from argcomplete.finders import CompletionFinder

from .grammar import CommandParser

Completer: TypeAlias = Callable[..., object]

_MAX_RUNS = 50
"""Limit of the runs that are offered as completions, the latest first."""


def complete(parser: argparse.ArgumentParser) -> None:
    """Prints the completions for a half-typed command line to the shell and ends the program; else it returns."""
    for action in _actions(parser):
        if (completer := _COMPLETERS.get(str(action.metavar))) is not None:
            setattr(action, "completer", completer)  # noqa: B010 - argcomplete's convention, unknown to argparse's types
    CompletionFinder()(parser)


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yields all arguments of all commands, as argcomplete needs them before it begins."""
    if isinstance(parser, CommandParser):
        parser.declare()
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)


def _operations(**_: object) -> list[str]:
    from ...schemas.operations.registry import OPERATIONS

    return sorted(OPERATIONS)


def _runs(**_: object) -> list[str]:
    from ...schemas.reports.names import newest_first
    from ...schemas.settings import Settings

    folder = Settings.from_environment(os.environ).home / "runs"
    return ["latest", *(path.parent.name for path in newest_first(folder.glob("*/run.json"))[:_MAX_RUNS])]


_COMPLETERS: dict[str, Completer] = {
    "OPERATION": _operations,
    "RUN": _runs,
    "SPEC": FilesCompleter(["yaml", "yml", "json"]),
}
