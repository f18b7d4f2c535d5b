"""Rooms: each folder says what lives there, and imports what `rooms.toml` allows."""

import ast
import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
LAYERS = ("schemas", "tasks", "flows", "deployments")
MOST_MODULES = 15
"""Side by side in one folder; the resources of the service are 12, with what they share."""
ONE_FILE_FOR_ONE_KIND = ("schemas.runs.axis_kinds", "schemas.runs.requirement_kinds")
"""Rooms in which a module is a kind, so that they grow with the kinds there are."""


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


IMPORT = re.compile(r"^[ \t]*from (\.+)([\w.]*) import (\([^)]*\)|.*)$", re.MULTILINE)
"""Found in text: parsing every module of the product takes 50 times as long."""


@cache
def text_of(module: str) -> str:
    """A module's text."""
    return MODULES[module].read_text()


@cache
def imports(module: str) -> set[str]:
    """The modules of this package that a module imports."""
    package = room_of(module).split(".")
    found: set[str] = set()
    for dots, path, names in IMPORT.findall(text_of(module)):
        base = ".".join([*package[: len(package) - len(dots) + 1], *([path] if path else [])])
        for name in re.findall(r"(\w+)(?: as \w+)?,?", re.sub("#.*", "", names)):
            found.add(f"{base}.{name}" if f"{base}.{name}" in MODULES else base)
    return found


def says(room: str) -> str:
    """A room's docstring in one line."""
    return re.sub(r"\s+", " ", ast.get_docstring(ast.parse(text_of(room))) or "")


def test_each_room_says_what_lives_there() -> None:
    assert [room for room in ROOMS if not says(room)] == []


def test_no_room_is_a_warehouse() -> None:
    modules = Counter(name.rpartition(".")[0] for name in MODULES if name not in ROOMS)
    for room in ONE_FILE_FOR_ONE_KIND:
        del modules[room]
    assert {room: count for room, count in modules.items() if count > MOST_MODULES} == {}


def test_each_room_imports_what_the_contract_allows() -> None:
    contract: dict[str, list[str]] = tomllib.loads((ROOT / "tests" / "rooms.toml").read_text())
    held = {room for room in ROOMS if room.startswith(("schemas.", "tasks."))}
    assert set(contract) == held
    wrong: set[str] = set()
    for room, allowed in contract.items():
        used = {room_of(imported) for module in MODULES if room_of(module) == room for imported in imports(module)}
        wrong |= {
            f"{room} imports {name}"
            for name in used - {room}
            if not any(name == each or name.startswith(f"{each}.") for each in allowed)
        }

    assert wrong == set()


def test_names_of_modules_in_texts_are_those_of_modules() -> None:
    """Modules that are imported by name, or started with `python -m`."""
    named = {name for module in MODULES for name in re.findall(r'"prefect_robomaker\.([\w.]+)"', text_of(module))}
    factories = {name for name in named if name.rpartition(".")[2].startswith("make_")}

    assert {name for name in named - factories if name not in MODULES} == set()
    assert {name for name in factories if name.rpartition(".")[0] not in MODULES} == set()
