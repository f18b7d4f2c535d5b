"""Operations on tags: key-value labels that users put on resources."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from ..wire.base import Shape, ShapeName, optional
from ..wire.common import Arn
from ..wire.operation_shape import READ_ERRORS, Location, OperationShape
from ..wire.tags import TagKey, TagMap

TagKeyList = Annotated[list[TagKey], ShapeName("TagKeyList")]

_URI = "/tags/{resourceArn}"
_IN_PATH: Mapping[str, Location] = {"resourceArn": "uri"}


class ListTagsForResourceRequest(Shape):
    """Request of `ListTagsForResource`: names the resource whose tags are listed."""

    resourceArn: Arn = Field(description="ARN of the resource.")


class ListTagsForResourceResponse(Shape):
    """Response of `ListTagsForResource`: the tags (key-value labels) of a resource."""

    tags: TagMap | None = optional("All of them.")


class TagResourceRequest(Shape):
    """Request of `TagResource`: adds tags (key-value labels) to a resource."""

    resourceArn: Arn = Field(description="ARN of the resource.")
    tags: TagMap = Field(description="Tags to add; keys that the resource has get the new value.")


class TagResourceResponse(Shape):
    """Response of `TagResource`: empty, the resource has the tags."""


class UntagResourceRequest(Shape):
    """Request of `UntagResource`: removes tags from a resource, by key."""

    resourceArn: Arn = Field(description="ARN of the resource.")
    tagKeys: TagKeyList = Field(description="Keys of the tags to remove; those it does not have are ignored.")


class UntagResourceResponse(Shape):
    """Response of `UntagResource`: empty, the tags are removed."""


OPERATIONS = (
    OperationShape(
        ListTagsForResourceRequest,
        READ_ERRORS,
        "Lists the tags of a resource.",
        method="GET",
        uri=_URI,
        locations=_IN_PATH,
    ),
    OperationShape(TagResourceRequest, READ_ERRORS, "Adds tags to a resource.", uri=_URI, locations=_IN_PATH),
    OperationShape(
        UntagResourceRequest,
        READ_ERRORS,
        "Removes tags from a resource.",
        method="DELETE",
        uri=_URI,
        locations={**_IN_PATH, "tagKeys": "querystring"},
    ),
)
