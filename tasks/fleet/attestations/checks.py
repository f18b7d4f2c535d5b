"""Verifies what a deployment delivered: that it is what its required batch passed with, and who says so."""

from typing import Literal

from pydantic import Field

from ....schemas.documents.fleets import DeploymentJobDocument
from ....schemas.exit_codes import BROKE, OK, VERDICT_FAILED
from ....schemas.rollouts.artifacts import Delivery
from ....schemas.wire.base import Model
from ....schemas.wire.errors import AttestationError, BucketNotFoundError, ObjectNotFoundError
from ...catalog import Resource
from ...service.service import Service
from .attestation_keys import PublicKey
from .envelopes import verified
from .required_batches import envelope_key, unattested
from .statements import Statement

Answer = Literal["verified", "refuted", "nothing to verify"]

EXIT_CODES: dict[Answer, int] = {"verified": OK, "refuted": VERDICT_FAILED, "nothing to verify": BROKE}
"""Exit codes of the command line, by answer."""


class DeploymentCheck(Model):
    """Whether a deployment delivered what had passed."""

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
    """Verifies a deployment.

    Args:
        job: the deployment job.
        key: the public key that attestations have to be signed by.
        service: where it is stored.

    Raises:
        StorageError: the object store does not answer.
    """
    batch = DeploymentJobDocument.of(job).required_batch
    if batch is None:
        return _unverified(job, "nothing to verify", "it requires no batch", None)
    stored = service.catalog.rollout(job.arn)
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
