"""Objects that each resource must have in the store, according to the catalog."""

from collections.abc import Iterator
from dataclasses import dataclass

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace, WorldDocument
from ..catalog import Resource
from ..worlds.archive_places import archive_place

JOB, WORLD, EXPORT = "simulation-job", "world", "world-export-job"
KINDS = (JOB, WORLD, EXPORT)
"""Kinds of resources that store something of their own. What users stored, such as applications, is theirs."""


@dataclass(frozen=True)
class Folder:
    """Files that were published together: a manifest names them."""

    place: StoredPlace


@dataclass(frozen=True)
class Single:
    """One object."""

    bucket: str
    key: str


def stored_of(resource: Resource) -> Iterator[Folder | Single]:
    """Yields the objects that a resource must have; for a run that did not finish, none."""
    if resource.kind == JOB:
        document = SimulationJobDocument.of(resource)
        if document.outputs is not None and document.finished:
            yield Folder(document.outputs)
    elif resource.kind == WORLD:
        world = WorldDocument.of(resource)
        if world.bundle is not None:
            yield Folder(world.bundle)
    elif resource.kind == EXPORT and resource.status == "Completed":
        yield Single(*archive_place(resource))
