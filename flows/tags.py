"""Flows: tags: words that users put on resources; all versions of an application have the application's."""

from typing import Any

from ..schemas.operations.tags import TagKeyList
from ..schemas.wire.common import Arn, TagMap
from .steps import operation_flow, read, record, validate


@operation_flow
def ListTagsForResource(*, resourceArn: Arn) -> dict[str, Any]:
    """Lists the tags of a resource."""
    return read("ListTagsForResource", locals())


@operation_flow
def TagResource(*, resourceArn: Arn, tags: TagMap) -> dict[str, Any]:
    """Adds tags to a resource."""
    return record("TagResource", validate("TagResource", locals()))


@operation_flow
def UntagResource(*, resourceArn: Arn, tagKeys: TagKeyList) -> dict[str, Any]:
    """Removes tags from a resource."""
    return record("UntagResource", validate("UntagResource", locals()))
