"""Flows: deployment jobs: an application brought to the robots of a fleet."""

from typing import Any

from ..schemas.operations.deployment_jobs import DeploymentApplicationConfigs, DeploymentConfig
from ..schemas.operations.robots import FleetMaxResults
from ..schemas.wire.common import Arn, ClientRequestToken, Filters, PaginationToken, TagMap
from .steps import carry_out, operation_flow, order, perform_flow, read, record, validate


@operation_flow
def CreateDeploymentJob(
    *,
    clientRequestToken: ClientRequestToken,
    fleet: Arn,
    deploymentApplicationConfigs: DeploymentApplicationConfigs,
    deploymentConfig: DeploymentConfig | None = None,
    tags: TagMap | None = None,
) -> dict[str, Any]:
    """Deploys an application to the robots of a fleet, in waves."""
    return order("CreateDeploymentJob", locals())


@perform_flow
def PerformDeploymentJob(arn: str) -> dict[str, Any]:
    """Carries the job of an ARN, made by CreateDeploymentJob or SyncDeploymentJob, to its end."""
    return carry_out("CreateDeploymentJob", arn)


@operation_flow
def DescribeDeploymentJob(*, job: Arn) -> dict[str, Any]:
    """Says how a deployment job stands."""
    return read("DescribeDeploymentJob", locals())


@operation_flow
def ListDeploymentJobs(
    *,
    filters: Filters | None = None,
    nextToken: PaginationToken | None = None,
    maxResults: FleetMaxResults | None = None,
) -> dict[str, Any]:
    """Lists deployment jobs, newest first."""
    return read("ListDeploymentJobs", locals())


@operation_flow
def CancelDeploymentJob(*, job: Arn) -> dict[str, Any]:
    """Ends a deployment job early."""
    return record("CancelDeploymentJob", validate("CancelDeploymentJob", locals()))


@operation_flow
def SyncDeploymentJob(*, clientRequestToken: ClientRequestToken, fleet: Arn) -> dict[str, Any]:
    """Repeats a fleet's latest deployment for its robots that are not in sync."""
    return order("SyncDeploymentJob", locals())
