"""Handlers of operations on worlds, the results of generation jobs."""

import json
import logging
from typing import Any

from ...schemas.documents.worlds import WorldDocument
from ...schemas.operations.worlds import (
    BatchDeleteWorldsRequest,
    BatchDeleteWorldsResponse,
    DescribeWorldRequest,
    ListWorldsRequest,
)
from ...schemas.wire.errors import InternalServerException, ResourceNotFoundException, StorageError
from ..catalog import Resource
from ..service.service import Service
from ..worlds.stored_bundles import delete_world
from .registry import Answer, operation, page_of

KIND = "world"

_logger = logging.getLogger(__name__)


@operation("DescribeWorld")
def describe_world(request: DescribeWorldRequest, service: Service) -> Answer:
    """Handles `DescribeWorld`: returns a world's origin, content and checks."""
    world = service.catalog.get(request.world, kind=KIND)
    return {**_summary(world), "tags": dict(world.tags), "worldDescriptionBody": _description(world, service)}


@operation("ListWorlds")
def list_worlds(request: ListWorldsRequest, service: Service) -> Answer:
    """Handles `ListWorlds`: returns a page of worlds, newest first, and a token for the next page."""
    # The service documented `status`, though its worlds have none: here they all are `Active`.
    page = page_of(request, KIND, service, "status", "generationJobId", "templateId")
    return {"worldSummaries": [_summary(world) for world in page.resources], "nextToken": page.next_token}


@operation("BatchDeleteWorlds")
def batch_delete_worlds(request: BatchDeleteWorldsRequest, service: Service) -> BatchDeleteWorldsResponse:
    """Handles `BatchDeleteWorlds`: deletes worlds and their files; jobs that already run in them continue.

    Worlds that do not exist or cannot be deleted are listed as unprocessed.
    """
    found = service.catalog.get_many(request.worlds)
    left = [
        arn
        for arn in dict.fromkeys(request.worlds)
        if arn not in found or found[arn].kind != KIND or not _deleted(found[arn], service)
    ]
    return BatchDeleteWorldsResponse(unprocessedWorlds=left)


def _description(world: Resource, service: Service) -> str | None:
    """Returns the world's description as JSON text, with the hash of the world's bundle added as `contentHash`.

    Returns `None` for a world of an earlier release that has no description. Raises `InternalServerException` if the
    description cannot be read.
    """
    document = WorldDocument.of(world)
    if document.bundle is None or document.description_key is None:
        return None
    try:
        description = json.loads(service.store.get_bytes(document.bundle.bucket, document.description_key))
    except StorageError as error:
        raise InternalServerException(f"the description of {world.arn} cannot be read: {error}") from error
    return json.dumps({**description, "contentHash": document.bundle.last_part})


def _deleted(world: Resource, service: Service) -> bool:
    try:
        delete_world(world, service)
    except ResourceNotFoundException:  # somebody else was quicker
        return False
    except StorageError as error:
        _logger.warning("%s is not deleted: %s", world.arn, error)
        return False
    return True


def _summary(world: Resource) -> dict[str, Any]:
    return {
        "arn": world.arn,
        "createdAt": world.created_at,
        "generationJob": world.parent,
        "template": WorldDocument.of(world).template,
    }
