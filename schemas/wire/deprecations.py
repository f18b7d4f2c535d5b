"""Deprecated uses: the service refused them in its last years, and this package accepts them unless told not to.

From the middle of 2022 the service took container images only, told apart no robot software any more, and
no longer ran fleets, worlds inside jobs, or tools and uploads of its own choice.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from .json_values import is_list, is_mapping
from .operation_shape import OperationShape

_REFUSED_MEMBERS: Mapping[str, str] = {
    "sources": "applications come as `environment`",
    "worldConfigs": "export the world, and give the archive as a data source",
    "useDefaultTools": "list the tools in `tools`",
    "useDefaultUploadConfigurations": "list what is kept in `uploadConfigurations`",
    "recordAllRosTopics": "record inside the application",
}
"""Members that were refused when they asked for something, and what there was instead."""

_ONLY_NAMES: Mapping[str, str] = {"robotSoftwareSuite": "General", "simulationSoftwareSuite": "SimulationRuntime"}
"""Software suites, and the only name of each that was left."""

# Their keys, or all that is in them, belong to the caller.
_FREE_MEMBERS = frozenset({"tags", "worldTags", "environmentVariables", "templateBody"})


def deprecated_uses(shape: OperationShape, request: Mapping[str, Any]) -> list[str]:
    """Lists the uses in a call that the service refused in its last years, in words; empty if none.

    A member that asks for nothing, such as an empty list or `false`, is not refused.

    Args:
        shape: the operation.
        request: the members of its request.
    """
    if shape.deprecated:
        return [f"{shape.name}: the service ended fleets, robots and deployments"]
    return list(_uses(request, ""))


def _uses(value: object, place: str) -> Iterator[str]:
    """The uses inside a value, each with its place in the request."""
    if is_list(value):
        for index, entry in enumerate(value):
            yield from _uses(entry, f"{place}[{index}]")
    if is_mapping(value):
        for member, inner in value.items():
            where = f"{place}.{member}" if place else str(member)
            yield from _uses_of_member(member, inner, where)


def _uses_of_member(member: str, value: Any, where: str) -> Iterator[str]:
    if member in _FREE_MEMBERS or value is None:
        return
    if member in _REFUSED_MEMBERS:
        if value:
            yield f"{where}: {_REFUSED_MEMBERS[member]}"
        return
    only = _ONLY_NAMES.get(member)
    if only is not None and value.get("name") not in (None, only):
        yield f"{where}.name: {value['name']!r} is no more; only {only!r} is left"
        return
    yield from _uses(value, where)
