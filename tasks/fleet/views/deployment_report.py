"""Collects the data of a deployment's report from the catalog, and writes the report."""

from collections.abc import Iterator
from pathlib import Path

from ....schemas.fleet.documents import DeploymentJobDocument
from ....schemas.fleet.operations.deployment_jobs import DeploymentConfig
from ....schemas.fleet.rollouts.rollout import DeploymentReport, Pause, Rollout
from ....schemas.fleet.rollouts.rollout_plan import Delivery
from ....schemas.wire.arns import ResourceArn
from ...catalog import Resource
from ...service.service import Service
from ..catalog_rollouts import Rollouts
from ..reporting.deployment_page import write_deployment
from ..rollout.maintenance_windows import closed_spans
from ..rollout.waves import waves_of
from .fleet_standings import deployed_by, deployment_standing
from .rollout_tables import notes_of

_FOLDER = "deployments"


def report_path(job: Resource, service: Service) -> Path:
    """Returns the path of a deployment job's HTML report in the data home."""
    return service.folder(_FOLDER) / f"{job.id}.html"


def write_report(job: Resource, service: Service, path: Path | None = None) -> Path:
    """Writes the HTML report of a deployment in its current state.

    Args:
        job: The deployment job.
        service: The service, with its catalog and object store.
        path: The file; absent: `report_path`.

    Returns:
        The file.

    Raises:
        ServiceUnavailableException: The catalog does not answer.
    """
    return write_deployment(report_of(job, service), path or report_path(job, service))


def report_of(job: Resource, service: Service) -> DeploymentReport:
    """Collects the content of a deployment job's report."""
    document = DeploymentJobDocument.of(job)
    stored = Rollouts(service.catalog).rollout(job.arn)
    rollout = None if stored is None else Rollout.of_json(dict(stored.rollout))
    application, version = deployed_by(job)
    now_s = service.clock().timestamp()
    return DeploymentReport.model_validate(
        {
            "job": job.arn,
            "fleet": fleet_name(job),
            "application": application,
            "version": version,
            "status": job.status,
            "failure_code": document.failure_code,
            "failure_reason": document.failure_reason,
            "created_s": job.created_at.timestamp(),
            "now_s": now_s,
            "config": DeploymentConfig.model_validate(document.deployment_config),
            "delivery": None if stored is None else Delivery.of_json(dict(stored.delivery)),
            "rollout": rollout,
            "notes": tuple(notes_of(deployment_standing(job, rollout, now_s))),
            "closed": () if rollout is None else tuple(_closed(rollout, now_s)),
            "waves": () if rollout is None else tuple(waves_of(rollout.plan)),
        }
    )


def _closed(rollout: Rollout, now_s: float) -> Iterator[Pause]:
    until_s = now_s if rollout.ended_s is None else rollout.ended_s
    for from_s, to_s in closed_spans(rollout.plan.windows, rollout.began_s, until_s):
        yield Pause(from_s=from_s, until_s=to_s)


def fleet_name(job: Resource) -> str:
    """Returns the name of the fleet that a deployment job is for."""
    return ResourceArn.parse(str(job.parent)).name
