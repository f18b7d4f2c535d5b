"""Keeps old import paths of modules that moved working.

Code of users, stored applications and pickles may still name a module's old path. Importing it gives the module at its
new path and a `DeprecationWarning` that names that path. Where a package now has the name of an old module, names that
the module had are found on the package in the same way. To end this, delete this module, `old_paths_table.py` and the
line of `__init__.py` that calls `install`.
"""

import importlib
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import ModuleType
from typing import Any

from .old_paths_table import MOVED, SPLIT

_LAST_VERSION = "0.2"
"""The last version in which old paths work."""


def install() -> None:
    """Lets old paths be imported; again: changes nothing."""
    if not any(isinstance(finder, _OldPaths) for finder in sys.meta_path):
        sys.meta_path.insert(0, _OldPaths())


class _OldPaths(MetaPathFinder):
    """Finds modules by their old paths, and packages that took over the name of an old module."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Answers for what is in the table and below it; everything else is found as usual."""
        del target
        parent, _, child = fullname.rpartition(".")
        if parent in MOVED and (package := sys.modules[parent].__name__) != parent:
            return ModuleSpec(fullname, _Moved(fullname, MOVED.get(fullname, f"{package}.{child}")))
        if fullname not in MOVED:
            return None
        found = PathFinder.find_spec(fullname, path)
        if found is None:
            return ModuleSpec(fullname, _Moved(fullname, MOVED[fullname]))
        if isinstance(found.loader, SourceFileLoader):
            found.loader = _PackageLoader(fullname, found.loader.path)
        return found


class _Moved(Loader):
    """Loads the module at the new path in place of the one that was asked for."""

    def __init__(self, old: str, new: str) -> None:
        self._old = old
        self._new = new

    def exec_module(self, module: ModuleType) -> None:
        """Puts the moved module under its old name, too."""
        if self._old in SPLIT:
            module.__dict__["__getattr__"] = _names_of(self._old)
            return
        _warn(self._old, self._new)
        sys.modules[self._old] = importlib.import_module(self._new)


class _PackageLoader(SourceFileLoader):
    """Loads a package that has the name of an old module, and lets it find that module's names."""

    def exec_module(self, module: ModuleType) -> None:
        """Runs the package's own code first."""
        super().exec_module(module)
        module.__dict__.setdefault("__getattr__", _names_of(module.__name__))


def _names_of(old: str) -> Callable[[str], Any]:
    """Makes the `__getattr__` of a module: it finds what the module at the old path had."""

    def find(name: str) -> Any:
        package = sys.modules[old]
        missing = AttributeError(f"module {old!r} has no attribute {name!r}")
        # A module of the package is no name of the old module: the import system finds it.
        if name.startswith("__") or PathFinder.find_spec(f"{old}.{name}", getattr(package, "__path__", [])):
            raise missing
        home, _, new_name = SPLIT.get(old, {}).get(name, f"{MOVED[old]}.{name}").rpartition(".")
        try:
            value = getattr(importlib.import_module(home), new_name)
        except AttributeError:
            raise missing from None
        _warn(f"{old}.{name}", f"{home}.{new_name}")
        return value

    return find


def _warn(old: str, new: str) -> None:
    warnings.warn(
        f"{old} is now {new}; the old path works up to version {_LAST_VERSION}", DeprecationWarning, stacklevel=3
    )
