"""Handlers of operations on tags of resources; versions of an application share the application's tags."""

from typing import get_args

from ...schemas.operations.tags import (
    ListTagsForResourceRequest,
    ListTagsForResourceResponse,
    TagResourceRequest,
    UntagResourceRequest,
)
from ...schemas.wire.arns import Kind, ResourceArn
from ...schemas.wire.errors import ResourceNotFoundException
from ..catalog import Resource
from ..service.service import Service
from .registry import Answer, operation


@operation("ListTagsForResource")
def list_tags_for_resource(request: ListTagsForResourceRequest, service: Service) -> ListTagsForResourceResponse:
    """Handles `ListTagsForResource`: returns a resource's tags."""
    return ListTagsForResourceResponse(tags=dict(_tagged(request.resourceArn, service).tags))


@operation("TagResource")
def tag_resource(request: TagResourceRequest, service: Service) -> Answer:
    """Handles `TagResource`: adds tags to a resource, or replaces their values."""
    service.catalog.set_tags(_tagged(request.resourceArn, service).arn, request.tags)
    return {}


@operation("UntagResource")
def untag_resource(request: UntagResourceRequest, service: Service) -> Answer:
    """Handles `UntagResource`: removes tags from a resource; keys it does not have are ignored."""
    service.catalog.remove_tags(_tagged(request.resourceArn, service).arn, request.tagKeys)
    return {}


def _tagged(arn: str, service: Service) -> Resource:
    ResourceArn.parse(arn)
    resource = service.catalog.get(arn)
    if resource.kind not in get_args(Kind):  # what only the catalog tells apart, such as an application's versions
        raise ResourceNotFoundException(f"there is no resource {arn}")
    return resource
