"""Handlers of operations on world templates, the descriptions from which worlds are generated."""

from collections.abc import Mapping
from typing import Any

from ...schemas.documents.document_base import Changes
from ...schemas.documents.worlds import TemplateBody, WorldGenerationJobDocument, WorldTemplateDocument
from ...schemas.operations.world_templates import (
    CreateWorldTemplateRequest,
    CreateWorldTemplateResponse,
    DeleteWorldTemplateRequest,
    DescribeWorldTemplateRequest,
    DescribeWorldTemplateResponse,
    GetWorldTemplateBodyRequest,
    GetWorldTemplateBodyResponse,
    ListWorldTemplatesRequest,
    TemplateLocation,
    UpdateWorldTemplateRequest,
    UpdateWorldTemplateResponse,
)
from ...schemas.templates.extensions import body_extensions
from ...schemas.templates.parsing import parse_template_body, unwrapped_text
from ...schemas.wire.arns import new_id
from ...schemas.wire.errors import (
    InvalidParameterException,
    ObjectNotFoundError,
    ResourceAlreadyExistsException,
    StorageError,
)
from ..catalog import ClientToken, Resource
from ..service.service import Service
from ..worlds.reuse import find_template_again
from .registry import Answer, operation, page_of

KIND = "world-template"
_MAX_BODY_BYTES = 4 * 262_144  # the body may hold 262,144 characters of up to four bytes


@operation("CreateWorldTemplate")
def create_world_template(request: CreateWorldTemplateRequest, service: Service) -> CreateWorldTemplateResponse:
    """Handles `CreateWorldTemplate`: checks a template body, stores it as a new template, and describes that.

    A request with a known client token returns the template that it has stored before.
    """
    token = ClientToken.of("CreateWorldTemplate", request)
    return _answer(service.find_by_client_token(token) or _stored(request, token, service), request)


def _answer(resource: Resource, request: CreateWorldTemplateRequest) -> CreateWorldTemplateResponse:
    return CreateWorldTemplateResponse(
        arn=resource.arn,
        clientRequestToken=request.clientRequestToken,
        createdAt=resource.created_at,
        name=request.name or None,
        tags=dict(resource.tags),
    )


def existing_template(if_exists: str, request: Mapping[str, Any], service: Service) -> dict[str, Any] | None:
    """Returns the response of a step whose template is there already; `None` if the step has to create it.

    A template is taken if name, body and tags are the same; the form of the JSON text does not matter.

    Args:
        if_exists: `reuse` or `fail`.
        request: The request's members.
        service: The service, with its catalog and object store.

    Raises:
        ResourceAlreadyExistsException: `fail` was said, and there is a template of the name.
        InvalidParameterException: The body is not valid, or cannot be read.
    """
    asked = CreateWorldTemplateRequest.model_validate(request)
    if if_exists == "fail":
        taken = service.catalog.find(KIND, asked.name) if asked.name else None
        own = service.find_by_client_token(
            ClientToken.of("CreateWorldTemplate", asked)
        )  # made before its answer was lost
        if taken is not None and own is None:
            raise ResourceAlreadyExistsException(
                f"{taken.arn} has the name {asked.name!r} already; choose another, or leave ifExists out"
            )
        return None
    body = _checked_body(asked.templateBody, asked.templateLocation, service).template_body
    found = find_template_again(asked.name or "", body, asked.tags or {}, service)
    return None if found is None else _answer(found, asked).to_wire()


def _stored(request: CreateWorldTemplateRequest, token: ClientToken | None, service: Service) -> Resource:
    body = _checked_body(request.templateBody, request.templateLocation, service)
    template_id = new_id("template", service.chance)
    return service.catalog.create(
        Resource.new(
            arn=service.arn("world-template", template_id),
            kind=KIND,
            id=template_id,
            name=request.name or "",
            status="Active",
            tags=request.tags or {},
            document=WorldTemplateDocument(
                version=body.version,
                template_body=body.template_body,
                client_request_token=request.clientRequestToken,
            ),
        ),
        token=token,
    )


@operation("UpdateWorldTemplate")
def update_world_template(request: UpdateWorldTemplateRequest, service: Service) -> UpdateWorldTemplateResponse:
    """Handles `UpdateWorldTemplate`: changes a template's name or body; existing jobs keep the old body.

    A member that the request omits stays. Raises `ResourceNotFoundException` if there is no such template.
    """
    service.catalog.get(request.template, kind=KIND)
    body: TemplateBody | None = None
    if request.templateBody is not None or request.templateLocation is not None:
        body = _checked_body(request.templateBody, request.templateLocation, service)
    resource = service.catalog.update(request.template, body or Changes(), name=request.name)
    return UpdateWorldTemplateResponse(
        arn=resource.arn,
        name=resource.name or None,
        createdAt=resource.created_at,
        lastUpdatedAt=resource.updated_at,
    )


@operation("DescribeWorldTemplate")
def describe_world_template(request: DescribeWorldTemplateRequest, service: Service) -> DescribeWorldTemplateResponse:
    """Handles `DescribeWorldTemplate`: returns everything about a template but its body."""
    resource = service.catalog.get(request.template, kind=KIND)
    document = WorldTemplateDocument.of(resource)
    return DescribeWorldTemplateResponse(
        arn=resource.arn,
        clientRequestToken=document.client_request_token,
        name=resource.name or None,
        createdAt=resource.created_at,
        lastUpdatedAt=resource.updated_at,
        tags=dict(resource.tags),
        version=document.version,
    )


@operation("GetWorldTemplateBody")
def get_world_template_body(request: GetWorldTemplateBodyRequest, service: Service) -> GetWorldTemplateBodyResponse:
    """Handles `GetWorldTemplateBody`: returns a template's current body, or the body that a generation job used."""
    if request.template is not None:
        template = service.catalog.get(request.template, kind=KIND)
        return GetWorldTemplateBodyResponse(templateBody=WorldTemplateDocument.of(template).template_body)
    job = service.catalog.get(str(request.generationJob), kind="world-generation-job")
    return GetWorldTemplateBodyResponse(templateBody=WorldGenerationJobDocument.of(job).template_body)


@operation("ListWorldTemplates")
def list_world_templates(request: ListWorldTemplatesRequest, service: Service) -> Answer:
    """Handles `ListWorldTemplates`: returns one page of templates, newest first, and a token for the next page."""
    page = page_of(request, KIND, service)
    summaries = [
        {
            "arn": template.arn,
            "createdAt": template.created_at,
            "lastUpdatedAt": template.updated_at,
            "name": template.name or None,
            "version": WorldTemplateDocument.of(template).version,
        }
        for template in page.resources
    ]
    return {"templateSummaries": summaries, "nextToken": page.next_token}


@operation("DeleteWorldTemplate")
def delete_world_template(request: DeleteWorldTemplateRequest, service: Service) -> Answer:
    """Handles `DeleteWorldTemplate`: deletes a template; worlds and jobs made from it stay.

    Raises `ResourceNotFoundException` if there is no such template.
    """
    service.catalog.get(request.template, kind=KIND)
    service.catalog.delete(request.template)
    return {}


def _checked_body(text: str | None, location: TemplateLocation | None, service: Service) -> TemplateBody:
    """Checks a template body, given as text or by its place, and returns the document members that depend on it.

    Raises `InvalidParameterException` if it is invalid, or if it has extensions that the settings refuse. The place is
    read if the text is absent or empty.
    """
    given = text or _read_body(location, service)
    body = parse_template_body(given)
    if service.settings.refuse_deprecated and (uses := list(body_extensions(body))):
        raise InvalidParameterException(f"not of the service (ROBOMAKER_REFUSE_DEPRECATED): {'; '.join(uses)}")
    return TemplateBody(version=body.Version, template_body=unwrapped_text(given))


def _read_body(location: TemplateLocation | None, service: Service) -> str:
    if location is None:
        raise InvalidParameterException("give templateBody or templateLocation")
    place = f"templateLocation: s3://{location.s3Bucket}/{location.s3Key}"
    try:
        if service.store.head(location.s3Bucket, location.s3Key).size_bytes > _MAX_BODY_BYTES:
            raise InvalidParameterException(f"{place} is larger than a template body may be (262144 characters)")
        return service.store.get_bytes(location.s3Bucket, location.s3Key).decode()
    except ObjectNotFoundError as error:
        raise InvalidParameterException(f"{place} does not exist") from error
    except StorageError as error:
        raise InvalidParameterException(f"{place} cannot be read: {error}") from error
    except UnicodeDecodeError as error:
        raise InvalidParameterException(f"{place} is not UTF-8 text: {error}") from error
