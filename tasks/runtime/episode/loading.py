"""Import of the factory functions of applications."""

import importlib
import pkgutil
import sys
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import Any

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.requirement_kinds.kind import Rule


class LoadError(Exception):
    """Raised when a factory function cannot be imported; the text names the missing module or attribute."""


def add_to_import_path(path: Path) -> None:
    """Puts the folder of an unpacked bundle at the beginning of the import path, before installed packages.

    Raises:
        LoadError: The folder does not exist.
    """
    if not path.is_dir():
        raise LoadError(f"the application's folder {path} does not exist")
    if str(path) not in sys.path:
        sys.path.insert(0, str(path))
    importlib.invalidate_caches()


def load_factory(attribute: str, path: Path | None = None) -> Callable[..., Any]:
    """Imports the factory function of an application by its dotted path.

    Puts the bundle's folder on the import path.

    Args:
        attribute: Dotted path, `package.module.make_environment`.
        path: The bundle's folder that must contain the package; None for an installed package.

    Returns:
        The callable.

    Raises:
        LoadError: Package, module or attribute is missing, is not callable, comes from elsewhere than
            the bundle, or importing it failed. The cause of a failed import is chained.
    """
    parts = attribute.split(".")
    if len(parts) < 2 or not all(part.isidentifier() for part in parts):
        raise LoadError(f"{attribute!r} is not a dotted path like `package.module.make_environment`")
    if path is not None:
        add_to_import_path(path)
    module, rest = _import_longest(parts, path)
    if path is not None:
        _check_origin(module, path)
    value: Any = module
    where = module.__name__
    for name in rest:
        if not hasattr(value, name):
            raise LoadError(missing_attribute(attribute, where, name, _names_in(value)))
        value = getattr(value, name)
        where = f"{where}.{name}"
    if not callable(value):
        raise LoadError(f"{attribute} is a {type(value).__name__}, not a function")
    return value


def load_judging_function(plan: RunPlan, rule: Rule[Any], attribute: str) -> Callable[..., Any]:
    """Imports and returns a predicate function of a requirement, from an application's bundle or an installed package.

    Args:
        plan: Plan of the run, with its applications.
        rule: Rule of the requirement that names the function.
        attribute: Dotted path of the function, `package.module.function`.

    Raises:
        RequirementError: The function does not exist.
    """
    package = attribute.partition(".")[0]
    applications = (plan.simulation_application, plan.robot_application)
    paths = [each.path for each in applications if each is not None and each.path is not None]
    path = next((path for path in paths if (path / package).is_dir() or (path / f"{package}.py").is_file()), None)
    try:
        return load_factory(attribute, path)
    except LoadError as error:
        raise rule.cannot(str(error)) from error


def _import_longest(parts: list[str], path: Path | None) -> tuple[ModuleType, list[str]]:
    """Imports the longest leading part of a dotted path that is a module; returns it and the remaining names.

    At least one name remains. Raises `LoadError` if the package is missing or its import fails.
    """
    module: ModuleType | None = None
    for count in range(1, len(parts)):
        name = ".".join(parts[:count])
        try:
            module = importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name != name:
                raise LoadError(f"importing {name} failed: {error}") from error
            if module is None:
                raise LoadError(missing_package(".".join(parts), name, path)) from None
            return module, parts[count - 1 :]
        except Exception as error:
            raise LoadError(f"importing {name} failed: {type(error).__name__}: {error}") from error
    assert module is not None
    return module, parts[-1:]


def missing_package(attribute: str, name: str, path: Path | None) -> str:
    """Says that a package does not exist, and which ones a bundle has.

    Args:
        attribute: Dotted path of the function.
        name: Name of the package.
        path: Folder of the bundle; None: the package has to be installed.
    """
    if path is None:
        mend = "install it, or name its folder in PYTHONPATH"
        return f"there is no installed package {name} (needed for {attribute}); {mend}"
    there = [module.name for module in pkgutil.iter_modules([str(path)])]
    found = _list(there) if there else "no Python package at all"
    return f"the bundle has no package {name} (needed for {attribute}){_near(name, there)}; it contains {found}"


def _names_in(value: Any) -> Iterable[str]:
    """Returns the names that an object has, of a package also those of its modules."""
    path = value.__path__ if isinstance(value, ModuleType) and hasattr(value, "__path__") else ()
    return [*dir(value), *(module.name for module in pkgutil.iter_modules(path))]


def missing_attribute(attribute: str, where: str, name: str, names: Iterable[str]) -> str:
    """Says that a module, or something in it, lacks a name, and which names it has.

    Args:
        attribute: Dotted path of the function.
        where: Dotted path of what lacks the name.
        name: Name that is missing.
        names: Names that are there.
    """
    there = sorted({found for found in names if not found.startswith("_")})
    listed = f"; it has {_list(there)}" if there else ""
    return f"{where} has no {name} (needed for {attribute}){_near(name, there)}{listed}"


def _near(name: str, there: Iterable[str]) -> str:
    near = get_close_matches(name, list(there), n=2)
    return f", did you mean {' or '.join(near)}?" if near else ""


def _list(names: list[str]) -> str:
    shown = ", ".join(names[:8])
    return f"{shown} and {len(names) - 8} more" if len(names) > 8 else shown


def _check_origin(module: ModuleType, path: Path) -> None:
    """Raises `LoadError` if a module was not imported from the given bundle: bundles and packages may share names."""
    origins = [module.__file__] if module.__file__ else list(getattr(module, "__path__", []))
    if not any(Path(origin).resolve().is_relative_to(path.resolve()) for origin in origins):
        top = module.__name__.partition(".")[0]
        raise LoadError(
            f"{module.__name__} was imported from {', '.join(map(str, origins))}, not from the bundle: another"
            f" application or an installed package has the name {top} too; rename the bundle's package"
        )
