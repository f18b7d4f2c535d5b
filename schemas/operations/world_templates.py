"""Operations on world templates: descriptions of floor plans and interiors from which worlds are generated."""

import json
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, model_validator

from ..wire.base import Shape, ShapeName, optional
from ..wire.common import (
    NO_CONTROLS,
    Arn,
    ClientRequestToken,
    GenericString,
    Json,
    LastUpdatedAt,
    PageRequest,
    PaginationToken,
    S3Bucket,
    S3Key,
    Timestamp,
    exactly_one,
    text,
)
from ..wire.operation_shape import (
    EXISTS,
    INTERNAL,
    INVALID,
    LIMIT,
    LIST_ERRORS,
    NOT_FOUND,
    READ_ERRORS,
    THROTTLED,
    OperationShape,
)
from ..wire.tags import TagMap


def _as_text(body: object) -> object:
    if not isinstance(body, dict):
        return body
    try:
        return json.dumps(body, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the mapping has no form in JSON: {error}") from error


TemplateName = Annotated[str, ShapeName("TemplateName"), text(0, 255)]
NewTemplateName = Annotated[TemplateName, NO_CONTROLS]
"""Name of a template in requests; templates of earlier releases may have other names."""
TemplateBody = Annotated[Json, BeforeValidator(_as_text, json_schema_input_type=Json | dict[str, Any])]
"""Template body as JSON text or (an extension) as a mapping, which is converted to JSON text."""


class TemplateLocation(Shape):
    """Bucket and key of an object that holds a world template's body (JSON)."""

    s3Bucket: S3Bucket = Field(description="Bucket of the object.")
    s3Key: S3Key = Field(description="Key of the object.")


class CreateWorldTemplateRequest(Shape):
    """Request of `CreateWorldTemplate`: creates a world template, from which worlds are generated."""

    clientRequestToken: ClientRequestToken | None = optional(
        "Makes the call repeatable: the same token and request give the same template."
    )
    name: NewTemplateName | None = optional("Name for people; any text without control characters.")
    templateBody: TemplateBody | None = optional("The template, as JSON text or as a mapping.")
    templateLocation: TemplateLocation | None = optional("Object that holds the template.")
    tags: TagMap | None = optional("Tags for the template.")

    @model_validator(mode="after")
    def _one_body(self) -> Self:
        exactly_one(("templateBody", "templateLocation"), (self.templateBody, self.templateLocation))
        return self


class CreateWorldTemplateResponse(Shape):
    """Response of `CreateWorldTemplate`: the world template that was created."""

    arn: Arn | None = optional("ARN of the template.")
    clientRequestToken: ClientRequestToken | None = optional("The request's token.")
    createdAt: Timestamp | None = optional("When it was made.")
    name: TemplateName | None = optional("Its name.")
    tags: TagMap | None = optional("Its tags.")


class UpdateWorldTemplateRequest(Shape):
    """Request of `UpdateWorldTemplate`: changes a world template's name, its body, or both.

    Absent members stay as they are.
    """

    template: Arn = Field(description="ARN of the template.")
    name: NewTemplateName | None = optional("Its new name; empty: it has none any more.")
    templateBody: TemplateBody | None = optional("Its new body, as JSON text or as a mapping.")
    templateLocation: TemplateLocation | None = optional("Object that holds its new body.")

    @model_validator(mode="after")
    def _some_change(self) -> Self:
        if self.templateBody is not None and self.templateLocation is not None:
            raise ValueError("templateBody and templateLocation are both given; leave one of them out")
        if (self.name, self.templateBody, self.templateLocation) == (None, None, None):
            raise ValueError("nothing is to be changed; give name, templateBody or templateLocation")
        return self


class UpdateWorldTemplateResponse(Shape):
    """Response of `UpdateWorldTemplate`: the updated world template."""

    arn: Arn | None = optional("ARN of the template.")
    name: TemplateName | None = optional("Its name.")
    createdAt: Timestamp | None = optional("When it was made.")
    lastUpdatedAt: LastUpdatedAt | None = optional("When it was last changed: now.")


class DescribeWorldTemplateRequest(Shape):
    """Request of `DescribeWorldTemplate`: names the world template to describe, without its body."""

    template: Arn = Field(description="ARN of the template.")


class DescribeWorldTemplateResponse(Shape):
    """Response of `DescribeWorldTemplate`: one world template, without its body."""

    arn: Arn | None = optional("ARN of the template.")
    clientRequestToken: ClientRequestToken | None = optional("Token it was made with.")
    name: TemplateName | None = optional("Its name.")
    createdAt: Timestamp | None = optional("When it was made.")
    lastUpdatedAt: LastUpdatedAt | None = optional("When it was last changed.")
    tags: TagMap | None = optional("Its tags.")
    version: GenericString | None = optional('Version of the body\'s form: "1" or "2".')


class GetWorldTemplateBodyRequest(Shape):
    """Request of `GetWorldTemplateBody`: asks for the JSON body of a world template."""

    template: Arn | None = optional("ARN of the template whose present body is wanted.")
    generationJob: Arn | None = optional("ARN of the generation job whose body, as it was then, is wanted.")

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        exactly_one(("template", "generationJob"), (self.template, self.generationJob))
        return self


class GetWorldTemplateBodyResponse(Shape):
    """Response of `GetWorldTemplateBody`: the JSON body of a world template."""

    templateBody: Json | None = optional("The body, JSON text.")


class ListWorldTemplatesRequest(PageRequest):
    """Request of `ListWorldTemplates`: asks for a page of world templates, newest first."""


class TemplateSummary(Shape):
    """Summary of a world template, as `ListWorldTemplates` shows it."""

    arn: Arn | None = optional("ARN of the template.")
    createdAt: Timestamp | None = optional("When it was made.")
    lastUpdatedAt: LastUpdatedAt | None = optional("When it was last changed.")
    name: TemplateName | None = optional("Its name.")
    version: GenericString | None = optional('Version of the body\'s form: "1" or "2".')


TemplateSummaries = Annotated[list[TemplateSummary], ShapeName("TemplateSummaries")]


class ListWorldTemplatesResponse(Shape):
    """Response of `ListWorldTemplates`: one page of world templates."""

    templateSummaries: TemplateSummaries | None = optional("Templates, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class DeleteWorldTemplateRequest(Shape):
    """Request of `DeleteWorldTemplate`: names the world template to delete."""

    template: Arn = Field(description="ARN of the template.")


class DeleteWorldTemplateResponse(Shape):
    """Response of `DeleteWorldTemplate`: empty, the template is deleted."""


OPERATIONS = (
    OperationShape(
        CreateWorldTemplateRequest,
        (INVALID, EXISTS, NOT_FOUND, LIMIT, THROTTLED, INTERNAL),
        "Keeps a description that worlds can be generated from.",
    ),
    OperationShape(
        UpdateWorldTemplateRequest,
        READ_ERRORS,
        "Changes a world template; what was made from it before stays as it is.",
    ),
    OperationShape(DescribeWorldTemplateRequest, READ_ERRORS, "Says what is known of a world template."),
    OperationShape(
        GetWorldTemplateBodyRequest,
        READ_ERRORS,
        "Gives a world template's body, as it is or as a generation job used it.",
    ),
    OperationShape(ListWorldTemplatesRequest, LIST_ERRORS, "Lists world templates, newest first."),
    OperationShape(DeleteWorldTemplateRequest, READ_ERRORS, "Deletes a world template; its worlds and jobs stay."),
)
