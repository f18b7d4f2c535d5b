"""Whether a simulation job batch has passed with an application version.

Each job has to be judged PASS, and to have run one of the version's archives.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ....schemas.documents.applications import ApplicationDocument
from ....schemas.documents.simulation_jobs import SimulationJobBatchDocument, SimulationJobDocument
from ....schemas.lifecycles import is_terminal
from ....schemas.runs.trials import Trials
from ....schemas.wire.common import counted
from ....schemas.wire.errors import DeploymentError, ResourceNotFoundException
from ...catalog import Resource
from ...service.service import Service
from ..application_archives import place_of

BATCH = "simulation-job-batch"
JOB = "simulation-job"

_NOT_PASSED = "MissingRobotDeploymentResource"
_LATEST = "$LATEST"


@dataclass(frozen=True)
class PassedJob:
    """A simulation job that passed, as an attestation names it."""

    id: str
    etag: str
    """Digest (ETag) of the archive that the job ran."""

    seed: int
    trials: int
    """Number of episodes; 0 for a job without trials."""

    worlds: frozenset[str]
    requirements: tuple[str, ...]


@dataclass(frozen=True)
class PassedBatch:
    """A simulation job batch in which every job passed."""

    arn: str
    request_sha256: str
    jobs: tuple[PassedJob, ...]


@dataclass(frozen=True)
class RunningBatch:
    """A simulation job batch that is still running and may pass."""

    why: str
    """Reason why the batch has no result yet, in words: the batch or its jobs are still running."""


@dataclass(frozen=True)
class StoredBatch:
    """A simulation job batch with its jobs in request order, as read from the catalog."""

    batch: Resource
    jobs: tuple[Resource, ...]

    @classmethod
    def of(cls, arn: str, service: Service) -> "StoredBatch":
        """Reads a simulation job batch and its jobs from the catalog.

        Raises:
            DeploymentError: The catalog has no such batch.
        """
        try:
            batch = service.catalog.get(arn, kind=BATCH)
        except ResourceNotFoundException as error:
            raise DeploymentError(f"the required batch is gone: {error}", _NOT_PASSED) from error
        jobs = service.catalog.children(arn, kind=JOB)
        return cls(batch, tuple(sorted(jobs, key=lambda job: SimulationJobDocument.of(job).request_index or 0)))


def judge(stored: StoredBatch, application: Resource) -> PassedBatch | RunningBatch:
    """Determines whether a simulation batch has passed with an application version, or is still running.

    Args:
        stored: The batch.
        application: The version, as `find_application` finds it.

    Raises:
        DeploymentError: The batch has not passed, and cannot pass any more; the message names the job and the
            requirement that it missed.
    """
    document = SimulationJobBatchDocument.of(stored.batch)
    arn = stored.batch.arn
    for index, failed in sorted(document.failed.items(), key=lambda item: int(item[0])):
        raise DeploymentError(
            f"request {index} of the required batch {arn} never became a job: {failed.failure_reason}", _NOT_PASSED
        )
    judged = [_judge_job(job, arn, application) for job in stored.jobs]
    running = [each for each in judged if isinstance(each, RunningBatch)]
    if not is_terminal(BATCH, stored.batch.status):
        return RunningBatch(f"batch {arn} is {stored.batch.status}")
    if stored.batch.status != "Completed":
        why = f": {document.failure_reason}" if document.failure_reason else ""
        raise DeploymentError(f"the required batch {arn} is {stored.batch.status}{why}", _NOT_PASSED)
    if running:
        return running[0]
    passed = tuple(each for each in judged if isinstance(each, PassedJob))
    if not passed or len(passed) != len(document.requests):
        raise DeploymentError(
            f"the required batch {arn} has {counted(len(passed), 'job')} of "
            f"{counted(len(document.requests), 'request')}; "
            "each has to be there, and to have passed",
            _NOT_PASSED,
        )
    return PassedBatch(arn, _hash_of(document.request), passed)


def application_of(stored: StoredBatch) -> tuple[str, str]:
    """Returns the robot application (ARN or name, and version) that a batch's first job ran.

    Raises:
        DeploymentError: The batch has no jobs, or none with a robot application.
    """
    for job in stored.jobs:
        if config := _robot_application(SimulationJobDocument.of(job)):
            return config["application"], config.get("applicationVersion") or _LATEST
    raise DeploymentError(f"{stored.batch.arn} has no job that ran a robot application", _NOT_PASSED)


def _judge_job(job: Resource, batch: str, application: Resource) -> PassedJob | RunningBatch:
    document = SimulationJobDocument.of(job)
    name = f"job {job.id} of the required batch {batch}"
    if not is_terminal(JOB, job.status):
        return RunningBatch(f"{name} is {job.status}")
    if job.status != "Completed":
        raise DeploymentError(f"{name} is {job.status}: {document.failure_reason or 'no reason is known'}", _NOT_PASSED)
    if document.verdict in (None, "NONE"):
        raise DeploymentError(f"{name} has no verdict; give it requirements that it is judged by", _NOT_PASSED)
    if document.verdict != "PASS":
        why = document.verdict_reason or "no reason is known"
        raise DeploymentError(f"{name} has the verdict {document.verdict}: {why}", _NOT_PASSED)
    return PassedJob(
        id=job.id,
        etag=_ran(document, name, application),
        seed=document.seed,
        trials=Trials.model_validate(document.trials).count if document.trials else 0,
        worlds=frozenset(_worlds(document.request)),
        requirements=tuple(str(requirement["name"]) for requirement in document.requirements),
    )


def _ran(document: SimulationJobDocument, name: str, application: Resource) -> str:
    """Returns the ETag of the archive that a job ran, after checking that it is one of the version's archives.

    Raises DeploymentError if the job ran another application, no archive, or another archive.
    """
    config = _robot_application(document)
    if config is None or config["application"] not in (application.arn, application.name):
        other = "no robot application" if config is None else config["application"]
        raise DeploymentError(f"{name} ran {other}, not {application.arn}, which is deployed", _NOT_PASSED)
    version = ApplicationDocument.of(application)
    etag = document.made_of.robot_etag if document.made_of else None
    if etag is None:
        raise DeploymentError(
            f"{name} ran no archive of {application.name}, so what it ran cannot be what robots get",
            _NOT_PASSED,
        )
    archives = [f"{place_of(source)} ({source.etag})" for source in version.sources or []]
    if etag not in {source.etag for source in version.sources or []}:
        raise DeploymentError(
            f"{name} ran another archive of {application.name}, with ETag {etag}; "
            f"version {version.version} has {', '.join(archives)}",
            "EtagMismatch",
        )
    return etag


def _robot_application(document: SimulationJobDocument) -> Mapping[str, Any] | None:
    configs: Sequence[Mapping[str, Any]] = document.request.get("robotApplications") or ()
    return configs[0] if configs else None


def _worlds(request: Mapping[str, Any]) -> set[str]:
    configs = request.get("simulationApplications") or ()
    return {str(each["world"]) for config in configs for each in config.get("worldConfigs") or () if each.get("world")}


def _hash_of(request: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(request, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
