"""Factory functions of applications as their source says them: found like an import finds them, but nothing is run."""

import ast
import importlib.util
import pkgutil
from collections.abc import Iterable, Iterator, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import NamedTuple

from .loading import missing_attribute, missing_package

_MOST_BYTES = 4 << 20
"""Largest source that is read: generated ones may be longer, and are taken as they are."""
_BINDERS = {"globals", "exec", "vars", "setattr"}
"""Functions that may bind names of a module that its source does not say."""


class SourceProblem(NamedTuple):
    """Reason why a factory function cannot be imported, by its source."""

    message: str
    file: Path | None = None
    """File that is wrong; `None`: there is no file, as its package is missing."""

    line: int = 1
    column: int = 1


def why_no_factory(attribute: str, path: Path | None) -> SourceProblem | None:
    """Returns why the factory function of an application does not exist; `None` if it does, or only running it tells.

    Args:
        attribute: Dotted path, `package.module.make_environment`.
        path: The bundle's folder that has to contain the package; None for an installed package.
    """
    parts = attribute.split(".")
    if len(parts) < 2 or not all(part.isidentifier() for part in parts):
        return SourceProblem(f"{attribute!r} is not a dotted path like `package.module.make_environment`")
    found = _top(parts[0], path)
    return SourceProblem(missing_package(attribute, parts[0], path)) if found is None else _missing(parts, found)


def why_no_module(module: str, path: Path | None) -> SourceProblem | None:
    """Returns why a module does not exist; `None` if it does, or only running it tells.

    Args:
        module: Dotted name of the module.
        path: The bundle's folder that has to contain it; None for an installed package.
    """
    parts = module.split(".")
    found = _top(parts[0], path)
    if found is None:
        return SourceProblem(missing_package(module, parts[0], path))
    return _missing(parts, found) if len(parts) > 1 else None


def _missing(parts: Sequence[str], found: ModuleSpec) -> SourceProblem | None:
    """Returns why a package lacks what a dotted path names; `None` if it does not, or only running it tells."""
    attribute, count = ".".join(parts), 1
    while count < len(parts) - 1 and (inner := _inner(".".join(parts[: count + 1]), found)) is not None:
        found, count = inner, count + 1
    where, name = ".".join(parts[:count]), parts[count]
    file = Path(found.origin) if found.origin and found.origin.endswith(".py") else None
    places = [Path(each) for each in found.submodule_search_locations or ()]
    modules = [module.name for module in pkgutil.iter_modules([str(each) for each in places])]
    modules += [each.name for place in places if place.is_dir() for each in place.iterdir() if each.is_dir()]
    if file is None and found.loader is not None and found.origin is not None:
        return None  # compiled
    try:
        names = _names(file) if file is not None else ()
    except SyntaxError as error:
        return SourceProblem(f"{error.msg} (needed for {attribute})", file, error.lineno or 1, error.offset or 1)
    if names is None or name in names or name in modules:
        return None
    return SourceProblem(missing_attribute(attribute, where, name, [*names, *modules]), file)


def _top(name: str, path: Path | None) -> ModuleSpec | None:
    if path is not None:
        return PathFinder.find_spec(name, [str(path)])
    try:
        return importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return None


def _inner(name: str, package: ModuleSpec) -> ModuleSpec | None:
    places = package.submodule_search_locations
    # By the last component: of a folder without `__init__.py`, the finder would look its package up in `sys.modules`.
    return None if places is None else PathFinder.find_spec(name.rpartition(".")[2], list(places))


def _names(file: Path) -> Sequence[str] | None:
    """Returns the names that a module binds; `None` if only running it tells them. Raises SyntaxError."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    if len(content) > _MOST_BYTES:
        return None
    try:
        tree = ast.parse(content, file.name)
    except (RecursionError, MemoryError, ValueError):  # a ValueError: it has zero bytes
        return None
    called = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    found = list(_bound(tree.body))
    return None if _BINDERS & called or {"*", "__getattr__"}.intersection(found) else found


def _bound(statements: Iterable[ast.stmt]) -> Iterator[str]:
    """Yields the names that statements of a module may bind; `*` for all those of another module."""
    for each in statements:
        if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield each.name
        elif isinstance(each, ast.Import | ast.ImportFrom):
            yield from (alias.asname or alias.name.partition(".")[0] for alias in each.names)
        else:
            inner = ast.walk(each)
            yield from (node.id for node in inner if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store))
            for part in ("body", "orelse", "finalbody", "handlers", "cases"):
                for item in getattr(each, part, ()):
                    yield from _bound([item] if isinstance(item, ast.stmt) else item.body)
