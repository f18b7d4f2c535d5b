"""Prints results of commands (data, tables, problems, durations) and opens pages in the browser."""

import json
import os
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from ....schemas.wire.errors import Problem

if TYPE_CHECKING:
    from pydantic import BaseModel


Cell = tuple[str, str]
"""Text of a table cell, and its style."""


def print_answer(answer: dict[str, Any], form: str) -> None:
    """Prints an API response as JSON or YAML."""
    sys.stdout.write(_as_yaml(answer) if form == "yaml" else _as_json(answer))


def print_either(form: str, document: "BaseModel | dict[str, Any]", lines: Iterable[str]) -> None:
    """Prints a command's result as JSON for programs, or as lines for people.

    Args:
        form: `json`, or anything else for lines.
        document: The answer for programs.
        lines: The answer for people.
    """
    if form != "json":
        sys.stdout.write("".join(f"{line}\n" for line in lines))
    elif isinstance(document, dict):
        sys.stdout.write(_as_json(document))
    else:
        sys.stdout.write(document.model_dump_json(indent=2, exclude_none=True) + "\n")


def in_columns(rows: Sequence[Sequence[str]], right: Collection[int] = ()) -> list[str]:
    """Formats rows of cells as an aligned text table.

    Args:
        rows: The cells, those of the titles first.
        right: Numbers of the columns that are aligned to the right.
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
    """Prints lines of styled text; paths and ARNs are not broken, so that they can be copied.

    Raises:
        BrokenPipeError: The reader of the stream has closed it; a console would end the process with 1.
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


def print_problems(problems: Sequence[Problem], page: str | None = None) -> None:
    """Prints a specification's problems and their number to standard error, in GitHub workflows also as annotations.

    Args:
        problems: The problems; at least one.
        page: Clause on the page that says what would be right; None: that on specifications.
    """
    from ....schemas.wire.common import counted
    from ....schemas.wire.errors import SpecError

    for problem in problems:
        sys.stderr.write(f"{problem}\n")
    files = {problem.place.file for problem in problems}
    count = counted(len(problems), "problem")
    sys.stderr.write(f"robomaker: {count} in {', '.join(sorted(files))}; nothing was run; {page or SpecError.page}\n")
    if os.environ.get("GITHUB_ACTIONS") == "true":
        for problem in problems:
            sys.stderr.write(f"{annotation(problem)}\n")


def print_notes(notes: Sequence[Problem]) -> None:
    """Prints to standard error what may be wrong with a specification, and is no problem."""
    for note in notes:
        sys.stderr.write(f"{note.place}: {note.path}: note: {note.message}\n")


def annotation(problem: Problem) -> str:
    """Formats a specification's problem as a GitHub workflow annotation."""
    text = f"{problem.path}: {problem.message}" if problem.path else problem.message
    escaped = text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
    place = problem.place
    return f"::error file={place.file},line={place.line},col={place.column}::{escaped}"


def opens_files(choice: bool | None, environ: Mapping[str, str] | None = None) -> bool:
    """Whether to open a browser: as the user chose, otherwise only at a desktop's terminal."""
    if choice is not None:
        return choice
    environ = os.environ if environ is None else environ
    desktop = bool(environ.get("DISPLAY") or environ.get("WAYLAND_DISPLAY"))
    remote = "SSH_CONNECTION" in environ or bool(environ.get("CI"))
    return desktop and not remote and sys.stdout.isatty() and sys.stderr.isatty()


def open_file(path: Path) -> None:
    """Opens a file in the browser; prints a message if there is none."""
    _open(path.resolve().as_uri(), str(path))


def open_address(address: str) -> None:
    """Opens a URL in the browser; prints a message if there is none."""
    _open(address, address)


def _open(address: str, name: str) -> None:
    import webbrowser

    if not webbrowser.open(address):
        sys.stderr.write(f"No browser could be started; open {name} yourself.\n")


def duration(seconds: float) -> str:
    """Formats a duration in seconds: `0.4 s`, `12 s`, `3 min 05 s`, `5 min`, `2 h 10 min`."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min" + (f" {whole % 60:02d} s" if whole % 60 else "")
    minutes = whole % 3600 // 60
    return f"{whole // 3600} h" + (f" {minutes:02d} min" if minutes else "")
