"""Rooms: each folder says what lives there and what it may import, and others use only what it shows."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LAYERS = ("schemas", "tasks", "flows", "deployments")
MOST_MODULES = 15
"""Side by side in one folder; the resources of the service are 12, with what they share."""


def source_files() -> Iterator[Path]:
    for layer in LAYERS:
        yield from (path for path in (ROOT / layer).rglob("*.py") if ROOT / "deployments" / "specs" not in path.parents)


def dotted(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {dotted(path): path for path in source_files()}
ROOMS = {name: path for name, path in MODULES.items() if path.name == "__init__.py"}


def room_of(module: str) -> str:
    return module if module in ROOMS else module.rpartition(".")[0]


def imports(module: str) -> Iterator[str]:
    """The modules of this package that a module imports."""
    package = room_of(module).split(".")
    for node in ast.walk(ast.parse(MODULES[module].read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = ".".join([*package[: len(package) - node.level + 1], *([node.module] if node.module else [])])
            for alias in node.names:
                yield f"{base}.{alias.name}" if f"{base}.{alias.name}" in MODULES else base


def shown(room: str) -> set[str]:
    """What a room's `__all__` names."""
    for node in ast.parse(ROOMS[room].read_text()).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == "__all__":
            return set(ast.literal_eval(node.value))
    return set()


@pytest.mark.parametrize("room", sorted(ROOMS))
def test_a_room_says_what_lives_there(room: str) -> None:
    assert ast.get_docstring(ast.parse(ROOMS[room].read_text()))


@pytest.mark.parametrize("room", sorted(ROOMS))
def test_a_room_is_no_warehouse(room: str) -> None:
    modules = [name for name in MODULES if name.rpartition(".")[0] == room and name not in ROOMS]
    assert len(modules) <= MOST_MODULES


@pytest.mark.parametrize("room", [room for room in sorted(ROOMS) if room.startswith(("schemas.", "tasks."))])
def test_a_room_imports_what_its_docstring_allows(room: str) -> None:
    text = re.sub(r"\s+", " ", ast.get_docstring(ast.parse(ROOMS[room].read_text())) or "")
    stated = re.search(r"May import: ([^.]*(?:\.[a-z_][^.]*)*)\.(?: |$)", text)
    assert stated, "its docstring has no line `May import: …`"
    allowed = {name if not name.startswith(".") else room + name for name in re.findall("`([^`]+)`", stated.group(1))}
    used = {
        room_of(imported)
        for module in MODULES
        if room_of(module) == room
        for imported in imports(module)
        if room_of(imported) != room
    }

    assert {name for name in used if not any(name == each or name.startswith(f"{each}.") for each in allowed)} == set()


def test_rooms_use_only_what_other_rooms_show() -> None:
    hidden = {
        f"{module} uses {imported}"
        for module in MODULES
        for imported in imports(module)
        if imported not in ROOMS
        and room_of(module) != room_of(imported)
        and room_of(imported).startswith(("schemas.", "tasks."))
        and imported.rpartition(".")[2] not in shown(room_of(imported))
    }

    assert hidden == set()


def test_names_of_modules_in_texts_are_those_of_modules() -> None:
    """Modules that are imported by name, or started with `python -m`."""
    named = {
        node.value.removeprefix("prefect_robomaker.")
        for path in MODULES.values()
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and re.fullmatch(r"prefect_robomaker(\.\w+)+", node.value)
    }
    factories = {name for name in named if name.rpartition(".")[2].startswith("make_")}

    assert {name for name in named - factories if name not in MODULES} == set()
    assert {name for name in factories if name.rpartition(".")[0] not in MODULES} == set()
