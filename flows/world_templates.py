"""Flows: world templates: what worlds should be like."""

from typing import Any

from ..schemas.operations.world_templates import TemplateBody, TemplateLocation, TemplateName
from ..schemas.wire.common import Arn, ClientRequestToken, MaxResults, PaginationToken, TagMap
from .steps import operation_flow, read, record, validate


@operation_flow
def CreateWorldTemplate(
    *,
    clientRequestToken: ClientRequestToken | None = None,
    name: TemplateName | None = None,
    templateBody: TemplateBody | None = None,
    templateLocation: TemplateLocation | None = None,
    tags: TagMap | None = None,
) -> dict[str, Any]:
    """Keeps a description that worlds can be generated from."""
    return record("CreateWorldTemplate", validate("CreateWorldTemplate", locals()))


@operation_flow
def UpdateWorldTemplate(
    *,
    template: Arn,
    name: TemplateName | None = None,
    templateBody: TemplateBody | None = None,
    templateLocation: TemplateLocation | None = None,
) -> dict[str, Any]:
    """Changes a world template; what was made from it before stays as it is."""
    return record("UpdateWorldTemplate", validate("UpdateWorldTemplate", locals()))


@operation_flow
def DescribeWorldTemplate(*, template: Arn) -> dict[str, Any]:
    """Says what is known of a world template."""
    return read("DescribeWorldTemplate", locals())


@operation_flow
def GetWorldTemplateBody(*, template: Arn | None = None, generationJob: Arn | None = None) -> dict[str, Any]:
    """Gives a world template's body, as it is or as a generation job used it."""
    return read("GetWorldTemplateBody", locals())


@operation_flow
def ListWorldTemplates(
    *, nextToken: PaginationToken | None = None, maxResults: MaxResults | None = None
) -> dict[str, Any]:
    """Lists world templates, newest first."""
    return read("ListWorldTemplates", locals())


@operation_flow
def DeleteWorldTemplate(*, template: Arn) -> dict[str, Any]:
    """Deletes a world template; its worlds and jobs stay."""
    return record("DeleteWorldTemplate", validate("DeleteWorldTemplate", locals()))
