"""Checks whether an access key permits everything a specification does: before it runs, and at each step."""

import uuid
from collections.abc import Callable
from typing import Any

from ...schemas.specs.resolving import resolve_input
from ...schemas.specs.specification import CheckedSpec, CheckedStep
from ...schemas.specs.yaml_nodes import plain
from ...schemas.wire.errors import InternalServerException, Problem
from ...tasks.catalog import Catalog
from ...tasks.operations.step_operations import step_registry
from ...tasks.service.service import Service
from ..endpoint.calling.access_keys import AccessKey
from ..endpoint.calling.audit_log import AuditLog, Call
from ..endpoint.calling.scopes import check_named, check_resources, check_scope, named_resources, only_visible
from ..endpoint.protocol_errors import AccessDeniedException

_REFERENCE = "${{"


def problems_of_rights(key: AccessKey | None, spec: CheckedSpec, catalog: Catalog) -> list[Problem]:
    """Lists the rights that a visitor's access key lacks for running a specification.

    Args:
        key: The visitor's access key; `None`: no access key is required.
        spec: The specification.
        catalog: The catalog of the resources.

    Raises:
        SpecError: The request of a step, which is made to find its resources, is invalid.
    """
    if key is None:
        return []
    made = {str(plain(step.input).get("name")) for step in spec.steps.values() if "Application" in step.operation}
    problems: list[Problem] = []
    for step in spec.steps.values():
        try:
            check_scope(key, step.operation)
            if key.is_confined:
                if step.worlds:  # a name that is near is none of its business, and would be told
                    name = step.worlds[0].name
                    raise AccessDeniedException(f"this access key may name worlds by ARNs only, and {name!r} is none")
                _check_written(key, step, made, catalog)
        except AccessDeniedException as error:
            problems.append(Problem(step.place, f"steps.{step.name}", str(error)))
    return problems


def _check_written(key: AccessKey, step: CheckedStep, made: set[str], catalog: Catalog) -> None:
    """Checks that a key may use the resources that a step names, and its whole request if that needs no other step.

    Raises an error of the key's rights if it may not.
    """
    request = plain(step.input) if step.needs else resolve_input(step, {})
    named = [each for each in named_resources(request) if _REFERENCE not in each and each not in made]
    check_named(key, named, catalog)
    if not step.needs and not made.intersection(named_resources(request)):
        check_resources(key, step_registry()[step.operation].shape, request, catalog)


class Permits:
    """Checks for each step of an ordered run whether its visitor has the right, and logs it.

    Args:
        key: The visitor's access key; `None`: no access key is required.
        address: IP address of the visitor.
        audit_log: Records every step, also refused ones; `None`: steps are not recorded.
        service: The service, with its catalog and object store.
    """

    def __init__(self, key: AccessKey | None, address: str | None, audit_log: AuditLog | None, service: Service):
        self._key = key
        self._address = address
        self._audit_log = audit_log
        self._service = service

    def __call__(
        self, step: CheckedStep, request: dict[str, Any], carry_out: Callable[[], dict[str, Any]]
    ) -> dict[str, Any]:
        """Carries out a step's request.

        Raises:
            AccessDeniedException: The key is not good for it.
            ServiceError: The request is refused.
        """
        call = Call(str(uuid.uuid4()), self._address, self._key, step.operation)
        try:
            call.resources = list(named_resources(request))
            self._check(step, request)
            answer = carry_out()
            call.resources = [*filter(None, [answer.get("arn")]), *call.resources]
        except Exception as error:
            call.outcome = getattr(error, "code", InternalServerException.__name__)
            raise
        finally:
            if self._audit_log is not None:
                self._audit_log.write(call)
        shape = step_registry()[step.operation].shape
        return answer if self._key is None else only_visible(self._key, shape, answer, self._service.catalog)

    def _check(self, step: CheckedStep, request: dict[str, Any]) -> None:
        key, catalog = self._key, self._service.catalog
        if key is None:
            return
        check_scope(key, step.operation)
        entry = step_registry()[step.operation]
        check_resources(key, entry.shape, entry.checked(request, self._service).to_wire(), catalog)
        # `ifExists` takes or changes what has the name already; a template is taken with its tags, which are the key's.
        if step.if_exists != "fail" and step.operation != "CreateWorldTemplate" and key.is_confined:
            kind = "robot-application" if step.operation == "CreateRobotApplication" else "simulation-application"
            found = catalog.find(kind, str(request.get("name")))
            if found is not None and not key.permits(found.name, found.tags):
                raise AccessDeniedException(f"{found.name!r} is not among the resources of this access key")
