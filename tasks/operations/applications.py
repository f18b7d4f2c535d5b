"""Handlers of operations on robot and simulation applications, which differ only in their names."""

import uuid
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from ...schemas.documents.applications import ApplicationDocument, StoredSource
from ...schemas.documents.document_base import VERSION_KEY
from ...schemas.operations.applications import (
    ApplicationContent,
    ApplicationListRequest,
    ApplicationSelection,
    ApplicationUpdate,
    NewApplicationVersion,
)
from ...schemas.runs.plan import ApplicationRole
from ...schemas.wire.arns import ResourceArn, application_arn
from ...schemas.wire.errors import (
    InvalidParameterException,
    ResourceNotFoundException,
    ThrottlingException,
)
from ..catalog import NewResource, Page, Resource, Stored
from ..service.service import BUILTINS, Service, is_builtin
from ..simulations.planning.applications import (
    LATEST,
    MAX_VERSIONS,
    check_environment,
    find_application,
    image_digest,
    version_arn,
    version_kind,
    with_etag,
)
from .registry import Answer, operation, page_of

CONTENT = ("sources", "robotSoftwareSuite", "simulationSoftwareSuite", "renderingEngine", "environment")
"""Members of an application that make up its definition."""


def create_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """Stores a new robot or simulation application, and returns the members of the response.

    Args:
        role: Kind of application, robot or simulation.
        request: The request's members.
        service: The service, with its catalog and object store.

    Raises:
        ResourceAlreadyExistsException: The name is taken.
        InvalidParameterException: A source cannot be read, or the environment is none.
    """
    definition = definition_of(request, service)
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
    return described_with_tags(resource)


def describe_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """Returns the response members that describe an application, or a version of it.

    Raises:
        ResourceNotFoundException: The catalog has no such application or version.
    """
    version = request.get("applicationVersion")
    resource = find_application(request["application"], role, version, service)
    return {**described_with_tags(resource), "imageDigest": ApplicationDocument.of(resource).image_digest}


def list_applications(
    role: ApplicationRole, request: ApplicationListRequest, service: Service
) -> tuple[list[dict[str, Any]], str | None]:
    """Returns a page of applications, newest first, and the next page's token.

    Built-in applications are listed only if the request says so, or its filter names them.

    Raises:
        InvalidParameterException: A filter is not known, or the token is not of this list.
    """
    kind = f"{role}-application"
    kinds = (kind, version_kind(kind)) if request.versionQualifier else (kind,)
    # Clients count: with the service, a fresh account had no applications.
    built_in = [name for name, (kind_of_it, _) in BUILTINS.items() if kind_of_it == kind]
    without = {} if request.builtIn or request.filters else {kind: built_in}
    page: Page = page_of(request, kinds, service, "name", without=without)
    members = ("name", "arn", "version", "lastUpdatedAt", "robotSoftwareSuite", "simulationSoftwareSuite")
    described = map(revision, page.resources)
    return [{key: each[key] for key in members if key in each} for each in described], page.next_token


def change_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """Updates an application as a request says, and returns the members of the response.

    Raises:
        ResourceNotFoundException: The catalog has no such application.
        InvalidParameterException: The application is built in, or has another revision by now; or a source cannot
            be read, or the environment is none.
    """
    application = find_application(request["application"], role, None, service)
    if is_builtin(application):
        raise InvalidParameterException(f"{application.arn} is built in and stays as it is; make one of another name")
    definition = definition_of(request, service)
    return revision(replace_definition(application.arn, definition, request.get("currentRevisionId"), service))


def delete_application(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> None:
    """Deletes an application with all versions, or one version; does nothing if it does not exist.

    Raises:
        InvalidParameterException: The application is built in, only `$LATEST` is to be deleted, or the ARN is invalid.
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
    """Returns the response members that describe an application: its ARN, name, version, revision and content."""
    document = ApplicationDocument.of(resource)
    content = document.to_json()
    return {
        "arn": resource.parent or resource.arn,
        "name": resource.name,
        "version": document.version,
        "revisionId": document.revision_id,
        "lastUpdatedAt": resource.updated_at,
        **{member: content[member] for member in CONTENT if member in content},
    }


def check_revision(wanted: str | None, document: ApplicationDocument) -> None:
    """Checks that an application still has the revision id that a request expects; does nothing if it expects none.

    Raises:
        InvalidParameterException: The application has another revision id; the message names it.
    """
    if wanted is not None and wanted != document.revision_id:
        raise InvalidParameterException(
            f"currentRevisionId: the application has another revision than {wanted!r} by now, "
            f"{document.revision_id!r}; describe it, and repeat the call with that one if it is what you mean"
        )


def definition_of(request: Mapping[str, Any], service: Service) -> ApplicationDocument:
    """Makes an application's definition from a request, as a new revision; archives get their current ETags.

    Raises `InvalidParameterException` if an archive does not exist or the container image's URI is not usable.
    """
    definition = {member: request[member] for member in CONTENT if request.get(member) is not None}
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


def replace_definition(arn: str, definition: ApplicationDocument, wanted: str | None, service: Service) -> Resource:
    """Stores another definition of an application, and returns the application.

    Args:
        arn: ARN of the application.
        definition: The definition, as a new revision.
        wanted: Revision id that the application has to have; `None`: any.
        service: The service, with its catalog and object store.

    Raises:
        InvalidParameterException: The application has another revision id.
    """

    def changes(stored: Stored) -> ApplicationDocument:
        document = ApplicationDocument.model_validate(stored)
        check_revision(wanted, document)
        if document.last_number is None:
            return definition
        return definition.model_copy(update={"last_number": document.last_number})  # versions are counted on

    return service.catalog.update(arn, changes)


def described_with_tags(resource: Resource) -> dict[str, Any]:
    """Returns the response members that describe an application's content, and its tags."""
    return {**revision(resource), "tags": dict(resource.tags)}


_ATTEMPTS = 10


class _ChangedMeanwhile(Exception):
    """Raised when another request changed an application after its archives were checked, to try again."""


def create_version(role: ApplicationRole, request: Mapping[str, Any], service: Service) -> dict[str, Any]:
    """Saves an application's current content as the next numbered version, and returns the response's members.

    Raises:
        ResourceNotFoundException: The catalog has no such application.
        InvalidParameterException: The application has another revision by now, an archive cannot be read, or its
            content is not what the request says.
        LimitExceededException: The application has 40 versions already.
        ThrottlingException: Others change it all the time.
    """
    for _ in range(_ATTEMPTS):
        application = find_application(request["application"], role, LATEST, service)
        check_revision(request.get("currentRevisionId"), ApplicationDocument.of(application))
        content = _content(application, request, service)

        def make(parent: Resource, number: int, content: ApplicationDocument = content) -> NewResource:
            if ApplicationDocument.of(parent).revision_id != content.revision_id:
                raise _ChangedMeanwhile
            return _version(parent, number, content)

        try:
            return revision(service.catalog.create_numbered(application.arn, make, most=MAX_VERSIONS))
        except _ChangedMeanwhile:
            continue
    raise ThrottlingException(f"{request['application']} was changed by others {_ATTEMPTS} times in a row; try again")


def _version(application: Resource, number: int, content: ApplicationDocument) -> NewResource:
    return Resource.new(
        arn=version_arn(application.arn, number),
        kind=version_kind(application.kind),
        id=f"{application.id}/version/{number}",
        name=application.name,
        status="Active",
        parent=application.arn,
        document=content.model_copy(update={"version": str(number)}),
    )


def _content(application: Resource, request: Mapping[str, Any], service: Service) -> ApplicationDocument:
    """Returns the content of a new version: the application's, with the current ETags of its archives.

    Raises `InvalidParameterException` if the ETags or the image digest of the request are not the current ones.
    """
    content = ApplicationDocument.of(application).without("last_number", VERSION_KEY)
    if content.sources:
        sources = [with_etag(source.to_json(), index, service) for index, source in enumerate(content.sources)]
        content = content.model_copy(update={"sources": [StoredSource.model_validate(each) for each in sources]})
    _check_etags(request.get("s3Etags"), content, application)
    if digest := _image_digest(request.get("imageDigest"), content, application):
        content = content.model_copy(update={"image_digest": digest})
    return content


def _check_etags(wanted: list[str] | None, content: ApplicationDocument, application: Resource) -> None:
    if not wanted:
        return
    found = sorted(source.etag for source in content.sources or [])
    if sorted(etag.strip('"') for etag in wanted) != found:
        there = f"its archives have {', '.join(found)}" if found else "it has no archives"
        raise InvalidParameterException(f"s3Etags: {', '.join(wanted)} is not what {application.arn} holds; {there}")


def _image_digest(wanted: str | None, content: ApplicationDocument, application: Resource) -> str | None:
    """Returns the digest of a version's container image: from its URI, else from the request; `None`: neither has one.

    Raises `InvalidParameterException` if the request's digest is not that of the URI, or the application is no
    container image.
    """
    known = content.image_digest
    if wanted is None:
        return known
    uri = content.environment.uri if content.environment else ""
    if not uri or uri.startswith("python://"):
        raise InvalidParameterException(f"imageDigest: {application.arn} is no container image; leave imageDigest out")
    if known is not None and known != wanted.lower():
        raise InvalidParameterException(f"imageDigest: {wanted} is not what {application.arn} holds, {known}")
    return wanted.lower()


def register_operations(role: ApplicationRole) -> None:
    """Registers the six API operations (create, version, describe, list, update, delete) on one kind of application.

    Args:
        role: Kind of the applications, `robot` or `simulation`.
    """
    resource = f"{role.capitalize()}Application"

    @operation(f"Create{resource}")
    def create(request: ApplicationContent, service: Service) -> Answer:
        """Handles the operation that stores a new application under a unique name."""
        return create_application(role, request.to_wire(), service)

    @operation(f"Create{resource}Version")
    def create_numbered(request: NewApplicationVersion, service: Service) -> Answer:
        """Handles the operation that saves an application's content as a numbered version."""
        return create_version(role, request.to_wire(), service)

    @operation(f"Describe{resource}")
    def describe(request: ApplicationSelection, service: Service) -> Answer:
        """Handles the operation that describes an application, or a version of it."""
        return describe_application(role, request.to_wire(), service)

    @operation(f"List{resource}s")
    def list_page(request: ApplicationListRequest, service: Service) -> Answer:
        """Handles the operation that lists applications, newest first."""
        summaries, token = list_applications(role, request, service)
        return {f"{role}ApplicationSummaries": summaries, "nextToken": token}

    @operation(f"Update{resource}")
    def update(request: ApplicationUpdate, service: Service) -> Answer:
        """Handles the operation that replaces an application's content; its name stays."""
        return change_application(role, request.to_wire(), service)

    @operation(f"Delete{resource}")
    def delete(request: ApplicationSelection, service: Service) -> Answer:
        """Handles the operation that deletes an application with all versions, or one version of it."""
        delete_application(role, request.to_wire(), service)
        return {}
