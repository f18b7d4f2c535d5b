"""Wings: parts of the product that nothing else imports, and that may be left out, as fleets are.

A wing has a package of its name in `schemas`, `tasks` and `deployments`. Each registry asks here for what wings add to
it: the module of the registry's name in the wing's package. `docs/adding.md` lists the registries.
"""

import importlib
from functools import cache
from importlib.util import find_spec
from itertools import accumulate
from types import ModuleType

WINGS = ("fleet",)
"""Names of the wings there may be, in the order in which registries take them."""

_PRODUCT = __name__.rpartition(".schemas.")[0]


@cache
def parts_of_wings(layer: str, registry: str) -> tuple[ModuleType, ...]:
    """Imports the modules that optional parts of the program ("wings", such as fleets) add to a registry.

    Args:
        layer: `schemas`, `tasks` or `deployments`.
        registry: the module's name in the wing's package, such as `documents`.

    Raises:
        ImportError: the module is there, and something that it imports is not.
    """
    names = (f"{_PRODUCT}.{layer}.{wing}" for wing in WINGS)
    return tuple(importlib.import_module(f"{name}.{registry}") for name in names if _is_there(name, registry))


def _is_there(package: str, registry: str) -> bool:
    names = accumulate(registry.split("."), "{}.{}".format, initial=package)
    return all(find_spec(name) is not None for name in names)  # in this order: looking for one imports those before it
