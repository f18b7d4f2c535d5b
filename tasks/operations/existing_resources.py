"""Steps whose resource exists already: `ifExists` says whether it is reused, updated, or refused."""

from collections.abc import Mapping
from typing import Any

from ...schemas.documents.applications import ApplicationDocument
from ...schemas.runs.plan import ApplicationRole
from ...schemas.specs.specification import CheckedStep
from ...schemas.wire.errors import ResourceAlreadyExistsException
from ..service.service import Service, is_builtin
from .applications import CONTENT, definition_of, described_with_tags, replace_definition


def reuse_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any] | None:
    """Returns the response for an application that exists already with the same definition.

    Returns:
        `None` when the name is free.

    Raises:
        ResourceAlreadyExistsException: The name is taken by an application that differs; says in what.
    """
    resource = service.catalog.find(f"{role}-application", request["name"])
    if resource is None:
        return None
    wanted, existing = definition_of(request, service).to_json(), ApplicationDocument.of(resource).to_json()
    differing = [member for member in sorted(CONTENT) if wanted.get(member) != existing.get(member)]
    if differing:
        raise ResourceAlreadyExistsException(
            f"{resource.arn} exists and differs in {', '.join(differing)}; give the new one another name, "
            "or say ifExists: update"
        )
    return described_with_tags(resource)


def update_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any] | None:
    """Updates an existing application to the values of a request to create it, with its current archives.

    Returns:
        The members of the response; `None` when the name is free.

    Raises:
        InvalidParameterException: A source cannot be read, or the environment is none.
        ResourceAlreadyExistsException: The application is a built-in one.
    """
    resource = service.catalog.find(f"{role}-application", request["name"])
    if resource is None:
        return None
    if is_builtin(resource):
        raise ResourceAlreadyExistsException(f"{resource.arn} is built in and stays as it is; choose another name")
    updated = replace_definition(resource.arn, definition_of(request, service), None, service)
    if tags := request.get("tags"):
        updated = service.catalog.set_tags(resource.arn, tags)
    return described_with_tags(updated)


def existing_application(step: CheckedStep, request: Mapping[str, Any], service: Service) -> dict[str, Any] | None:
    """Returns the response of a step whose application exists already, which is reused or updated as the step says.

    Returns `None` if the step has to create it.
    """
    role = "robot" if step.operation == "CreateRobotApplication" else "simulation"
    if step.if_exists == "update":
        return update_application(role, request, service)
    return reuse_application(role, request, service) if step.if_exists == "reuse" else None
