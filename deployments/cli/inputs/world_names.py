"""Option `--name` of commands that store a world: its name for people."""

import argparse
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ....tasks.catalog import Resource


def add_name(parser: argparse.ArgumentParser) -> None:
    """Adds the option `--name` to a parser."""
    parser.add_argument(
        "--name",
        help="the world's name, by which commands, reports and the console know it (default: it is called by its id)",
    )


def world_name(text: str | None) -> str | None:
    """Returns the value of `--name` as worlds are named; `None`: it is not given.

    Raises:
        ConfigurationError: It is no name; the message says what would be right.
    """
    from ....schemas.reports.names import given_world_name
    from ....schemas.wire.errors import ConfigurationError

    try:
        return text if text is None else given_world_name(text)
    except ValueError as error:
        raise ConfigurationError(f"--name {text!r}: {error}") from error


def tell_same(world: "Resource") -> None:
    """Says on standard error that a world of that name and content is there already."""
    sys.stderr.write(f"{world.id} has this name and the same content already; no other world is made.\n")
