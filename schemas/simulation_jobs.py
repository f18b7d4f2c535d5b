"""Simulation jobs: a robot application, a simulation application, or both, run until the end or a limit."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from .base import Shape
from .common import (
    Arn,
    Arns,
    ClientRequestToken,
    GenericString,
    IamRole,
    JobDuration,
    Name,
    OptionalOutputLocation,
    Seed,
    TagMap,
    Timestamp,
)
from .operation_shape import CREATE_EXPORT_ERRORS, LIMIT, READ_ERRORS, OperationShape
from .simulation_job_configs import (
    Compute,
    ComputeResponse,
    ComputeType,
    DataSource,
    DataSourceConfigs,
    LoggingConfig,
    NetworkInterface,
    RobotApplicationConfigs,
    SimulationApplicationConfigs,
    VPCConfig,
    VPCConfigResponse,
)
from .simulation_run import VideoPolicy

FailureBehavior = Literal["Fail", "Continue"]
SimulationJobStatus = Literal[
    "Pending",
    "Preparing",
    "Running",
    "Restarting",
    "Completed",
    "Failed",
    "RunningFailed",
    "Terminating",
    "Terminated",
    "Canceled",
]
SimulationJobErrorCode = Literal[
    "InternalServiceError",
    "RobotApplicationCrash",
    "SimulationApplicationCrash",
    "RobotApplicationHealthCheckFailure",
    "SimulationApplicationHealthCheckFailure",
    "BadPermissionsRobotApplication",
    "BadPermissionsSimulationApplication",
    "BadPermissionsS3Object",
    "BadPermissionsS3Output",
    "BadPermissionsCloudwatchLogs",
    "SubnetIpLimitExceeded",
    "ENILimitExceeded",
    "BadPermissionsUserCredentials",
    "InvalidBundleRobotApplication",
    "InvalidBundleSimulationApplication",
    "InvalidS3Resource",
    "ThrottlingError",
    "LimitExceeded",
    "MismatchedEtag",
    "RobotApplicationVersionMismatchedEtag",
    "SimulationApplicationVersionMismatchedEtag",
    "ResourceNotFound",
    "RequestThrottled",
    "BatchTimedOut",
    "BatchCanceled",
    "InvalidInput",
    "WrongRegionS3Bucket",
    "WrongRegionS3Output",
    "WrongRegionRobotApplication",
    "WrongRegionSimulationApplication",
    "UploadContentMismatchError",
]


class SimulationJobOrder(Shape):
    """What an order for one job says, on its own or in a batch."""

    outputLocation: OptionalOutputLocation = Field(
        default=None, description="Where outputs are put; absent or empty: the configured bucket."
    )
    loggingConfig: LoggingConfig | None = Field(default=None, description="What is recorded.")
    maxJobDurationInSeconds: JobDuration = Field(
        description="Wall-clock limit in seconds, 1 to 1209600; reaching it ends the job normally."
    )
    failureBehavior: FailureBehavior | None = Field(
        default=None, description="What happens after a crash; both Fail (the default) and Continue end the job."
    )
    robotApplications: RobotApplicationConfigs | None = Field(default=None, description="The robot application.")
    simulationApplications: SimulationApplicationConfigs | None = Field(
        default=None, description="The simulation application."
    )
    dataSources: DataSourceConfigs | None = Field(default=None, description="Objects the job reads, at most 6 sources.")
    tags: TagMap | None = Field(default=None, description="Tags for the job.")
    vpcConfig: VPCConfig | None = Field(default=None, description="Network of the job.")
    compute: Compute | None = Field(default=None, description="What the job may use of the machine.")
    seed: Seed | None = Field(default=None, description="Extension: seed of the run's random generators.")
    video: VideoPolicy | None = Field(default=None, description="Extension: whether a video is made.")

    @model_validator(mode="after")
    def _members_agree(self) -> Self:
        applications = [*(self.robotApplications or []), *(self.simulationApplications or [])]
        if not applications:
            raise ValueError("at least one of robotApplications and simulationApplications has to be given")
        uploads = any(each.uploadConfigurations or each.useDefaultUploadConfigurations for each in applications)
        if uploads and self.outputLocation is None:
            raise ValueError("uploadConfigurations need an outputLocation; add outputLocation.s3Bucket")
        return self


class CreateSimulationJobRequest(SimulationJobOrder):
    """Orders one job."""

    clientRequestToken: ClientRequestToken | None = Field(
        default=None, description="Makes the call repeatable: the same token and request give the same job."
    )
    iamRole: IamRole = Field(description="ARN of the role whose rights the job has.")


class SimulationJobRequest(SimulationJobOrder):
    """Orders one job of a batch."""

    iamRole: IamRole | None = Field(default=None, description="ARN of the role whose rights the job has.")
    useDefaultApplications: bool | None = Field(default=None, description="Whether the usual tools run beside it.")


class CreateSimulationJobResponse(Shape):
    """The job as it was accepted."""

    arn: Arn | None = Field(default=None, description="ARN of the job.")
    status: SimulationJobStatus | None = Field(default=None, description="Where the job is in its life.")
    lastStartedAt: Timestamp | None = Field(default=None, description="When it last began to run.")
    lastUpdatedAt: Timestamp | None = Field(default=None, description="When it last changed.")
    failureBehavior: FailureBehavior | None = Field(default=None, description="What happens after a crash.")
    failureCode: SimulationJobErrorCode | None = Field(default=None, description="Why it failed; absent if not.")
    clientRequestToken: ClientRequestToken | None = Field(default=None, description="The request's token.")
    outputLocation: OptionalOutputLocation = Field(default=None, description="Where outputs are put.")
    loggingConfig: LoggingConfig | None = Field(default=None, description="What is recorded.")
    maxJobDurationInSeconds: JobDuration | None = Field(default=None, description="Wall-clock limit in seconds.")
    simulationTimeMillis: int | None = Field(default=None, description="How long the job has run, in milliseconds.")
    iamRole: IamRole | None = Field(default=None, description="ARN of the role whose rights the job has.")
    robotApplications: RobotApplicationConfigs | None = Field(default=None, description="The robot application.")
    simulationApplications: SimulationApplicationConfigs | None = Field(
        default=None, description="The simulation application."
    )
    dataSources: list[DataSource] | None = Field(default=None, description="Objects the job reads.")
    tags: TagMap | None = Field(default=None, description="The job's tags; always sent.")
    vpcConfig: VPCConfigResponse | None = Field(default=None, description="Network of the job.")
    compute: ComputeResponse | None = Field(default=None, description="What the job may use of the machine.")


class SimulationJob(CreateSimulationJobResponse):
    """One job."""

    name: Name | None = Field(default=None, description="Its name: the last part of its ARN.")
    failureReason: GenericString | None = Field(default=None, description="Why it failed, in words.")
    networkInterface: NetworkInterface | None = Field(default=None, description="Its address, once it runs.")


class DescribeSimulationJobRequest(Shape):
    """Asks for one job."""

    job: Arn = Field(description="ARN of the job.")


class DescribeSimulationJobResponse(SimulationJob):
    """One job."""


class BatchDescribeSimulationJobRequest(Shape):
    """Asks for several jobs."""

    jobs: Arns = Field(description="ARNs of the jobs, 1 to 100.")


class BatchDescribeSimulationJobResponse(Shape):
    """Several jobs."""

    jobs: list[SimulationJob] | None = Field(default=None, description="Those that were found.")
    unprocessedJobs: list[Arn] | None = Field(default=None, description="ARNs of the others.")


class SimulationJobSummary(Shape):
    """One job in a list."""

    arn: Arn | None = Field(default=None, description="ARN of the job.")
    lastUpdatedAt: Timestamp | None = Field(default=None, description="When it last changed.")
    name: Name | None = Field(default=None, description="Its name: the last part of its ARN.")
    status: SimulationJobStatus | None = Field(default=None, description="Where the job is in its life.")
    simulationApplicationNames: list[Name] | None = Field(default=None, description="Its simulation application.")
    robotApplicationNames: list[Name] | None = Field(default=None, description="Its robot application.")
    dataSourceNames: list[Name] | None = Field(default=None, description="Its data sources.")
    computeType: ComputeType | None = Field(default=None, description="With or without a GPU.")


SimulationJobRequests = Annotated[list[SimulationJobRequest], Field(min_length=1, max_length=1000)]


OPERATIONS = (
    OperationShape(
        "CreateSimulationJob",
        CreateSimulationJobRequest,
        CreateSimulationJobResponse,
        (*CREATE_EXPORT_ERRORS, LIMIT),
        "Runs one simulation.",
        is_job=True,
    ),
    OperationShape(
        "DescribeSimulationJob",
        DescribeSimulationJobRequest,
        DescribeSimulationJobResponse,
        READ_ERRORS,
        "Says how far a simulation job is, and how it ended.",
    ),
    OperationShape(
        "BatchDescribeSimulationJob",
        BatchDescribeSimulationJobRequest,
        BatchDescribeSimulationJobResponse,
        READ_ERRORS,
        "Says the same of up to 100 simulation jobs.",
    ),
)
