"""Worlds: what generation jobs leave behind."""

from typing import Any

from ..schemas.common import filter_values
from ..schemas.worlds import DescribeWorldRequest, DescribeWorldResponse, ListWorldsRequest, ListWorldsResponse
from ..tasks.catalog import Resource
from ..tasks.service import Service
from .operation import flows_of, operation

_PAGE = 100


@operation("DescribeWorld")
def describe_world(request: DescribeWorldRequest, service: Service) -> DescribeWorldResponse:
    """Tells where a world comes from."""
    world = service.catalog.get(request.world, kind="world")
    return DescribeWorldResponse.model_validate({**_summary(world), "tags": dict(world.tags)})


@operation("ListWorlds")
def list_worlds(request: ListWorldsRequest, service: Service) -> ListWorldsResponse:
    """Lists worlds, newest first."""
    page = service.catalog.list(
        "world",
        filters=filter_values(request.filters),
        limit=request.maxResults or _PAGE,
        after=request.nextToken,
    )
    return ListWorldsResponse.model_validate(
        {"worldSummaries": [_summary(world) for world in page.resources], "nextToken": page.next_token}
    )


def _summary(world: Resource) -> dict[str, Any]:
    return {
        "arn": world.arn,
        "createdAt": world.created_at,
        "generationJob": world.parent,
        "template": world.document["template"],
    }


def __getattr__(name: str) -> Any:
    return flows_of(__name__)(name)
