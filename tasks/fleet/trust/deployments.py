"""Files of deployments in the TUF repository that robot agents download: archives, condition program, document."""

# pyright: reportPrivateImportUsage=false

import hashlib
import json
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field
from tuf.api.metadata import TargetFile

from ....schemas.documents.applications import ApplicationDocument, StoredSource
from ....schemas.fleet.documents import DeploymentJobDocument
from ....schemas.fleet.operations.deployment_jobs import (
    DeploymentApplicationConfig,
    DeploymentConfig,
    DeploymentLaunchConfig,
)
from ....schemas.fleet.rollouts.rollout_plan import Artifact
from ....schemas.wire.errors import DeploymentError
from ...catalog import Resource
from ...service.service import Service
from ..application_archives import FileHashes, fetch_condition, fetch_source, sources_by_architecture
from .metadata import Attested, Changes, Repository
from .publishing import Publisher, publisher_of
from .roles import TIMESTAMP_S, application_role, target_folder, target_key


@dataclass
class TargetStep:
    """Files of one application that become visible to robots together in the update repository."""

    publisher: Publisher
    application: str
    _targets: dict[str, TargetFile] = field(default_factory=dict[str, TargetFile])

    def add_file(self, target: str, path: Path, hashes: FileHashes) -> str:
        """Uploads a file for the update repository unless it exists; returns its object-store key.

        Args:
            target: Path of the target.
            path: The file.
            hashes: Length and hashes of the file.

        Returns:
            Object-store key of the file.
        """
        files = self.publisher.files
        key = target_key(target, hashes.sha256)
        files.store.ensure_bucket(files.bucket)
        if files.store.find_same(files.bucket, key, path) is None:
            files.store.put_file(files.bucket, key, path)
        self._targets[target] = TargetFile(hashes.size_bytes, {"sha256": hashes.sha256}, target)
        return key

    def add_bytes(self, target: str, content: bytes) -> str:
        """Uploads a small content for the update repository; returns its target path."""
        files = self.publisher.files
        described = TargetFile.from_data(target, content, ["sha256"])
        files.store.ensure_bucket(files.bucket)
        files.store.put_bytes(files.bucket, target_key(target, described.hashes["sha256"]), content)
        self._targets[target] = described
        return target

    def publish(self) -> None:
        """Makes all added files visible to robots at once; does nothing if they are visible.

        Raises:
            ConfigurationError: A key is missing, or the store has what the keys have not signed.
            StorageError: The store does not answer.
        """
        self.publisher.publish(self._changes, [application_role(self.application)])

    def _changes(self, current: Repository | None) -> Changes | None:
        known = current.applications.get(application_role(self.application)) if current else None
        named = known.signed.targets if known else {}
        if all(named.get(path) == target for path, target in self._targets.items()):
            return None
        return Changes(add={self.application: self._targets})


BundleSuffix = Literal["tar.gz", "zip", "tar"]
"""File name suffix of an archive, by which an agent chooses how to unpack it."""

_GZIP, _ZIP = b"\x1f\x8b", b"PK"


class DeploymentTargets(BaseModel):
    """Content of a deployment document, by which robots' agents find the files to install."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = Field(default=1, description="Version of this document's form; agents refuse others.")
    number: int = Field(description="Rises from deployment to deployment: robots carry out none that is older.")
    job: str = Field(description="ARN of the deployment job.")
    fleet: str = Field(description="ARN of the fleet.")
    application: str = Field(description="Name of the application.")
    version: str = Field(description="Its version.")
    bundles: dict[str, str] = Field(description="Path of the archive, by architecture.")
    condition: str | None = Field(description="Path of the program that is asked before the download; null: none.")
    launch: DeploymentLaunchConfig = Field(description="How the application is started, as on the wire.")
    attestations: list[str] = Field(default=[], description="Paths of what others attest of the version.")
    batch: str | None = Field(default=None, description="ARN of the batch that has to be attested; null: none has to.")
    tags: dict[str, str] = Field(default={}, description="Tags of the deployment job.")

    def to_bytes(self) -> bytes:
        """Returns the document as the bytes that are published."""
        launch = self.launch.model_dump(mode="json", by_alias=True, exclude_none=True)
        return self.model_copy(update={"launch": launch}).model_dump_json(warnings=False).encode()


def document_path(application: str, job_id: str) -> str:
    """Returns the repository path of a deployment job's document."""
    return f"{target_folder(application)}/deployments/{job_id}.json"


def bundle_path(application: str, sha256: str, suffix: BundleSuffix) -> str:
    """Returns the repository path of an application archive."""
    return f"{target_folder(application)}/bundles/{sha256}.{suffix}"


def condition_path(application: str, sha256: str) -> str:
    """Returns the repository path of a condition program, which robots run before a download."""
    return f"{target_folder(application)}/conditions/{sha256}"


def attestation_path(application: str, sha256: str) -> str:
    """Returns the repository path of an attestation."""
    return f"{target_folder(application)}/attestations/{sha256}.json"


def suffix_of(beginning: bytes) -> BundleSuffix:
    """Returns the file name suffix of an archive, recognised by its first bytes."""
    if beginning.startswith(_GZIP):
        return "tar.gz"
    return "zip" if beginning.startswith(_ZIP) else "tar"


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
    """Publishes a deployment's files to the agents on robots, all at once.

    Args:
        job: The deployment job.
        application: The application's version, as `find_application` finds it.
        architectures: CPU architectures of the robots with agents.
        service: The service, with its catalog and object store.
        attestations: Attestations of the version, each a signed envelope as JSON.

    Returns:
        Files for orders to robots, by architecture; architectures without an archive are absent.

    Raises:
        DeploymentError: An archive or the condition is gone, may not be read, or has changed; the application has no
            archives at all; or agents would not believe that it was attested.
        StorageError: The object store does not answer.
        ConfigurationError: A key is missing, or the store has what the keys have not signed.
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
    """Adds the archive of each architecture to the repository.

    One that serves several architectures is fetched once.
    """
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
    """Raises an error, before robots get orders, for a deployment that agents would refuse for its attestations.

    Where no attestation is needed, robots may return to a version whose attestation has a key that is no longer
    accepted.
    """
    attested = Attested.of(publisher.root().signed)
    if not attestations and attested.demands(application):
        raise DeploymentError(
            f"agents install no version of {application} that was not attested, and this deployment requires no batch; "
            "give it deploymentConfig.requiresBatch (docs/fleet/attestations.md)",
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
