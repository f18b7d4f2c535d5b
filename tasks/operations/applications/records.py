"""Operations and records that robot applications and simulation applications share; versions are in `versions`."""

import uuid
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from ....schemas.documents.applications import ApplicationDocument
from ....schemas.operations.applications import ApplicationListRequest
from ....schemas.runs.plan import ApplicationRole
from ....schemas.specs.model import CheckedStep
from ....schemas.wire.arns import ResourceArn, application_arn
from ....schemas.wire.errors import InvalidParameterException, ResourceAlreadyExistsException, ResourceNotFoundException
from ...catalog import Page, Resource, Stored
from ...service.builtin_applications import is_builtin
from ...service.service import Service
from ...simulations.planning.applications import (
    LATEST,
    check_environment,
    find_application,
    image_digest,
    version_arn,
    version_kind,
    with_etag,
)
from ..pages import page_of

_CONTENT = ("sources", "robotSoftwareSuite", "simulationSoftwareSuite", "renderingEngine", "environment")


def create_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """Stores an application and returns the members of the response.

    Args:
        role: which kind of application.
        request: the request's members.
        service: where it is stored.

    Raises:
        ResourceAlreadyExistsException: the name is taken.
        InvalidParameterException: a source cannot be read, or the environment is none.
    """
    definition = _definition(request, service)
    settings, now, kind = service.settings, service.clock(), f"{role}-application"
    arn = application_arn(settings.region, settings.account, kind, request["name"], now)
    resource = service.catalog.create(
        Resource.new(
            arn=arn,
            kind=kind,
            id=arn.split("-application/")[1],
            name=request["name"],
            status="Active",
            tags=request.get("tags") or {},
            document=definition,
        ),
        token=None,
        unique_name=True,
    )
    return _tagged(resource)


def describe_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """The members that describe an application, or a version of it.

    Raises:
        ResourceNotFoundException: there is no such application, or version.
    """
    version = request.get("applicationVersion")
    resource = find_application(request["application"], role, version, service)
    return {**_tagged(resource), "imageDigest": ApplicationDocument.of(resource).image_digest}


def list_applications(
    role: ApplicationRole, request: ApplicationListRequest, service: Service
) -> tuple[list[dict[str, Any]], str | None]:
    """A page of applications, newest first, and the token of the next; built-in ones only where the filter names them.

    Raises:
        InvalidParameterException: a filter is not known, or the token is not of this list.
    """
    kind = f"{role}-application"
    kinds = (kind, version_kind(kind)) if request.versionQualifier else (kind,)
    page: Page = page_of(request, kinds, service, "name")
    members = ("name", "arn", "version", "lastUpdatedAt", "robotSoftwareSuite", "simulationSoftwareSuite")
    # Clients count: with the service, a fresh account had no applications.
    described = [revision(each) for each in page.resources if request.filters or not is_builtin(each)]
    return [{key: each[key] for key in members if key in each} for each in described], page.next_token


def change_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """Makes an application what a request says, and returns the members of the response.

    Raises:
        ResourceNotFoundException: there is no such application.
        InvalidParameterException: it is built in, or has another revision by now; or a source cannot
            be read, or the environment is none.
    """
    application = find_application(request["application"], role, None, service)
    if is_builtin(application):
        raise InvalidParameterException(f"{application.arn} is built in and stays as it is; make one of another name")
    definition = _definition(request, service)
    return revision(_replace(application.arn, definition, request.get("currentRevisionId"), service))


def delete_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> None:
    """Removes an application with all its versions, or one version; of no effect on what is not there.

    Raises:
        InvalidParameterException: it is built in, or `$LATEST` alone is to be removed; or the ARN is none.
    """
    reference, version = request["application"], request.get("applicationVersion")
    if reference.startswith("arn:"):
        ResourceArn.parse(reference, "robot-application" if role == "robot" else "simulation-application")
    if version == LATEST:
        raise InvalidParameterException(
            f"applicationVersion: {LATEST} cannot be deleted alone; leave applicationVersion out to delete the "
            "application with all its versions"
        )
    with suppress(ResourceNotFoundException):
        application = find_application(reference, role, None, service)
        if version is not None:
            service.catalog.delete(version_arn(application.arn, version))
        elif is_builtin(application):
            raise InvalidParameterException(f"{application.arn} is built in and cannot be deleted")
        else:
            service.catalog.delete(application.arn, children=(version_kind(application.kind),))


def revision(resource: Resource) -> dict[str, Any]:
    """The members of a response that say what an application, or a version of it, is."""
    document = ApplicationDocument.of(resource)
    content = document.to_json()
    return {
        "arn": resource.parent or resource.arn,
        "name": resource.name,
        "version": document.version,
        "revisionId": document.revision_id,
        "lastUpdatedAt": resource.updated_at,
        **{member: content[member] for member in _CONTENT if member in content},
    }


def check_revision(wanted: str | None, document: ApplicationDocument) -> None:
    """Checks that an application still has the revision that a request is about.

    Raises:
        InvalidParameterException: it has another; says which.
    """
    if wanted is not None and wanted != document.revision_id:
        raise InvalidParameterException(
            f"currentRevisionId: the application has another revision than {wanted!r} by now, "
            f"{document.revision_id!r}; describe it, and repeat the call with that one if it is what you mean"
        )


def reuse_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any] | None:
    """The members of the response for an application that exists with the same definition.

    Returns:
        `None` when the name is free.

    Raises:
        ResourceAlreadyExistsException: the name is taken by an application that differs; says in what.
    """
    resource = service.catalog.find(f"{role}-application", request["name"])
    if resource is None:
        return None
    wanted, existing = _definition(request, service).to_json(), ApplicationDocument.of(resource).to_json()
    differing = [member for member in sorted(_CONTENT) if wanted.get(member) != existing.get(member)]
    if differing:
        raise ResourceAlreadyExistsException(
            f"{resource.arn} exists and differs in {', '.join(differing)}; give the new one another name, "
            "or say ifExists: update"
        )
    return _tagged(resource)


def update_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any] | None:
    """Makes an application that exists what a request to create it says, with its archives as they are now.

    Returns:
        The members of the response; `None` when the name is free.

    Raises:
        InvalidParameterException: a source cannot be read, or the environment is none.
        ResourceAlreadyExistsException: the application is a built-in one.
    """
    resource = service.catalog.find(f"{role}-application", request["name"])
    if resource is None:
        return None
    if is_builtin(resource):
        raise ResourceAlreadyExistsException(f"{resource.arn} is built in and stays as it is; choose another name")
    updated = _replace(resource.arn, _definition(request, service), None, service)
    if tags := request.get("tags"):
        updated = service.catalog.set_tags(resource.arn, tags)
    return _tagged(updated)


def existing_application(step: CheckedStep, request: Mapping[str, Any], service: Service) -> dict[str, Any] | None:
    """The answer of a step's application that exists already; `None` where there is none, or the step makes it anew."""
    role = "robot" if step.operation == "CreateRobotApplication" else "simulation"
    if step.if_exists == "update":
        return update_application(role, request, service)
    return reuse_application(role, request, service) if step.if_exists == "reuse" else None


def _definition(request: Mapping[str, Any], service: Service) -> ApplicationDocument:
    """Returns an application's definition as a new revision; archives with the ETags they have now."""
    definition = {member: request[member] for member in _CONTENT if request.get(member) is not None}
    if sources := definition.pop("sources", None):
        definition["sources"] = [with_etag(source, index, service) for index, source in enumerate(sources)]
        definition.pop("environment", None)  # an empty one: requests give one of the two
    else:
        uri = definition["environment"]["uri"]
        check_environment(uri)
        if digest := image_digest(uri):
            definition["imageDigest"] = digest
    revision_id = str(uuid.UUID(int=service.chance.getrandbits(128)))
    return ApplicationDocument.model_validate({**definition, "version": LATEST, "revisionId": revision_id})


def _replace(arn: str, definition: ApplicationDocument, wanted: str | None, service: Service) -> Resource:
    def changes(stored: Stored) -> ApplicationDocument:
        document = ApplicationDocument.model_validate(stored)
        check_revision(wanted, document)
        if document.last_number is None:
            return definition
        return definition.model_copy(update={"last_number": document.last_number})  # versions are counted on

    return service.catalog.update(arn, changes)


def _tagged(resource: Resource) -> dict[str, Any]:
    return {**revision(resource), "tags": dict(resource.tags)}
