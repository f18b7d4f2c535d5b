"""Discovery of plugin classes: in the modules of a package, and in installed distributions by entry points."""

from collections.abc import Callable, Iterable
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pkgutil import iter_modules
from types import ModuleType
from typing import TypeVar

from .wire.errors import ConfigurationError

_GROUPS = "prefect_robomaker."


def modules_of(package: str, kind: str) -> list[ModuleType]:
    """Imports all plugin modules of a kind (such as requirements or sensors), this package's own first.

    Args:
        package: Name of the package whose modules are plugins; other folders may be added to its `__path__`.
        kind: Kind of plugin, such as `requirements`. Distributions name a module or package with an entry point of the
            group `prefect_robomaker.requirements`.

    Raises:
        ConfigurationError: A distribution's module cannot be imported, or two have the same name. Such a module is not
            skipped, since a process without it would refuse stored requests of others.
    """
    found = _modules(package)
    for module in named(kind).values():
        try:
            found += _modules(module)
        except Exception as error:
            raise ConfigurationError(
                f"{module}, which an installed distribution names in prefect_robomaker.{kind}, cannot be imported: "
                f"{error}"
            ) from error
    return found


def named(kind: str) -> dict[str, str]:
    """Lists plugin modules that installed distributions register as entry points, by entry point name; imports none.

    Args:
        kind: Kind of plugin, as for `modules_of`.

    Raises:
        ConfigurationError: Two modules have the same name.
    """
    found, group = dict[str, str](), f"{_GROUPS}{kind}"
    for entry in sorted(each for each in _entry_points() if each.group == group):
        if found.setdefault(entry.name, entry.value) != entry.value:
            raise ConfigurationError(
                f"installed distributions name two modules {entry.name!r} in {group}, {found[entry.name]} and "
                f"{entry.value}; uninstall one of them"
            )
    return found


Kind = TypeVar("Kind")


def classes_of(
    base: type[Kind], package: str, kind: str, names: Callable[[type[Kind]], Iterable[str]]
) -> dict[str, type[Kind]]:
    """Finds the subclasses of a base class that plugin modules define, and returns them by name.

    Args:
        base: Base class.
        package: Name of the package with plugin modules, as for `modules_of`.
        kind: Kind of plugin, as for `modules_of`.
        names: Function that returns the names of a class; none for a class that is only a base class.

    Raises:
        ConfigurationError: Two classes have the same name, so that it would be unclear which one a request means.
    """
    found: dict[str, type[Kind]] = {}
    for module in modules_of(package, kind):
        for each in vars(module).values():
            if isinstance(each, type) and issubclass(each, base) and each.__module__ == module.__name__:
                for name in names(each):
                    if name in found:
                        raise ConfigurationError(f"{each.__module__} and {found[name].__module__} are both {name!r}")
                    found[name] = each
    return found


@cache
def _entry_points() -> list[EntryPoint]:
    """Finds the entry points of all kinds; once, as it reads a file of each distribution: 10 ms of CPU time."""
    found = entry_points()
    return [entry for group in found.groups if group.startswith(_GROUPS) for entry in found.select(group=group)]


def _modules(name: str) -> list[ModuleType]:
    found = import_module(name)
    if not hasattr(found, "__path__"):
        return [found]
    return [import_module(f"{name}.{each.name}") for each in iter_modules(found.__path__)]
