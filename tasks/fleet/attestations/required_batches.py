"""Deployments that wait for a required batch, and the signed attestation that the batch passed.

The envelope of a deployment lies in the object store as `robots/attestations/<id of the job>.json`. It is made of
nothing but the batch, the version and the key, so a run that begins anew makes the same bytes.
"""

import hashlib
import tempfile
from contextlib import suppress
from datetime import timedelta
from pathlib import Path

from ....schemas.documents.applications import ApplicationDocument
from ....schemas.documents.fleets import DeploymentJobDocument
from ....schemas.rollouts.artifacts import Delivery
from ....schemas.wire.errors import (
    AttestationError,
    BucketNotFoundError,
    ConfigurationError,
    DeploymentError,
    ObjectNotFoundError,
    ResourceNotFoundException,
)
from ...catalog import Resource
from ...service.service import Service
from ..sources import fetch_source, place_of
from .attestation_keys import attestation_key, known_public_key
from .envelopes import sign, verified
from .statements import Statement, statement_of
from .tested_batches import PassedBatch, RunningBatch, StoredBatch, judge

LONGEST_WAIT = timedelta(days=14)
"""How long after its creation a deployment waits for its batch: as long as a batch may run."""

_FOLDER = "robots/attestations"


def attest(job: Resource, application: Resource, service: Service) -> RunningBatch | None:
    """Attests that a deployment's required batch has passed with its version, and stores that.

    Args:
        job: the deployment job, which requires a batch.
        application: its version, as `find_application` finds it.
        service: where the batch is, and where the envelope goes.

    Returns:
        What is still to be waited for; `None`: nothing, the envelope is stored.

    Raises:
        DeploymentError: the batch has not passed with this version and cannot any more, it was waited for too long,
            or an archive of the version is not what it was.
        ConfigurationError: the attestation key cannot be used.
        StorageError: the object store does not answer.
    """
    batch = str(DeploymentJobDocument.of(job).required_batch)
    judged = judge(StoredBatch.of(batch, service), application)
    if isinstance(judged, RunningBatch):
        if service.clock() - job.created_at > LONGEST_WAIT:
            raise DeploymentError(
                f"{judged.why} {LONGEST_WAIT.days} days after the deployment", "FleetDeploymentTimeout"
            )
        return judged
    bucket = service.settings.bucket
    service.store.ensure_bucket(bucket)
    service.store.put_bytes(bucket, envelope_key(job), signed(judged, application, service))
    return None


def signed(batch: PassedBatch, application: Resource, service: Service) -> bytes:
    """The envelope that says that a batch passed with a version.

    Raises:
        DeploymentError: an archive of the version is not what it was when the version was made.
        ConfigurationError: the attestation key cannot be used.
        StorageError: the object store does not answer.
    """
    return sign(statement_of(batch, application, _digests(application, service)), attestation_key(service))


def attestations_of(job: Resource, service: Service) -> tuple[bytes, ...]:
    """The envelopes of a deployment that has been attested; none if it requires no batch.

    A job that brings robots back requires none, and has the envelope of the job that had brought the version.

    Raises:
        DeploymentError: the envelope is gone, or not what this service signed.
        StorageError: the object store does not answer.
    """
    document = DeploymentJobDocument.of(job)
    if document.required_batch is not None:
        return (_attested(job, service)[0],)
    if document.rolls_back is None or document.rolls_back.earlier is None:
        return ()
    # The key of this machine may be gone, too.
    with suppress(
        ResourceNotFoundException, DeploymentError, ConfigurationError
    ):  # without it, it goes back where agents need none
        return attestations_of(service.catalog.get(document.rolls_back.earlier), service)
    return ()


def check_delivered(job: Resource, gets: Delivery, service: Service) -> None:
    """Checks that what robots would get is what the attestation is about.

    Args:
        job: the deployment job; one that requires no batch is not checked.
        gets: what robots would get.
        service: where the envelope is.

    Raises:
        DeploymentError: it is not.
        StorageError: the object store does not answer.
    """
    if DeploymentJobDocument.of(job).required_batch is None:
        return
    statement = _attested(job, service)[1]
    if (other := unattested(statement, gets)) is not None:
        raise DeploymentError(f"{other}; the attestation of {statement.batch.uri} is about others", "EtagMismatch")


def unattested(statement: Statement, gets: Delivery) -> str | None:
    """Says which archive a robot would get that a statement is not about; `None`: there is none."""
    for robot, artifact in sorted(gets.by_robot().items()):
        if artifact.delivers not in statement.archives:
            return f"{robot} gets an archive with the SHA-256 {artifact.delivers}"
    return None


def envelope_key(job: Resource) -> str:
    """Key of a deployment job's envelope in the service's bucket."""
    return f"{_FOLDER}/{job.id}.json"


def _attested(job: Resource, service: Service) -> tuple[bytes, Statement]:
    try:
        envelope = service.store.get_bytes(service.settings.bucket, envelope_key(job))
        return envelope, verified(envelope, known_public_key(service))
    except (ObjectNotFoundError, BucketNotFoundError) as error:
        raise DeploymentError(f"the attestation is gone: {error}", "MissingRobotDeploymentResource") from error
    except AttestationError as error:
        raise DeploymentError(str(error), "MissingRobotDeploymentResource") from error


def _digests(application: Resource, service: Service) -> dict[str, str]:
    """SHA-256 of each archive of a version, by where it lies."""
    document = ApplicationDocument.of(application)
    digests: dict[str, str] = {}
    with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
        for source in document.sources or []:
            archive = Path(scratch, "archive")
            fetch_source(source, document.version, archive, service)
            with archive.open("rb") as content:
                digests[place_of(source)] = hashlib.file_digest(content, "sha256").hexdigest()
    return digests
