"""Generates one world of a generation job in a child process, and stores its bundle."""

import hashlib
import json
import tempfile
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from ...schemas.documents.worlds import StoredPlace, WorldDocument, WorldGenerationJobDocument
from ...schemas.reports.names import name_label, world_name
from ...schemas.wire.arns import world_id
from ...schemas.wire.errors import ResourceAlreadyExistsException, StorageError, WorldGenerationError
from ...schemas.worlds.description import DESCRIPTION_FILE
from ..catalog import Resource
from ..execution.prefect_events import tell_of_world
from ..execution.task_pool import RunStep
from ..files.untrusted_folders import regular_files
from ..service.service import Service
from ..service.store_retries import at_once, patiently
from ..simulations.outputs.output_places import prepare_bucket
from ..storage import publish
from ..worldforge.seeds import GENERATOR_VERSION, seeds_for
from .builders import WorldBuilders
from .stored_bundles import BUNDLE_LABEL, bundle_held, bundle_label

WORLDS_PREFIX = "worlds"
ORIGIN_LABEL = "origin"
"""Label of a world in the catalog with the hash of its inputs (template, seeds)."""


@dataclass(frozen=True)
class WorldFailure:
    """Reason why a world could not be generated: code and text."""

    code: str
    reason: str


def generate_world(
    service: Service, job: Resource, index: int, world_arn: str, builders: WorldBuilders, run_step: RunStep
) -> WorldFailure | None:
    """Generates one world of a generation job, stores its files, and adds it to the catalog.

    Args:
        service: The service, with its catalog and object store.
        job: The generation job.
        index: Number of the world in the job, from 0; the interiors of a floor plan follow each other.
        world_arn: ARN the world gets; a world of that ARN that exists already is left as it is.
        builders: Processes that build worlds.
        run_step: Runs the step `upload`, directly or as a Prefect task.

    Returns:
        `None`, or why there is no world.
    """
    document = WorldGenerationJobDocument.of(job)
    seeds = world_seeds(document, index)
    try:
        with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
            folder = Path(scratch, "bundle")
            content = builders.build(document.template_body, *seeds, folder)
            # A bundle is held while it is stored, and must not be held while the store is waited for.
            held = replace(service, store=at_once(service.store))
            store = lambda: _store(held, job, index, world_arn, folder, content)  # noqa: E731
            run_step("upload", lambda: patiently(service.store, service.settings.bucket, store))
    except WorldGenerationError as error:
        return WorldFailure("InternalServiceError", str(error))
    except (StorageError, OSError) as error:
        return WorldFailure("InternalServiceError", f"the world could not be stored: {error}")
    return None


def _store(service: Service, job: Resource, index: int, world_arn: str, folder: Path, content: str) -> None:
    prefix = f"{WORLDS_PREFIX}/{content}"
    bundle = StoredPlace(bucket=service.settings.bucket, prefix=prefix)
    publish_bundle(service, prefix, folder, service.clock())
    with bundle_held(bundle, service):
        # Stores nothing, unless the last world with this content was deleted just now.
        publish_bundle(service, prefix, folder, service.clock())
        plan = json.loads((folder / DESCRIPTION_FILE).read_bytes())["plan"]
        add_world(service, job, index, world_arn, WorldDocument(bundle=bundle, plan=plan))


def publish_bundle(service: Service, prefix: str, folder: Path, created_at: datetime) -> None:
    """Uploads a world's files under the prefix of their content hash, so that equal files are stored once.

    Makes the bucket ready first. Errors of the object store are raised.
    """
    prepare_bucket(service, service.settings.bucket)
    publish(
        service.store,
        service.settings.bucket,
        prefix,
        regular_files(folder),
        about={"kind": "world"},
        created_at=created_at,
    )


def world_seeds(job: WorldGenerationJobDocument, index: int) -> tuple[int, int]:
    """Returns floor plan seed and interior seed of one world of a generation job."""
    interiors = job.request.world_count.interior_count_per_floorplan
    return world_seeds_of(job.seed, interiors, index, diversity=job.request.diversity)


def world_seeds_of(job_seed: int, interiors: int, index: int, *, diversity: int | None) -> tuple[int, int]:
    """Returns floor plan seed and interior seed of a world, from the job's seed and the world's index."""
    return seeds_for(job_seed, index // interiors, index % interiors, diverse=diversity != 0)


def origin_of(template_body: str, seeds: tuple[int, int]) -> str:
    """Returns a hash of a world's template and seeds: worlds with equal hashes are identical.

    Args:
        template_body: The body of its template.
        seeds: Floor plan seed and interior seed of the world.
    """
    made_of = [GENERATOR_VERSION, json.loads(template_body), *seeds]
    return hashlib.sha256(json.dumps(made_of).encode()).hexdigest()


def add_world(service: Service, job: Resource, index: int, arn: str, made: WorldDocument) -> None:
    """Adds a generated world to the catalog, unless it exists.

    Args:
        service: The service, with its catalog and object store.
        job: The generation job.
        index: Number of the world in the job, from 0.
        arn: ARN the world gets.
        made: Bundle and floor plan of the world, and the world that it shares them with, if any.
    """
    bundle = made.bundle
    assert bundle is not None
    document = WorldGenerationJobDocument.of(job)
    request, origin = document.request, origin_of(document.template_body, world_seeds(document, index))
    number = world_id(job.id, index + 1)
    world = Resource.new(
        arn=arn,
        kind="world",
        id=number,
        status="Active",
        parent=job.arn,
        tags=request.world_tags or {},
        labels={
            "generationJobId": [job.id],
            **job.labels,
            BUNDLE_LABEL: [bundle_label(bundle)],
            ORIGIN_LABEL: [origin],
            **name_label(world_name(document.template_name, number)),
        },
        document=made.model_copy(
            update={
                "template": request.template,
                "template_name": document.template_name,
                "description_key": f"{bundle.prefix}/{DESCRIPTION_FILE}",
            }
        ),
    )
    with suppress(ResourceAlreadyExistsException):  # made by the job worker that took over from one that was held up
        service.catalog.create(world, token=None)
    tell_of_world(arn, service.store.uri(bundle.bucket, bundle.prefix), request.template)
