"""Deployments that wait for a required batch, and the signed attestation that the batch passed.

The envelope of a deployment is stored in the object store as `robots/attestations/<id of the job>.json`. Only the
batch, the version and the key determine it, so a run that begins again makes the same bytes.
"""

import hashlib
import tempfile
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from typing import Literal

from pydantic import Field

from ....schemas.documents.applications import ApplicationDocument
from ....schemas.exit_codes import BROKE, OK, VERDICT_FAILED
from ....schemas.fleet.documents import DeploymentJobDocument
from ....schemas.fleet.rollouts.rollout_plan import Delivery
from ....schemas.wire.base import Model
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
from ..application_archives import fetch_source, place_of
from ..catalog_rollouts import Rollouts
from .envelopes import PublicKey, attestation_key, known_public_key, sign, verified
from .passed_batch import PassedBatch, RunningBatch, StoredBatch, judge
from .statements import Statement, statement_of

LONGEST_WAIT = timedelta(days=14)
"""Longest time that a deployment waits for its batch, counted from its creation: as long as a batch may run."""

_FOLDER = "robots/attestations"


def attest(job: Resource, application: Resource, service: Service) -> RunningBatch | None:
    """Attests, with a signature, that a deployment's required simulation batch passed with the version to deploy.

    Args:
        job: The deployment job, which requires a batch.
        application: The application version, as `find_application` finds it.
        service: The service, with its catalog and object store.

    Returns:
        The batch that is still running; `None`: it has passed, and the attestation is stored.

    Raises:
        DeploymentError: The batch has not passed with this version and cannot any more, it was waited for too long,
            or an archive of the version is not what it was.
        ConfigurationError: The attestation key cannot be used.
        StorageError: The object store does not answer.
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
    """Makes the signed attestation that a simulation batch passed with an application version.

    Raises:
        DeploymentError: An archive of the version is not what it was when the version was made.
        ConfigurationError: The attestation key cannot be used.
        StorageError: The object store does not answer.
    """
    return sign(statement_of(batch, application, _digests(application, service)), attestation_key(service))


def attestations_of(job: Resource, service: Service) -> tuple[bytes, ...]:
    """Returns the signed attestations of a deployment; none if it requires no simulation batch.

    A job that brings robots back requires none, and has the envelope of the job that had brought the version.

    Raises:
        DeploymentError: The envelope is gone, or not what this service signed.
        StorageError: The object store does not answer.
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
    """Checks that the files robots would get are those that the deployment's attestation covers.

    Args:
        job: The deployment job; one that requires no batch is not checked.
        gets: The files that robots would get.
        service: The service, with its catalog and object store.

    Raises:
        DeploymentError: A file differs from those that the attestation covers.
        StorageError: The object store does not answer.
    """
    if DeploymentJobDocument.of(job).required_batch is None:
        return
    statement = _attested(job, service)[1]
    if (other := unattested(statement, gets)) is not None:
        raise DeploymentError(f"{other}; the attestation of {statement.batch.uri} is about others", "EtagMismatch")


def unattested(statement: Statement, gets: Delivery) -> str | None:
    """Names an archive that robots would get but the attestation does not cover; `None` if there is none."""
    for robot, artifact in sorted(gets.by_robot().items()):
        if artifact.delivers not in statement.archives:
            return f"{robot} gets an archive with the SHA-256 {artifact.delivers}"
    return None


def envelope_key(job: Resource) -> str:
    """Returns the object-store key of a deployment job's attestation."""
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
    """Returns the SHA-256 of each archive of a version, by its address in the object store; downloads each archive."""
    document = ApplicationDocument.of(application)
    digests: dict[str, str] = {}
    with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
        for source in document.sources or []:
            archive = Path(scratch, "archive")
            fetch_source(source, document.version, archive, service)
            with archive.open("rb") as content:
                digests[place_of(source)] = hashlib.file_digest(content, "sha256").hexdigest()
    return digests


Answer = Literal["verified", "refuted", "nothing to verify"]

EXIT_CODES: dict[Answer, int] = {"verified": OK, "refuted": VERDICT_FAILED, "nothing to verify": BROKE}
"""Exit codes of the command line, by result of the verification."""


class DeploymentCheck(Model):
    """Result of verifying that a deployment delivered the same files that had passed the simulations."""

    schema_version: Literal[1] = Field(default=1, description="Version of this form.")
    deployment: str = Field(description="ARN of the deployment job.")
    answer: Answer = Field(description="Answer of the check: `verified`, `refuted` or `nothing to verify`.")
    reason: str | None = Field(default=None, description="Why it is not verified, in words; absent: it is.")
    key_id: str | None = Field(default=None, description="Id of the key that signed; absent: it is not known.")
    batch: str | None = Field(default=None, description="ARN of the required batch; absent: none is required.")
    verdict: str | None = Field(default=None, description="The verdict that was attested; absent: none was.")
    jobs: list[str] = Field(default=[], description="Ids of the simulation jobs that passed.")
    seeds: int | None = Field(default=None, description="How many different seeds they had.")
    trials: int | None = Field(default=None, description="How many episodes of jobs with trials.")
    worlds: int | None = Field(default=None, description="How many different worlds they ran in.")
    requirements: list[str] = Field(default=[], description="Names of what they were judged by.")
    archives: dict[str, str] = Field(default={}, description="SHA-256 of each archive that it is about, by name.")
    simulated: list[str] = Field(default=[], description="Names of those that ran in the simulations.")

    def __str__(self) -> str:
        lines = [f"{self.answer}: {self.deployment}"]
        if self.reason is not None:
            lines.append(f"  {self.reason}")
        if self.verdict is not None:
            lines.append(f"  {self.verdict} in {self.batch}")
            judged_by = ", ".join(self.requirements) or "of the environment"
            lines.append(
                f"  jobs {len(self.jobs)}, seeds {self.seeds}, trials {self.trials}, worlds {self.worlds}, "
                f"requirements {judged_by}"
            )
            for name, sha256 in self.archives.items():
                lines.append(f"  {name} sha256:{sha256}{'' if name in self.simulated else ' (not simulated itself)'}")
            lines.append(f"  signed by {self.key_id}")
        return "\n".join(lines)


def check_deployment(job: Resource, key: PublicKey, service: Service) -> DeploymentCheck:
    """Verifies that a deployment delivered the files that its attestation covers.

    Args:
        job: The deployment job.
        key: The public key that attestations have to be signed by.
        service: The service, with its catalog and object store.

    Raises:
        StorageError: The object store does not answer.
    """
    batch = DeploymentJobDocument.of(job).required_batch
    if batch is None:
        return _unverified(job, "nothing to verify", "it requires no batch", None)
    stored = Rollouts(service.catalog).rollout(job.arn)
    if stored is None:
        return _unverified(job, "nothing to verify", f"it is {job.status}, and robots have got nothing by it", batch)
    try:
        statement = verified(service.store.get_bytes(service.settings.bucket, envelope_key(job)), key)
    except (ObjectNotFoundError, BucketNotFoundError):
        return _unverified(job, "refuted", "its attestation is gone", batch)
    except AttestationError as error:
        return _unverified(job, "refuted", str(error), batch)
    if (reason := _disagreement(statement, batch, Delivery.of_json(dict(stored.delivery)))) is not None:
        return _told(job, "refuted", reason, statement, key)
    return _told(job, "verified", None, statement, key)


def _disagreement(statement: Statement, batch: str, delivery: Delivery) -> str | None:
    """Explains how an attestation differs from a deployment; `None`: it does not."""
    if statement.batch.uri != batch:
        return f"the attestation is about the batch {statement.batch.uri}, {batch} is required"
    other = unattested(statement, delivery)
    return None if other is None else f"{other}, which the attestation is not about"


def _unverified(job: Resource, answer: Answer, reason: str, batch: str | None) -> DeploymentCheck:
    return DeploymentCheck(deployment=job.arn, answer=answer, reason=reason, batch=batch)


def _told(job: Resource, answer: Answer, reason: str | None, statement: Statement, key: PublicKey) -> DeploymentCheck:
    facts = statement.batch.annotations
    return DeploymentCheck(
        deployment=job.arn,
        answer=answer,
        reason=reason,
        key_id=key.keyid,
        batch=statement.batch.uri,
        verdict=statement.predicate.result,
        jobs=statement.predicate.passed_tests,
        seeds=facts.seeds,
        trials=facts.trials,
        worlds=facts.worlds,
        requirements=facts.requirements,
        archives={archive.name: archive.digest.sha256 for archive in statement.subject},
        simulated=[archive.name for archive in statement.subject if archive.annotations.simulated],
    )
