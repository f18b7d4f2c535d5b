"""The table of commands: which there are and what their help says, found without importing any of them."""

import argparse
import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Protocol, cast

COMMANDS = Path(__file__).with_name("commands")
"""The folder of the groups of commands."""

# What newcomers need stands first in the help, in the order they need it; everything else follows by name.
_GROUPS = ("specifications", "runs", "operations", "machine")
_FIRST = ("run", "validate", "plan", "report", "call")


class CommandModule(Protocol):
    """Interface of a command's module."""

    def declare(self, parser: argparse.ArgumentParser) -> None:
        """Adds the command's arguments."""

    def execute(self, arguments: argparse.Namespace) -> int:
        """Does what the command is for and returns the exit code."""
        ...


class Command(NamedTuple):
    """One command. Not a dataclass: importing those takes longer than everything else here."""

    name: str
    path: Path
    """Its module, or the folder of its commands."""

    summary: str
    """One line for the list of commands."""

    description: str
    """First paragraph of the command's own help."""

    def load(self) -> CommandModule:
        """Imports the command's module."""
        parts = self.path.relative_to(COMMANDS.parent).with_suffix("").parts
        return cast("CommandModule", importlib.import_module("." + ".".join(parts), __package__))


class Group(NamedTuple):
    """Commands that stand under one heading in the help; a group is no word of the command line."""

    heading: str
    commands: list[Command]


def find_groups(folder: Path) -> list[Group]:
    """Finds the groups of commands in a folder, in the order in which help lists them."""
    found = [path for path in folder.iterdir() if (path / "__init__.py").is_file()]
    return [
        Group(_description(path / "__init__.py").partition("\n")[0].rstrip("."), find_commands(path))
        for path in sorted(found, key=lambda path: _place(path.name, _GROUPS))
    ]


def find_commands(folder: Path) -> list[Command]:
    """Finds the commands in a folder, in the order in which help lists them."""
    return sorted(_commands(folder), key=lambda command: _place(command.name, _FIRST))


def _commands(folder: Path) -> Iterator[Command]:
    for path in folder.iterdir():
        if path.is_dir() and (path / "__init__.py").is_file():
            yield _command(path, path / "__init__.py")
        elif path.suffix == ".py" and path.stem != "__init__":
            yield _command(path, path)


def _command(path: Path, source: Path) -> Command:
    description = _description(source)
    first = description.partition("\n")[0].rstrip(".")
    return Command(path.stem.replace("_", "-"), path, first[0].lower() + first[1:], description)


def _description(source: Path) -> str:
    # Read, not imported: a list of commands needs the code of none. Style checks see to it that a module begins so.
    return source.read_text(encoding="utf-8").split('"""', 2)[1].rstrip()


def _place(name: str, first: tuple[str, ...]) -> tuple[int, str]:
    return first.index(name) if name in first else len(first), name
