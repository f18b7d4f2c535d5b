"""Finds kinds by being there: the modules of a folder, and those that installed distributions bring."""

from importlib import import_module
from importlib.metadata import entry_points
from pkgutil import iter_modules
from types import ModuleType

from .wire.errors import ConfigurationError


def modules_of(package: str, kind: str) -> list[ModuleType]:
    """Imports all modules of a kind, those of this package first.

    Args:
        package: Name of the package whose modules are kinds; other folders may be added to its `__path__`.
        kind: Word for the kind, `requirements`. A distribution names a module or a package of its own with an entry
            point of the group `prefect_robomaker.requirements`.

    Raises:
        ConfigurationError: A distribution's module cannot be imported. It is not left out: a process without a kind
            that others have would refuse, or not show, what they have stored.
    """
    found, group = _modules(package), f"prefect_robomaker.{kind}"
    for entry in sorted(entry_points(group=group)):
        try:
            found += _modules(entry.value)
        except Exception as error:
            raise ConfigurationError(
                f"{entry.value}, which an installed distribution names in {group}, cannot be imported: {error}"
            ) from error
    return found


def _modules(name: str) -> list[ModuleType]:
    found = import_module(name)
    if not hasattr(found, "__path__"):
        return [found]
    return [import_module(f"{name}.{each.name}") for each in iter_modules(found.__path__)]
