"""Flows: simulation jobs: one robot, one world, one run."""

from typing import Any

from ..schemas.operations.simulation_jobs import FailureBehavior, SimulationJobMaxResults
from ..schemas.runs.plan import VideoPolicy
from ..schemas.runs.requirements import JobRequirements
from ..schemas.runs.trials import Trials
from ..schemas.wire.common import (
    Arn,
    Arns,
    ClientRequestToken,
    Filters,
    IamRole,
    JobDuration,
    OptionalOutputLocation,
    PaginationToken,
    Seed,
    TagMap,
)
from ..schemas.wire.job_configs import (
    Compute,
    DataSourceConfigs,
    LoggingConfig,
    RobotApplicationConfigs,
    SimulationApplicationConfigs,
    VPCConfig,
)
from .steps import carry_out, operation_flow, order, perform_flow, read, record, validate


@operation_flow
def CreateSimulationJob(
    *,
    maxJobDurationInSeconds: JobDuration,
    iamRole: IamRole,
    outputLocation: OptionalOutputLocation = None,
    loggingConfig: LoggingConfig | None = None,
    failureBehavior: FailureBehavior | None = None,
    robotApplications: RobotApplicationConfigs | None = None,
    simulationApplications: SimulationApplicationConfigs | None = None,
    dataSources: DataSourceConfigs | None = None,
    tags: TagMap | None = None,
    vpcConfig: VPCConfig | None = None,
    compute: Compute | None = None,
    seed: Seed | None = None,
    trials: Trials | None = None,
    video: VideoPolicy | None = None,
    requirements: JobRequirements | None = None,
    clientRequestToken: ClientRequestToken | None = None,
) -> dict[str, Any]:
    """Runs one simulation."""
    return order("CreateSimulationJob", locals())


@perform_flow
def PerformSimulationJob(arn: str) -> dict[str, Any]:
    """Carries the job of an ARN, made by CreateSimulationJob, to its end."""
    return carry_out("CreateSimulationJob", arn)


@operation_flow
def DescribeSimulationJob(*, job: Arn) -> dict[str, Any]:
    """Says how far a simulation job is, and how it ended."""
    return read("DescribeSimulationJob", locals())


@operation_flow
def BatchDescribeSimulationJob(*, jobs: Arns) -> dict[str, Any]:
    """Says the same of up to 100 simulation jobs."""
    return read("BatchDescribeSimulationJob", locals())


@operation_flow
def ListSimulationJobs(
    *,
    nextToken: PaginationToken | None = None,
    maxResults: SimulationJobMaxResults | None = None,
    filters: Filters | None = None,
) -> dict[str, Any]:
    """Lists simulation jobs, newest first."""
    return read("ListSimulationJobs", locals())


@operation_flow
def CancelSimulationJob(*, job: Arn) -> dict[str, Any]:
    """Stops a simulation job; its outputs are stored."""
    return record("CancelSimulationJob", validate("CancelSimulationJob", locals()))


@operation_flow
def RestartSimulationJob(*, job: Arn) -> dict[str, Any]:
    """Runs a running simulation job again from the start."""
    return record("RestartSimulationJob", validate("RestartSimulationJob", locals()))
