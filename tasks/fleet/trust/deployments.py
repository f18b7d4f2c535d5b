"""Targets that agents download: archives, condition and deployment document."""

import hashlib
import json
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from ....schemas.documents.applications import ApplicationDocument, StoredSource
from ....schemas.documents.fleets import DeploymentJobDocument
from ....schemas.operations.deployment_jobs import DeploymentApplicationConfig, DeploymentConfig
from ....schemas.rollouts.artifacts import Artifact
from ....schemas.wire.errors import DeploymentError
from ...catalog import Resource
from ...service.service import Service
from ..sources import FileHashes, fetch_condition, fetch_source, sources_by_architecture
from .deployment_documents import (
    DeploymentTargets,
    attestation_path,
    bundle_path,
    condition_path,
    document_path,
    suffix_of,
)
from .publishing import Publisher, publisher_of
from .roots import Attested
from .serving import TIMESTAMP_S
from .targets import TargetStep

_MAGIC_BYTES = 2


@dataclass(frozen=True)
class _Bundle:
    target: str
    key: str
    hashes: FileHashes


def publish(
    job: Resource,
    application: Resource,
    architectures: Iterable[str],
    service: Service,
    attestations: Sequence[bytes] = (),
) -> dict[str, Artifact]:
    """Publishes a deployment for agents; all of it becomes visible at once.

    Args:
        job: the deployment job.
        application: the application's version, as `find_application` finds it.
        architectures: those of the robots with agents.
        service: where the archives are, and where the repository is.
        attestations: what others attest of the version, each a signed envelope as JSON.

    Returns:
        What orders say, by architecture; architectures that the application has no archive for are absent.

    Raises:
        DeploymentError: an archive or the condition is gone, may not be read, or has changed; the application has no
            archives at all; or agents would not believe that it was attested.
        StorageError: the object store does not answer.
        ConfigurationError: a key is missing, or the store has what the keys have not signed.
    """
    sources = sources_by_architecture(application, architectures)
    if not sources:
        return {}
    publisher = publisher_of(service)
    asked = DeploymentJobDocument.of(job)
    _check_attested(publisher, application.name, attestations, is_required=asked.required_batch is not None)
    step = TargetStep(publisher, application.name)
    version = ApplicationDocument.of(application).version
    with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
        bundles = _add_bundles(step, sources, version, Path(scratch), service)
        condition = _add_condition(step, job, Path(scratch, "condition"), service)
    attested = [_add_attestation(step, each) for each in attestations]
    (config,) = asked.deployment_application_configs
    document = DeploymentTargets(
        # Not a number of the catalog: one that was restored from a backup would draw the same ones again.
        number=int(job.created_at.timestamp() * 1000),
        job=job.arn,
        fleet=str(job.parent),
        application=application.name,
        version=version,
        bundles={architecture: bundle.target for architecture, bundle in bundles.items()},
        condition=condition,
        launch=DeploymentApplicationConfig.model_validate(config).launchConfig,
        attestations=attested,
        batch=asked.required_batch,
        tags=dict(job.tags),
    )
    target = step.add_bytes(document_path(application.name, job.id), document.to_bytes())
    step.publish()
    time.sleep(TIMESTAMP_S)  # until every server has the new timestamp: a robot that is told now finds the deployment
    return {
        architecture: _artifact(bundle, application.name, version, target, service)
        for architecture, bundle in bundles.items()
    }


def _add_bundles(
    step: TargetStep, sources: Mapping[str, StoredSource], version: str, scratch: Path, service: Service
) -> dict[str, _Bundle]:
    """Adds the archive of each architecture; one that serves several is fetched once."""
    added: dict[tuple[str, str], _Bundle] = {}
    for source in sources.values():
        place = (source.s3_bucket, source.s3_key)
        if place in added:
            continue
        path = scratch / "bundle"
        fetch_source(source, version, path, service)
        hashes = FileHashes.of(path)
        with path.open("rb") as file:
            suffix = suffix_of(file.read(_MAGIC_BYTES))
        target = bundle_path(step.application, hashes.sha256, suffix)
        added[place] = _Bundle(target, step.add_file(target, path, hashes), hashes)
    return {architecture: added[source.s3_bucket, source.s3_key] for architecture, source in sources.items()}


def _add_condition(step: TargetStep, job: Resource, path: Path, service: Service) -> str | None:
    document = DeploymentJobDocument.of(job)
    file = DeploymentConfig.model_validate(document.deployment_config).downloadConditionFile
    if file is None:
        return None
    fetch_condition(file.bucket, file.key, file.etag, path, service)
    hashes = FileHashes.of(path)
    target = condition_path(step.application, hashes.sha256)
    step.add_file(target, path, hashes)
    return target


def _check_attested(
    publisher: Publisher, application: str, attestations: Sequence[bytes], *, is_required: bool
) -> None:
    """Refuses what agents would refuse, before they have an order.

    Robots may go back to a version whose attestation has a key that agents no longer believe, where they need none.
    """
    attested = Attested.of(publisher.root().signed)
    if not attestations and attested.demands(application):
        raise DeploymentError(
            f"agents install no version of {application} that was not attested, and this deployment requires no batch; "
            "give it deploymentConfig.requiresBatch (docs/attestations.md)",
            "MissingRobotDeploymentResource",
        )
    is_read = attested.keys and (is_required or attested.demands(application))
    for envelope in attestations if is_read else ():
        signed_by = {signature["keyid"] for signature in json.loads(envelope)["signatures"]}
        if signed_by.isdisjoint(attested.keys):
            raise DeploymentError(
                f"the attestation is signed by {', '.join(signed_by)}, and agents believe {', '.join(attested.keys)}; "
                "use that key here, or `robomaker robots keys renew-root --attestation-key FILE`",
                "MissingRobotDeploymentResource",
            )


def _add_attestation(step: TargetStep, envelope: bytes) -> str:
    return step.add_bytes(attestation_path(step.application, hashlib.sha256(envelope).hexdigest()), envelope)


def _artifact(bundle: _Bundle, name: str, version: str, target: str, service: Service) -> Artifact:
    return Artifact(
        bucket=service.settings.bucket,
        key=bundle.key,
        file_name=bundle.target.rpartition("/")[2],
        name=name,
        version=version,
        target=target,
        **asdict(bundle.hashes),
    )
