"""Content of an attestation (in-toto statement v1 with test result v0.1), made of a batch that passed.

The subjects are the archives of a version. Each says whether it ran in the simulations, as simulations run only the
archive for their own machine.
"""

import json
from collections.abc import Mapping
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.alias_generators import to_camel

from ....schemas.documents.applications import ApplicationDocument, StoredSource
from ....schemas.wire.errors import AttestationError
from ...catalog import Resource
from ..application_archives import place_of
from .passed_batch import PassedBatch

STATEMENT_TYPE = "https://in-toto.io/Statement/v1"
PREDICATE_TYPE = "https://in-toto.io/attestation/test-result/v0.1"


class _Attested(BaseModel):
    model_config = ConfigDict(alias_generator=to_camel, validate_by_name=True, frozen=True, extra="forbid")


class Digest(_Attested):
    """SHA-256 digest that identifies a file in an attestation."""

    sha256: str = Field(pattern="^[0-9a-f]{64}$", description="SHA-256, in hexadecimal digits.")


class ArchiveFacts(_Attested):
    """Application, version and architecture of an archive in an attestation, and whether simulations ran it."""

    application: str = Field(description="ARN of its application.")
    version: str = Field(description="Number of its version.")
    architecture: str | None = Field(description="Architecture that the archive runs on; null: any.")
    simulated: bool = Field(description="Whether simulations of the batch ran this very archive.")


class Archive(_Attested):
    """An application archive that was tested, as the subject of an attestation."""

    name: str = Field(description="Application, version and architecture; no two are the same.")
    uri: str = Field(description="Address of the archive when it was tested.")
    digest: Digest = Field(description="Digest of the archive's content.")
    annotations: ArchiveFacts = Field(description="Application, version and architecture of the archive.")


class BatchFacts(_Attested):
    """Numbers of jobs, seeds, trials and worlds of a tested batch, and its requirements, in an attestation."""

    jobs: int = Field(description="How many jobs it had.")
    seeds: int = Field(description="How many different seeds these had.")
    trials: int = Field(description="How many episodes of jobs with trials.")
    worlds: int = Field(description="How many different worlds.")
    requirements: list[str] = Field(description="Names of what the runs were judged by.")


class Configuration(_Attested):
    """Configuration of the tests in an attestation: the simulation batch."""

    name: Literal["simulation job batch"] = Field(default="simulation job batch", description="Kind of test: a batch.")
    uri: str = Field(description="ARN of the batch.")
    digest: Digest = Field(description="Hash of the batch's request, as canonical JSON.")
    annotations: BatchFacts = Field(description="Numbers and requirements of the batch.")


class Predicate(_Attested):
    """Result of the tests in an attestation, as an in-toto predicate."""

    result: Literal["PASSED"] = Field(default="PASSED", description="Result; only passed batches are attested.")
    configuration: tuple[Configuration] = Field(description="How was tested.")
    passed_tests: list[str] = Field(description="Ids of the simulation jobs.")
    warned_tests: list[str] = Field(default=[], max_length=0, description="None: nothing else is ever attested.")
    failed_tests: list[str] = Field(default=[], max_length=0, description="None, likewise.")


class Statement(_Attested):
    """Statement (in-toto format) that an application version has passed a simulation batch."""

    type: Literal["https://in-toto.io/Statement/v1"] = Field(
        default=STATEMENT_TYPE, alias="_type", description="Its form."
    )
    subject: list[Archive] = Field(min_length=1, description="Archives of the version that was tested.")
    predicate_type: Literal["https://in-toto.io/attestation/test-result/v0.1"] = Field(
        default=PREDICATE_TYPE, description="The predicate's form."
    )
    predicate: Predicate = Field(description="The test's result.")

    @property
    def batch(self) -> Configuration:
        """The simulation batch by which the version was tested."""
        (configuration,) = self.predicate.configuration
        return configuration

    @property
    def archives(self) -> frozenset[str]:
        """SHA-256 digests (hexadecimal) of the archives that the statement covers."""
        return frozenset(archive.digest.sha256 for archive in self.subject)

    def to_bytes(self) -> bytes:
        """Returns the statement as canonical JSON: equal statements give equal bytes, which are signed."""
        return json.dumps(self.model_dump(by_alias=True), sort_keys=True, separators=(",", ":")).encode()

    @classmethod
    def of_bytes(cls, payload: bytes) -> "Statement":
        """Parses a statement from its JSON.

        Raises:
            AttestationError: The JSON is not such a statement.
        """
        try:
            return cls.model_validate_json(payload)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            raise AttestationError(
                f"the attestation is no statement of a test result: {place}: {first['msg']}"
            ) from None


def statement_of(batch: PassedBatch, application: Resource, digests: Mapping[str, str]) -> Statement:
    """Makes the statement that an application version has passed a simulation batch.

    Args:
        batch: The batch that passed with it.
        application: The version, as `find_application` finds it.
        digests: SHA-256 of each of its archives, by `place_of`.
    """
    sources = ApplicationDocument.of(application).sources or []
    configuration = Configuration(
        uri=batch.arn,
        digest=Digest(sha256=batch.request_sha256),
        annotations=BatchFacts(
            jobs=len(batch.jobs),
            seeds=len({job.seed for job in batch.jobs}),
            trials=sum(job.trials for job in batch.jobs),
            worlds=len({world for job in batch.jobs for world in job.worlds}),
            requirements=sorted({name for job in batch.jobs for name in job.requirements}),
        ),
    )
    return Statement(
        subject=[_archive(application, source, digests[place_of(source)], batch) for source in sources],
        predicate=Predicate(configuration=(configuration,), passed_tests=[job.id for job in batch.jobs]),
    )


def _archive(application: Resource, source: StoredSource, sha256: str, batch: PassedBatch) -> Archive:
    version = ApplicationDocument.of(application).version
    facts = ArchiveFacts(
        application=application.arn,
        version=version,
        architecture=source.architecture,
        simulated=any(job.etag == source.etag for job in batch.jobs),
    )
    name = f"{application.name}/{version}/{source.architecture or 'any'}"
    return Archive(name=name, uri=place_of(source), digest=Digest(sha256=sha256), annotations=facts)
