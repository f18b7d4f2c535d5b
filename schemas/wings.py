"""Wings: optional extensions of the program, such as fleets, which no other code imports.

A wing has a package of its name in `schemas`, `tasks` and `deployments`. Each registry calls this module for the
entries that wings add: those in the wing's module with the registry's name. `docs/adding.md` lists the registries.
"""

import importlib
from functools import cache
from importlib.util import find_spec
from itertools import accumulate
from types import ModuleType

WINGS = ("fleet",)
"""Names of all wings, in the order in which registries add their entries."""

_PRODUCT = __name__.rpartition(".schemas.")[0]


@cache
def parts_of_wings(layer: str, registry: str) -> tuple[ModuleType, ...]:
    """Imports the modules that optional extensions ("wings", such as fleets) add to a registry.

    Args:
        layer: `schemas`, `tasks` or `deployments`.
        registry: Name of the module in the wing's package, such as `documents`.

    Raises:
        ImportError: The module exists, but an import in it fails.
    """
    names = (f"{_PRODUCT}.{layer}.{wing}" for wing in WINGS)
    return tuple(importlib.import_module(f"{name}.{registry}") for name in names if _is_there(name, registry))


def _is_there(package: str, registry: str) -> bool:
    names = accumulate(registry.split("."), "{}.{}".format, initial=package)
    return all(find_spec(name) is not None for name in names)  # in this order: looking for one imports those before it
