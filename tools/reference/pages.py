"""Generated pages and files: which there are, the map of rooms, and the tables of the guide."""

import ast
import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from prefect_robomaker.schemas.operations.registry import OPERATION_GROUPS
from prefect_robomaker.schemas.runs.axes import AXIS_KINDS
from prefect_robomaker.schemas.runs.axis_kinds.kind import NumberAxis
from prefect_robomaker.schemas.runs.recording_sources import RecordingSources
from prefect_robomaker.schemas.runs.requirements import REQUIREMENT_KINDS
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.runtime.robots.robot_yaml.shape import SENSOR_KINDS
from tools.reference.behaviours import BEHAVIOURS, Kind
from tools.reference.commands_page import commands_page
from tools.reference.door import flows_stub, operation_flows_module, with_deployments
from tools.reference.operations_page import operations_page
from tools.reference.settings_page import settings_page

_LAYERS = ("prefect_robomaker", "deployments", "flows", "tasks", "schemas")
_BEGIN, _END = "<!-- made: rooms -->\n", "<!-- end -->"


def with_rooms(text: str, root: Path) -> str:
    """Makes the map anew between its marks; what stands around it stays.

    Args:
        text: The page.
        root: The folder of the repository.

    Raises:
        ValueError: The page has no marks.
    """
    before, begin, rest = text.partition(_BEGIN)
    _, end, after = rest.partition(_END)
    if not begin or not end:
        raise ValueError(f"the page has no {_BEGIN.strip()} with {_END} after it")
    rows = ["| room | what lives there |", "| --- | --- |", *_rows(root)]
    return "\n".join([before + begin, *rows, "", end + after])


def _rows(root: Path) -> Iterator[str]:
    for layer in _LAYERS:
        for path in sorted((root / layer).rglob("__init__.py")):
            room = path.parent.relative_to(root)
            if "specs" not in room.parts or room.parts[0] == "schemas":
                docstring = ast.get_docstring(ast.parse(path.read_text())) or ""
                first = re.sub(r"\s+", " ", docstring.partition("\n\n")[0]).rstrip(".")
                yield f"| [`{room}`](../{room}) | {first} |"


_MARK = re.compile(r"<!-- made: (?P<name>[a-z-]+) -->\n.*?<!-- end -->", re.DOTALL)


def with_tables(page: str) -> str:
    """A page with the tables that its marks name.

    Args:
        page: Markdown, with `<!-- made: calls -->` … `<!-- end -->` where a table belongs.

    Raises:
        ValueError: A mark names no table.
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


def _requirement_kinds() -> str:
    """Each kind of requirement."""
    lines = ["| kind | is violated when | members |", "| --- | --- | --- |"]
    lines += [f"| `{name}` | {kind.violated_when} | {kind.more_members} |" for name, kind in REQUIREMENT_KINDS.items()]
    return "\n".join(lines)


def _axis_kinds() -> str:
    """Each kind of axis of trials."""
    lines = ["| kind | what it varies | possible values | changes nothing | for |", "| --- | --- | --- | --- | --- |"]
    for name, kind in AXIS_KINDS.items():
        possible, neutral = (kind.possible(), kind.neutral) if issubclass(kind, NumberAxis) else ("texts", "")
        lines.append(f"| `{name}` | {kind.varies} | {possible} | {neutral} | {kind.applies_to} |")
    return "\n".join(lines)


def _sensor_kinds() -> str:
    """Each kind of sensor that is one module."""
    lines = ["| member | what it is | names of the model's own | numbers | topic |", "| --- | --- | --- | --- | --- |"]
    for name, kind in SENSOR_KINDS.items():
        parts, topic = ", ".join(f"`{part}`" for part in kind.parts), f"`{kind.topic}`" if kind.topic else ""
        lines.append(f"| `sensors.{name}` | {kind.__doc__} | {parts} | {kind.units} | {topic} |")
    return "\n".join(lines)


def _recording_sources() -> str:
    """Each member of the sources that recordings are judged by."""
    lines = ["| member | default | |", "| --- | --- | --- |"]
    for name, field in RecordingSources.model_fields.items():
        default = "" if field.default is None else f"`{json.dumps(field.default)}`"
        lines.append(f"| `{name}` | {default} | {field.description} |")
    return "\n".join(lines)


_TABLES: Mapping[str, Callable[[], str]] = {
    "calls": _calls,
    "axis-kinds": _axis_kinds,
    "requirement-kinds": _requirement_kinds,
    "recording-sources": _recording_sources,
    "sensor-kinds": _sensor_kinds,
    "differences": lambda: _by_kind("differs", ("the service", "here")),
    "decisions": lambda: _by_kind("decided", ("what is known", "here")),
}


DOCS = Path(__file__).parents[2] / "docs"
"""Folder of the documentation, in a copy of the repository."""


def pages() -> Mapping[Path, str]:
    """Makes the pages, and the files that list all flows; what people have written in them stays.

    Raises:
        ConfigurationError: This is an installed package, which has no documentation.
    """
    guide = DOCS / "coming-from-robomaker.md"
    tables = (guide, *(DOCS / name for name in ("verdicts.md", "robots.md", "judging.md", "trials.md")))
    if not guide.exists():
        raise ConfigurationError(f"{guide} does not exist; the documentation is made in a copy of the repository")
    root, architecture = DOCS.parent, DOCS / "architecture.md"
    deployments = root / "deployments" / "prefect.yaml"
    return {
        DOCS / "operations.md": operations_page(),
        DOCS / "commands.md": commands_page(DOCS),
        DOCS / "settings.md": settings_page(),
        **{page: with_tables(page.read_text()) for page in tables},
        architecture: with_rooms(architecture.read_text(), root),
        root / "prefect_robomaker" / "operation_flows.py": operation_flows_module(),
        root / "flows" / "operations.pyi": flows_stub(),
        deployments: with_deployments(deployments.read_text()),
    }
