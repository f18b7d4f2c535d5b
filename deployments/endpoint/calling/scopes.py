"""Rights of access keys, and calling operations within them, with audit log and notice to the job worker."""

import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import Any

from ....schemas.wire.arns import ResourceArn
from ....schemas.wire.base import Shape
from ....schemas.wire.errors import InternalServerException, InvalidParameterException
from ....schemas.wire.operation_shape import READS, OperationShape
from ....tasks.catalog import Catalog, Resource, tokens_of
from ....tasks.operations.registry import Operation, registry
from ....tasks.service.service import Service, is_builtin
from ..protocol_errors import AccessDeniedException
from .access_keys import SCOPES, AccessKey, Scope
from .audit_log import AuditLog, Call

_SUBMITTED = frozenset(
    {
        "CreateSimulationJob",
        "RestartSimulationJob",
        "CancelSimulationJob",
        "StartSimulationJobBatch",
        "CancelSimulationJobBatch",
        "CreateWorldGenerationJob",
        "CancelWorldGenerationJob",
        "CreateWorldExportJob",
        "CancelWorldExportJob",
        "VaryWorlds",  # a step of specifications
    }
)
_APPLICATION_KINDS = ("robot-application", "simulation-application")
_FREE_TEXT = frozenset({"tags", "worldTags", "environmentVariables", "templateBody"})
"""Members whose value is free text, so that an ARN in it names no resource of the request."""


def needed_scope(operation: str) -> Scope:
    """Returns the least scope of an access key that an operation requires."""
    if operation.startswith(READS):
        return "read"
    return "submit" if operation in _SUBMITTED else "administer"


def check_scope(key: AccessKey, operation: str) -> None:
    """Raises an error if an access key's scope does not include an operation.

    Raises:
        AccessDeniedException: The key's scope does not include the operation.
    """
    needed = needed_scope(operation)
    if SCOPES.index(key.scope) < SCOPES.index(needed):
        raise AccessDeniedException(
            f"{operation} needs an access key with robomaker_scope = {needed}; this one has {key.scope}"
        )


def check_resources(key: AccessKey, shape: OperationShape, request: Mapping[str, Any], catalog: Catalog) -> None:
    """Raises an error if a request concerns resources that an access key does not permit.

    Args:
        key: The caller's.
        shape: The operation.
        request: The members of its request, which have been checked.
        catalog: The catalog of the resources.

    Raises:
        AccessDeniedException: The key does not permit a resource; the message is the same whether or not the resource
            exists.
    """
    if not key.is_confined:
        return
    named = list(named_resources(request))
    check_named(key, named, catalog)
    if "tags" in shape.request.model_fields and shape.name != "TagResource":
        _check_made(key, request.get("name"), request, "")
        for index, each in enumerate(request.get("createSimulationJobRequests") or []):
            _check_made(key, None, each, f"createSimulationJobRequests[{index}].")
    elif "name" in request:  # what exists gets another name
        tags = {tag: value for each in catalog.get_many(named).values() for tag, value in each.tags.items()}
        _check_made(key, request["name"], {"tags": tags}, "")


def check_named(key: AccessKey, named: Collection[str], catalog: Catalog) -> None:
    """Raises an error if a request names resources that a confined access key may not use, by their names and tags.

    Raises:
        AccessDeniedException: A resource is not among those of the key; the message is the same whether or not the
            resource exists.
    """
    allowed = _allowed(key, (each for each in named if each.startswith("arn:")), catalog)
    for each in named:
        if each not in allowed and not (not each.startswith("arn:") and _may_use(key, each, catalog)):
            raise AccessDeniedException(f"{each!r} is not among the resources of this access key")


def only_visible(key: AccessKey, shape: OperationShape, answer: dict[str, Any], catalog: Catalog) -> dict[str, Any]:
    """Removes entries from a list response that an access key may not see."""
    if not key.is_confined or shape.result_key is None:
        return answer
    entries = answer.get(shape.result_key) or []
    allowed = _allowed(key, (entry["arn"] for entry in entries), catalog)
    return {**answer, shape.result_key: [entry for entry in entries if entry["arn"] in allowed]}


def is_visible(key: AccessKey, resource: Resource, catalog: Catalog) -> bool:
    """Whether an access key may see a resource: by name or tags, if built in, or as a world of a visible job."""
    return not key.is_confined or _is_open(key, resource) or _goes_with_its_job(key, resource, catalog)


def named_resources(request: Any, member: str = "") -> Iterator[str]:
    """Yields the resources (ARNs, application names) that a request names at any depth, but not those in free text."""
    if isinstance(request, Mapping):
        for name, value in request.items():
            if name not in _FREE_TEXT:
                yield from named_resources(value, name)
    elif isinstance(request, list):
        for value in request:
            yield from named_resources(value, member)
    elif isinstance(request, str) and (member == "application" or _is_arn(request)):
        yield request


def _is_arn(text: str) -> bool:
    if not text.startswith("arn:"):
        return False
    try:
        ResourceArn.parse(text)
    except InvalidParameterException:
        return False
    return True


def _check_made(key: AccessKey, name: str | None, request: Mapping[str, Any], place: str) -> None:
    if key.permits(name, request.get("tags") or {}):
        return
    ways = [f"a tag that begins with {' or '.join(key.tags)}"] if key.tags else []
    if name is not None and key.names:
        ways.append(f"a name that begins with {' or '.join(key.names)}")
    wanted = " or ".join(ways) or "a tag, but the key has no robomaker_tags"
    raise AccessDeniedException(f"{place}tags: what this access key makes has to have {wanted}")


def _may_use(key: AccessKey, name: str, catalog: Catalog) -> bool:
    """Whether all applications of a name are permitted by the key, or built in."""
    found = [each for kind in _APPLICATION_KINDS if (each := catalog.find(kind, name)) is not None]
    return bool(found) and all(_is_open(key, each) for each in found)


def _allowed(key: AccessKey, arns: Iterable[str], catalog: Catalog) -> set[str]:
    found = catalog.get_many(set(arns))
    # Worlds that have no tags of their own go with the job that generated them.
    parents = catalog.get_many({each.parent for each in found.values() if each.kind == "world" and each.parent})
    return {
        arn
        for arn, each in found.items()
        if _is_open(key, each) or (each.parent in parents and _is_open(key, parents[each.parent]))
    }


def _goes_with_its_job(key: AccessKey, resource: Resource, catalog: Catalog) -> bool:
    if resource.kind != "world" or not resource.parent:
        return False
    parent = catalog.get_many([resource.parent]).get(resource.parent)
    return parent is not None and _is_open(key, parent)


def _is_open(key: AccessKey, resource: Resource) -> bool:
    named = resource.name if resource.name != resource.id else None
    return (resource.kind in _APPLICATION_KINDS and is_builtin(resource)) or key.permits(named, resource.tags)


LOGGER = logging.getLogger("robomaker.endpoint")


class Calls:
    """Makes API calls with authorisation and audit log.

    Args:
        service: The service, with its catalog and object store.
        on_submitted: Called with the ARN of every stored job.
        audit_log: Records every call, also refused ones; `None`: calls are not recorded.
    """

    def __init__(
        self, service: Service, on_submitted: Callable[[str], None], audit_log: AuditLog | None = None
    ) -> None:
        self._service = service
        self._on_submitted = on_submitted
        self._audit_log = audit_log

    def make(self, name: str, members: Mapping[str, Any], call: Call) -> dict[str, Any]:
        """Calls an API operation for an authenticated caller, and logs it.

        Args:
            name: The operation.
            members: Members of the request.
            call: Record of the call, with the caller; the operation and its outcome are added.

        Raises:
            AccessDeniedException: The caller's access key is not good for it.
            ServiceError: The request is refused.
        """
        operation = registry()[name]
        call.operation = name
        try:
            if call.key is not None:
                check_scope(call.key, name)
            return self.answer(operation, operation.checked(members, self._service), call)
        except Exception as error:
            call.outcome = getattr(error, "code", InternalServerException.__name__)
            raise
        finally:
            self.write(call)

    def answer(self, operation: Operation, checked: Shape, call: Call) -> dict[str, Any]:
        """Carries out a checked request whose scope was checked, after checking its resources.

        Raises:
            AccessDeniedException: The request names what the caller's access key is not good for.
            ServiceError: The request is refused.
        """
        shape, key, catalog = operation.shape, call.key, self._service.catalog
        if key is not None or self._audit_log is not None:
            wire = checked.to_wire()
            call.resources = list(named_resources(wire))
            if key is not None:
                check_resources(key, shape, wire, catalog)
        with tokens_of(key.id if key is not None else call.job or ""):
            answer = operation.handle(checked, self._service)
        call.resources = [*filter(None, [answer.get("arn")]), *call.resources]
        if shape.is_job:
            self._tell(answer["arn"], call.request_id)
        return answer if key is None else only_visible(key, shape, answer, catalog)

    def write(self, call: Call) -> None:
        """Appends a call to the audit log, if there is one."""
        if self._audit_log is not None:
            self._audit_log.write(call)

    def _tell(self, arn: str, request_id: str) -> None:
        try:
            self._on_submitted(arn)
        except Exception:
            # The job is stored, and a job worker finds it in the catalog later.
            LOGGER.exception("no job worker could be told of %s (request %s)", arn, request_id)
