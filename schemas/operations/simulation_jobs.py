"""Operations on simulation jobs: a robot application, a simulation application, or both, run with a time limit."""

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, model_validator

from ..runs.plan import VideoPolicy
from ..runs.policies import Policy, wrong_policy
from ..runs.recording_sources import wrong_sources
from ..runs.requirements import JobRequirements, wrong_requirements
from ..runs.ros_options import wrong_ros
from ..runs.trials import Trials, wrong_trials
from ..wire.base import STORED, Shape, ShapeName, optional
from ..wire.common import (
    AnsweredArns,
    Arn,
    Arns,
    ClientRequestToken,
    Filters,
    GenericString,
    IamRole,
    JobDuration,
    JobReference,
    LastStartedAt,
    LastUpdatedAt,
    Name,
    OptionalOutputLocation,
    PageRequest,
    PaginationToken,
    Seed,
    raise_all,
)
from ..wire.job_configs import (
    Compute,
    ComputeResponse,
    ComputeType,
    DataSourceConfigs,
    DataSources,
    LoggingConfig,
    NetworkInterface,
    RobotApplicationConfig,
    RobotApplicationConfigs,
    SimulationApplicationConfigs,
    VPCConfig,
    VPCConfigResponse,
)
from ..wire.operation_shape import CREATE_EXPORT_ERRORS, LIMIT, LIST_ERRORS, READ_ERRORS, OperationShape
from ..wire.tags import TagMap

FailureBehavior = Annotated[Literal["Fail", "Continue"], ShapeName("FailureBehavior")]
SimulationJobStatus = Annotated[
    Literal[
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
    ],
    ShapeName("SimulationJobStatus"),
]
SimulationJobErrorCode = Annotated[
    Literal[
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
    ],
    ShapeName("SimulationJobErrorCode"),
]
SimulationTimeMillis = Annotated[int, ShapeName("SimulationTimeMillis", wire_type="long")]


class SimulationJobRequestMembers(Shape):
    """Members that requests for a simulation job share, whether the job is on its own or in a batch."""

    outputLocation: OptionalOutputLocation = optional(
        "Location of the outputs; absent or empty: the configured bucket."
    )
    loggingConfig: LoggingConfig | None = optional("Settings of the recording.")
    maxJobDurationInSeconds: JobDuration = Field(
        description="Wall-clock limit in seconds, 1 to 1209600; reaching it ends the job normally."
    )
    failureBehavior: FailureBehavior | None = optional(
        "After a crash Fail (the default) ends the job, Continue leaves the rest running."
    )
    robotApplications: RobotApplicationConfigs | None = optional("The robot application.")
    simulationApplications: SimulationApplicationConfigs | None = optional("The simulation application.")
    dataSources: DataSourceConfigs | None = optional("Objects the job reads, at most 6 sources.")
    tags: TagMap | None = optional("Tags for the job.")
    vpcConfig: VPCConfig | None = optional("Network of the job.")
    compute: Compute | None = optional("Limits on the job's use of the machine.")
    seed: Seed | None = optional("Extension: seed of the run's random generators.")
    video: VideoPolicy | None = optional(
        "Extension: whether a video is made: none (the default), always, or if the run fails."
    )
    requirements: JobRequirements | None = optional(
        "Extension: what the robot has to do, or must not do, for the verdict PASS."
    )
    trials: Trials | None = optional(
        "Extension: episodes that are run one after the other, each with a seed of its own."
    )
    policy: Policy | None = optional(
        "Extension: what drives the robot: a Python callable, `package.module:function`, or an ONNX file; of the robot "
        "application, if there is one."
    )

    @model_validator(mode="after")
    def _members_agree(self, info: ValidationInfo) -> Self:
        if info.context is STORED:
            return self
        applications = [*(self.robotApplications or []), *(self.simulationApplications or [])]
        if not applications:
            raise ValueError("at least one of robotApplications and simulationApplications has to be given")
        raise_all(self._disagreements(applications))
        return self

    def _disagreements(self, applications: Sequence[RobotApplicationConfig]) -> Iterator[str]:
        """Yields problems of members that contradict each other, including texts of launch variables."""
        uploads = any(each.uploadConfigurations or each.useDefaultUploadConfigurations for each in applications)
        if uploads and self.outputLocation is None:
            yield "uploadConfigurations need an outputLocation; add outputLocation.s3Bucket"
        yield from wrong_requirements(self)
        yield from wrong_trials(self)
        yield from wrong_ros(self)
        yield from wrong_sources(self)
        yield from wrong_policy(self)


class CreateSimulationJobRequest(SimulationJobRequestMembers):
    """Request of `CreateSimulationJob`: starts one simulation job."""

    clientRequestToken: ClientRequestToken | None = optional(
        "Makes the call repeatable: the same token and request give the same job."
    )
    iamRole: IamRole = Field(description="ARN of the role whose rights the job has.")


class SimulationJobRequest(SimulationJobRequestMembers):
    """Request for one simulation job of a batch."""

    iamRole: IamRole | None = optional("ARN of the role whose rights the job has.")
    useDefaultApplications: bool | None = optional("Whether the usual tools run beside it.")


class CreateSimulationJobResponse(Shape):
    """Response of `CreateSimulationJob`: the accepted simulation job."""

    arn: Arn | None = optional("ARN of the job.")
    status: SimulationJobStatus | None = optional("Status of the job.")
    lastStartedAt: LastStartedAt | None = optional("When it last began to run.")
    lastUpdatedAt: LastUpdatedAt | None = optional("When it last changed.")
    failureBehavior: FailureBehavior | None = optional("Behavior after a crash.")
    failureCode: SimulationJobErrorCode | None = optional("Why it failed; absent if not.")
    clientRequestToken: ClientRequestToken | None = optional("The request's token.")
    outputLocation: OptionalOutputLocation = optional("Location of the outputs.")
    loggingConfig: LoggingConfig | None = optional("Settings of the recording.")
    maxJobDurationInSeconds: JobDuration | None = optional("Wall-clock limit in seconds.")
    simulationTimeMillis: SimulationTimeMillis | None = optional("How long the job has run, in milliseconds.")
    iamRole: IamRole | None = optional("ARN of the role whose rights the job has.")
    robotApplications: RobotApplicationConfigs | None = optional("The robot application.")
    simulationApplications: SimulationApplicationConfigs | None = optional("The simulation application.")
    dataSources: DataSources | None = optional("Objects the job reads.")
    tags: TagMap | None = optional("The job's tags; always sent.")
    vpcConfig: VPCConfigResponse | None = optional("Network of the job.")
    compute: ComputeResponse | None = optional("Limits on the job's use of the machine.")


VerdictName = Annotated[Literal["PASS", "FAIL", "ERROR", "NONE"], ShapeName("Verdict")]


class VerdictCounts(Shape):
    """Numbers of requirements, or of trials, by how they were judged."""

    passed: int | None = optional("Number of those that were met, or passed.")
    failed: int | None = optional("Number of those that were missed, or failed.")
    errors: int | None = optional("Number of those that could not be judged.")


class JobVerdict(Shape):
    """Verdict on the robot of a job, as in reports; the job's status says only that the run ended as it should."""

    verdict: VerdictName | None = optional("PASS, FAIL, ERROR where something could not be judged, or NONE.")
    reason: GenericString | None = optional("Why it is FAIL or ERROR, in words.")
    requirements: VerdictCounts | None = optional("Its requirements that count; absent: it has trials.")
    trials: VerdictCounts | None = optional("Its trials; absent: it has none.")


class SimulationJob(CreateSimulationJobResponse):
    """Full description of one simulation job."""

    name: Name | None = optional("Its name: the last part of its ARN.")
    failureReason: GenericString | None = optional("Why it failed, in words.")
    networkInterface: NetworkInterface | None = optional("Its address, once it runs.")
    verdict: JobVerdict | None = optional(
        "Extension: what the robot did; absent: the job has not completed, or was not judged."
    )


class DescribeSimulationJobRequest(JobReference):
    """Request of `DescribeSimulationJob`: names the simulation job to describe."""


class DescribeSimulationJobResponse(SimulationJob):
    """Response of `DescribeSimulationJob`: full description of one simulation job."""


class BatchDescribeSimulationJobRequest(Shape):
    """Request of `BatchDescribeSimulationJob`: names the simulation jobs to describe."""

    jobs: Arns = Field(description="ARNs of the jobs, 1 to 100.")


class BatchDescribeSimulationJobResponse(Shape):
    """Response of `BatchDescribeSimulationJob`: the simulation jobs in full, and the ARNs that were not found."""

    jobs: Annotated[list[SimulationJob], ShapeName("SimulationJobs")] | None = optional("Those that were found.")
    unprocessedJobs: AnsweredArns | None = optional("ARNs of the others.")


RobotApplicationNames = Annotated[list[Name], ShapeName("RobotApplicationNames")]
SimulationApplicationNames = Annotated[list[Name], ShapeName("SimulationApplicationNames")]
DataSourceNames = Annotated[list[Name], ShapeName("DataSourceNames")]


class SimulationJobSummary(Shape):
    """Summary of a simulation job, as `ListSimulationJobs` shows it."""

    arn: Arn | None = optional("ARN of the job.")
    lastUpdatedAt: LastUpdatedAt | None = optional("When it last changed.")
    name: Name | None = optional("Its name: the last part of its ARN.")
    status: SimulationJobStatus | None = optional("Status of the job.")
    simulationApplicationNames: SimulationApplicationNames | None = optional("Its simulation application.")
    robotApplicationNames: RobotApplicationNames | None = optional("Its robot application.")
    dataSourceNames: DataSourceNames | None = optional("Its data sources.")
    computeType: ComputeType | None = optional("With or without a GPU.")


SimulationJobRequests = Annotated[
    list[SimulationJobRequest], ShapeName("CreateSimulationJobRequests"), Field(min_length=1, max_length=1000)
]

SimulationJobSummaries = Annotated[list[SimulationJobSummary], ShapeName("SimulationJobSummaries", 0, 100)]
SimulationJobMaxResults = Annotated[int, ShapeName("MaxResults"), Field(ge=1, le=1000)]


class ListSimulationJobsRequest(PageRequest):
    """Request of `ListSimulationJobs`: asks for a page of simulation jobs, newest first."""

    maxResults: SimulationJobMaxResults | None = optional(
        "Entries per page, 1 to 1000; a page never has more than 100."
    )
    filters: Filters | None = optional(
        "Filter by `status`, `simulationApplicationName` or `robotApplicationName`; absent: all jobs."
    )


class ListSimulationJobsResponse(Shape):
    """Response of `ListSimulationJobs`: one page of simulation jobs."""

    simulationJobSummaries: SimulationJobSummaries = Field(description="Jobs, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class CancelSimulationJobRequest(JobReference):
    """Request of `CancelSimulationJob`: names the simulation job to cancel."""


class CancelSimulationJobResponse(Shape):
    """Response of `CancelSimulationJob`: empty; the job ends soon, or has ended."""


class RestartSimulationJobRequest(Shape):
    """Request of `RestartSimulationJob`: names the running simulation job to restart."""

    job: Arn = Field(description="ARN of the job; it has to be running.")


class RestartSimulationJobResponse(Shape):
    """Response of `RestartSimulationJob`: empty, the job is restarting."""


OPERATIONS = (
    OperationShape(CreateSimulationJobRequest, (*CREATE_EXPORT_ERRORS, LIMIT), "Runs one simulation.", is_job=True),
    OperationShape(DescribeSimulationJobRequest, READ_ERRORS, "Says how far a simulation job is, and how it ended."),
    OperationShape(BatchDescribeSimulationJobRequest, READ_ERRORS, "Says the same of up to 100 simulation jobs."),
    OperationShape(ListSimulationJobsRequest, LIST_ERRORS, "Lists simulation jobs, newest first."),
    OperationShape(CancelSimulationJobRequest, READ_ERRORS, "Stops a simulation job; its outputs are stored."),
    OperationShape(
        RestartSimulationJobRequest, (*READ_ERRORS, LIMIT), "Runs a running simulation job again from the start."
    ),
)
