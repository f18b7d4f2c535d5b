"""Description of an operation as data, with its deprecated uses; each resource's module has a list `OPERATIONS`."""

import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from . import errors
from .base import Shape
from .json_values import is_list, is_mapping

ErrorClass = type[errors.ServiceError]
Location = Literal["uri", "querystring"]

INVALID = errors.InvalidParameterException
EXISTS = errors.ResourceAlreadyExistsException
NOT_FOUND = errors.ResourceNotFoundException
MISMATCH = errors.IdempotentParameterMismatchException
LIMIT = errors.LimitExceededException
THROTTLED = errors.ThrottlingException
INTERNAL = errors.InternalServerException
UNAVAILABLE = errors.ServiceUnavailableException
CONCURRENT = errors.ConcurrentDeploymentException

LIST_ERRORS: tuple[ErrorClass, ...] = (INVALID, THROTTLED, INTERNAL)
READ_ERRORS: tuple[ErrorClass, ...] = (INVALID, NOT_FOUND, THROTTLED, INTERNAL)
CREATE_APPLICATION_ERRORS: tuple[ErrorClass, ...] = (INVALID, EXISTS, LIMIT, THROTTLED, INTERNAL, MISMATCH)
CREATE_VERSION_ERRORS: tuple[ErrorClass, ...] = (INVALID, MISMATCH, LIMIT, THROTTLED, INTERNAL)
UPDATE_APPLICATION_ERRORS: tuple[ErrorClass, ...] = (INVALID, NOT_FOUND, LIMIT, THROTTLED, INTERNAL)
DELETE_APPLICATION_ERRORS: tuple[ErrorClass, ...] = (INVALID, THROTTLED, INTERNAL)
CREATE_EXPORT_ERRORS: tuple[ErrorClass, ...] = (NOT_FOUND, INVALID, INTERNAL, THROTTLED, MISMATCH, UNAVAILABLE)

READS = ("Describe", "List", "Get", "BatchDescribe")
"""Prefixes of operations that change nothing."""

CHANGES = ("BatchDelete", "Cancel", "Delete", "Deregister", "Tag", "Untag", "Update")
"""Prefixes of operations that change or delete what is there."""


@dataclass(frozen=True)
class OperationShape:
    """Description of one operation of the service: request, response, errors and HTTP path."""

    request: type[Shape]
    """Class of the request, named after the operation: `DescribeWorldRequest`; `DescribeWorldResponse` is in the same
    module.
    """

    errors: tuple[ErrorClass, ...]
    """Errors that the operation may raise."""

    description: str
    """Description of the operation, in one line."""

    is_job: bool = False
    """Whether the operation starts a job that continues after the response."""

    method: str = "POST"
    """HTTP method of the operation's requests."""

    uri: str | None = None
    """HTTP path, with members in braces, if it differs from the operation's name."""

    locations: Mapping[str, Location] = field(default_factory=dict[str, Location])
    """Members of the request that are in the path or the query, not in the body."""

    deprecated: bool = False
    """Whether the last API model of AWS marked the operation as deprecated."""

    @property
    def name(self) -> str:
        """The service's name of the operation, such as `CreateSimulationJob`."""
        return self.request.__name__.removesuffix("Request")

    @property
    def response(self) -> type[Shape]:
        """Model of the operation's response."""
        return getattr(sys.modules[self.request.__module__], f"{self.name}Response")

    @property
    def result_key(self) -> str | None:
        """Name of the response member with a page's entries, for list operations; `None` for others."""
        members = self.response.model_fields
        return next(name for name in members if name != "nextToken") if "nextToken" in members else None

    @property
    def final_name(self) -> str:
        """Name of the operation whose response a step finally returns: the one that describes a job, else this one."""
        return re.sub("^(Create|Start|Sync)", "Describe", self.name) if self.is_job else self.name

    @property
    def path(self) -> str:
        """HTTP path of the operation."""
        return self.uri or "/" + self.name[0].lower() + self.name[1:]


def deprecated(*shapes: OperationShape) -> tuple[OperationShape, ...]:
    """Returns the given operations marked as deprecated, as in the service's last API model."""
    return tuple(replace(shape, deprecated=True) for shape in shapes)


_REFUSED_MEMBERS: Mapping[str, str] = {
    "sources": "applications come as `environment`",
    "worldConfigs": "export the world, and give the archive as a data source",
    "useDefaultTools": "list the tools in `tools`",
    "useDefaultUploadConfigurations": "list what is kept in `uploadConfigurations`",
    "recordAllRosTopics": "record inside the application",
}
"""Members that AWS rejected in its last years if they requested something, each with its replacement."""

_ONLY_NAMES: Mapping[str, str] = {"robotSoftwareSuite": "General", "simulationSoftwareSuite": "SimulationRuntime"}
"""Software suites, each with the only name that AWS accepted in its last years."""

# Their keys, or all that is in them, belong to the caller.
_FREE_MEMBERS = frozenset({"tags", "worldTags", "environmentVariables", "templateBody"})


def deprecated_uses(shape: OperationShape, request: Mapping[str, Any]) -> list[str]:
    """Describes the deprecated features that a request uses: AWS RoboMaker refused them in its last years.

    A deprecated member that has no effect, such as an empty list or `false`, is not one of them.

    Args:
        shape: Operation.
        request: Members of the request.

    Returns:
        One text for each deprecated feature, with the path of its member; empty if the request uses none.
    """
    if shape.deprecated:
        return [f"{shape.name}: the service ended fleets, robots and deployments"]
    return list(_uses(request, ""))


def _uses(value: object, place: str) -> Iterator[str]:
    """Yields the deprecated uses inside a value, each with its path in the request."""
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
