"""Answers of commands as text: responses in JSON or YAML, with times in ISO 8601; lines with styles."""

import json
import sys
from collections.abc import Collection, Iterable, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from pydantic import BaseModel

Cell = tuple[str, str]
"""Text and style."""


def print_answer(answer: dict[str, Any], form: str) -> None:
    """Prints a response as JSON or YAML."""
    sys.stdout.write(_as_yaml(answer) if form == "yaml" else _as_json(answer))


def print_either(form: str, document: "BaseModel | dict[str, Any]", lines: Iterable[str]) -> None:
    """Prints an answer as JSON, or as lines for people.

    Args:
        form: `json`, or anything else for lines.
        document: the answer for programs.
        lines: the answer for people.
    """
    if form != "json":
        sys.stdout.write("".join(f"{line}\n" for line in lines))
    elif isinstance(document, dict):
        sys.stdout.write(_as_json(document))
    else:
        sys.stdout.write(document.model_dump_json(indent=2, exclude_none=True) + "\n")


def in_columns(rows: Sequence[Sequence[str]], right: Collection[int] = ()) -> list[str]:
    """Lines of a table, whose columns are as wide as need be.

    Args:
        rows: the cells, those of the titles first.
        right: numbers of the columns that are aligned to the right.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.rjust(width) if column in right else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def print_lines(lines: Iterable[Sequence[Cell]], stream: TextIO) -> None:
    """Prints lines of styled cells; paths and ARNs stay in one piece, however narrow the window: people copy them.

    Raises:
        BrokenPipeError: who reads the stream has gone away; a console would end the process with 1.
    """
    from rich.console import Console
    from rich.text import Text

    console = Console(file=stream, highlight=False, soft_wrap=True)
    with console.capture() as printed:
        for line in lines:
            console.print(Text.assemble(*line) if line else "")
    stream.write(printed.get())


def _as_json(answer: dict[str, Any]) -> str:
    return json.dumps(answer, indent=2, ensure_ascii=False, default=_time_text) + "\n"


def _as_yaml(answer: dict[str, Any]) -> str:
    from io import StringIO

    from ruamel.yaml import YAML

    text = StringIO()
    writer = YAML()
    writer.width = 10_000  # long ARNs stay on their line
    writer.dump(json.loads(_as_json(answer)), text)
    return text.getvalue()


def _time_text(value: object) -> str:
    if isinstance(value, datetime):
        return value.astimezone(UTC).isoformat()
    raise TypeError(f"{value!r} has no JSON form")
