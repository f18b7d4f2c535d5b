"""The tables of `docs/coming-from-robomaker.md` that are made, between marks that Markdown does not show."""

import re
from collections.abc import Callable, Mapping

from prefect_robomaker.schemas.operations.resources import OPERATION_GROUPS

from .behaviours import BEHAVIOURS, Kind

_MARK = re.compile(r"<!-- made: (?P<name>[a-z-]+) -->\n.*?<!-- end -->", re.DOTALL)


def with_tables(page: str) -> str:
    """A page with the tables that its marks name.

    Args:
        page: Markdown, with `<!-- made: calls -->` … `<!-- end -->` where a table belongs.

    Raises:
        ValueError: a mark names no table.
    """

    def made(mark: re.Match[str]) -> str:
        if (make := _TABLES.get(mark["name"])) is None:
            raise ValueError(f"{mark['name']!r} is no table; there are {', '.join(_TABLES)}")
        return f"<!-- made: {mark['name']} -->\n\n{make()}\n\n<!-- end -->"

    return _MARK.sub(made, page)


def _calls() -> str:
    """Each call of the service, and what it does here in a few words."""
    lines = ["| call of the service | here |", "| --- | --- |"]
    for title, operations in OPERATION_GROUPS.items():
        lines.append(f"| **{title}** | |")
        for each in operations:
            link = f"[{each.name}](operations.md#{each.name.lower()})"
            lines.append(f"| {link} | {each.description} |")
    return "\n".join(lines)


def _by_kind(kind: Kind, titles: tuple[str, str]) -> str:
    """Everything of one kind, group by group."""
    parts = []
    for title, group in BEHAVIOURS.items():
        rows = [f"| {each.topic} | {each.known} | {each.here} |" for each in group if each.kind == kind]
        if rows:
            parts.append("\n".join([f"| {title} | {titles[0]} | {titles[1]} |", "| --- | --- | --- |", *rows]))
    return "\n\n".join(parts)


_TABLES: Mapping[str, Callable[[], str]] = {
    "calls": _calls,
    "differences": lambda: _by_kind("differs", ("the service", "here")),
    "decisions": lambda: _by_kind("decided", ("what is known", "here")),
}
