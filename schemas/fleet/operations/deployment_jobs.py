"""Operations on deployment jobs, which install an application on the robots of a fleet, in maintenance windows.

Robots get their orders in waves, when they poll the service; `schemas/fleet/rollouts` has the data of a rollout.
"""

from typing import Annotated, Literal, Self
from zoneinfo import ZoneInfo

from pydantic import AfterValidator, Field, model_validator

from ...wire.base import Shape, ShapeName, optional
from ...wire.common import (
    Arn,
    ClientRequestToken,
    Filters,
    GenericString,
    JobReference,
    NonEmptyString,
    PaginationToken,
    Path,
    S3Bucket,
    S3Etag,
    S3Key,
    Timestamp,
    text,
)
from ...wire.job_configs import Boolean, Command, EnvironmentVariableMap
from ...wire.operation_shape import (
    CONCURRENT,
    INTERNAL,
    INVALID,
    LIMIT,
    MISMATCH,
    NOT_FOUND,
    READ_ERRORS,
    THROTTLED,
    ErrorClass,
    OperationShape,
    deprecated,
)
from ...wire.tags import TagMap
from .robots import FleetMaxResults, RobotStatus

Weekday = Annotated[
    Literal["MONDAY", "TUESDAY", "WEDNESDAY", "THURSDAY", "FRIDAY", "SATURDAY", "SUNDAY"], ShapeName("Weekday")
]
Weekdays = Annotated[list[Weekday], ShapeName("Weekdays"), Field(min_length=1, max_length=7)]
TimeOfDay = Annotated[str, ShapeName("TimeOfDay"), text(5, 5, "([01][0-9]|2[0-3]):[0-5][0-9]")]
WindowDuration = Annotated[int, ShapeName("WindowDuration"), Field(ge=60, le=24 * 3600)]


def _known_zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise ValueError(f"{name!r} is no time zone; use a name such as Europe/Berlin or UTC") from None
    return name


TimeZoneName = Annotated[str, ShapeName("TimeZoneName"), text(1, 64), AfterValidator(_known_zone)]


class MaintenanceWindow(Shape):
    """A time span of the day, on given weekdays, in which a deployment may begin on robots."""

    days: Weekdays | None = optional("Days on which it begins; absent: every day.")
    startTime: TimeOfDay = Field(description="When it begins, as `22:30`, by the clocks of its time zone.")
    durationInSeconds: WindowDuration = Field(
        description="How long it lasts, in seconds, 60 to 86400; it may end on the next day."
    )
    timeZone: TimeZoneName | None = optional("Its time zone, such as `Europe/Berlin`; absent: UTC.")


MaintenanceWindows = Annotated[
    list[MaintenanceWindow], ShapeName("MaintenanceWindows"), Field(min_length=1, max_length=20)
]


DEFAULT_ROBOT_TIMEOUT_S = 5 * 3600
"""Default time limit in seconds for the deployment to one robot."""


def _once_each(robots: list[str]) -> list[str]:
    if repeated := sorted({robot for robot in robots if robots.count(robot) > 1}):
        raise ValueError(f"{repeated[0]!r} is there twice; name each robot once")
    return robots


DeploymentStatus = Annotated[
    Literal["Pending", "Preparing", "InProgress", "Failed", "Succeeded", "Canceled"], ShapeName("DeploymentStatus")
]
DeploymentJobErrorCode = Annotated[
    Literal[
        "ResourceNotFound",
        "EnvironmentSetupError",
        "EtagMismatch",
        "FailureThresholdBreached",
        "RobotDeploymentAborted",
        "RobotDeploymentNoResponse",
        "RobotAgentConnectionTimeout",
        "GreengrassDeploymentFailed",
        "InvalidGreengrassGroup",
        "MissingRobotArchitecture",
        "MissingRobotApplicationArchitecture",
        "MissingRobotDeploymentResource",
        "GreengrassGroupVersionDoesNotExist",
        "LambdaDeleted",
        "ExtractingBundleFailure",
        "PreLaunchFileFailure",
        "PostLaunchFileFailure",
        "BadPermissionError",
        "DownloadConditionFailed",
        "BadLambdaAssociated",
        "InternalServerError",
        "RobotApplicationDoesNotExist",
        "DeploymentFleetDoesNotExist",
        "FleetDeploymentTimeout",
    ],
    ShapeName("DeploymentJobErrorCode"),
]
RobotDeploymentStep = Annotated[
    Literal[
        "Validating",
        "DownloadingExtracting",
        "ExecutingDownloadCondition",
        "ExecutingPreLaunch",
        "Launching",
        "ExecutingPostLaunch",
        "Finished",
    ],
    ShapeName("RobotDeploymentStep"),
]
DeploymentVersion = Annotated[str, ShapeName("DeploymentVersion"), text(1, 255, "[0-9]*")]
DeploymentTimeout = Annotated[int, ShapeName("DeploymentTimeout", wire_type="long"), Field(ge=60, le=7 * 24 * 3600)]
GenericInteger = Annotated[int, ShapeName("GenericInteger")]
PercentDone = Annotated[float, ShapeName("PercentDone"), Field(ge=0.0, le=100.0)]
Percentage = Annotated[int, ShapeName("Percentage"), Field(ge=1, le=100)]


RobotReference = Annotated[str, ShapeName("RobotReference"), text(1, 1224)]
"""ARN of a robot, or its name alone."""

CanaryRobots = Annotated[
    list[RobotReference], ShapeName("CanaryRobots"), Field(min_length=1, max_length=1000), AfterValidator(_once_each)
]
ThresholdAction = Annotated[Literal["STOP", "ROLLBACK"], ShapeName("ThresholdAction")]
DeploymentWaitCause = Annotated[Literal["PAUSED", "APPROVAL", "MAINTENANCE_WINDOW"], ShapeName("DeploymentWaitCause")]


class S3Object(Shape):
    """Bucket, key and ETag of one object in the object store."""

    bucket: S3Bucket = Field(description="Its bucket.")
    key: S3Key = Field(description="Its key.")
    etag: S3Etag | None = optional("Identifies its content; absent: whatever it has now.")


class DeploymentConfig(Shape):
    """Safety limits of a deployment to robots: how many at once, and at how many failures it stops."""

    concurrentDeploymentPercentage: Percentage | None = optional(
        "Share of the robots that is deployed to at the same time, in percent; absent: 20."
    )
    failureThresholdPercentage: Percentage | None = optional(
        "Share of the robots that has to fail for the deployment to stop, in percent; absent: 20."
    )
    robotDeploymentTimeoutInSeconds: DeploymentTimeout | None = optional(
        "How long one robot may take, in seconds, 60 to 604800; absent: 18000."
    )
    downloadConditionFile: S3Object | None = optional("Program whose exit code 0 lets a robot download.")
    canaryRobots: CanaryRobots | None = optional(
        "Extension: robots of the fleet, by ARN or name, whose turn comes first; the others wait until all "
        "of these have ended. Absent: none."
    )
    canaryPercentage: Percentage | None = optional(
        "Extension: the same as a share of the robots, in percent, rounded down to robots, one at least; "
        "not together with `canaryRobots`."
    )
    maintenanceWindows: MaintenanceWindows | None = optional(
        "Extension: when robots may get and fetch orders; those that have begun go on. Absent: always."
    )
    requiresApproval: Boolean | None = optional(
        "Extension: whether a person has to approve once the canaries have ended, or before the first "
        "robot where there are none; absent: false."
    )
    onThresholdBreached: ThresholdAction | None = optional(
        "Extension: what follows when the threshold is reached: STOP (the default) leaves robots as they "
        "are; ROLLBACK gives those that have the new version the one that they had before."
    )
    requiresBatch: Arn | None = optional(
        "Extension: ARN of a simulation job batch; no robot gets the version unless each of its jobs ran "
        "it, and passed."
    )

    @model_validator(mode="after")
    def _canaries_said_once(self) -> Self:
        if self.canaryRobots is not None and self.canaryPercentage is not None:
            raise ValueError("canaryRobots and canaryPercentage say the same; give one of them")
        return self


class DeploymentLaunchConfig(Shape):
    """Launch settings of an application on a robot: package, launch file, environment variables and scripts."""

    packageName: Command = Field(description="Package that holds the launch file.")
    preLaunchFile: Path | None = optional("Program that runs before the launch file.")
    launchFile: Command = Field(description="Launch file of the package.")
    postLaunchFile: Path | None = optional("Program that runs after the launch file.")
    environmentVariables: EnvironmentVariableMap | None = optional(
        "Variables for the application: capitals, digits, underscores; at most 20."
    )


class DeploymentApplicationConfig(Shape):
    """The robot application version that a deployment installs, with its launch settings."""

    application: Arn = Field(description="ARN of the robot application.")
    applicationVersion: DeploymentVersion = Field(description="Number of its version; `$LATEST` is not possible.")
    launchConfig: DeploymentLaunchConfig = Field(description="How it is started.")


DeploymentApplicationConfigs = Annotated[
    list[DeploymentApplicationConfig], ShapeName("DeploymentApplicationConfigs"), Field(min_length=1, max_length=1)
]


class CreateDeploymentJobRequest(Shape):
    """Request of `CreateDeploymentJob`: deploys an application to the robots of a fleet."""

    deploymentConfig: DeploymentConfig | None = optional("How careful the deployment is.")
    clientRequestToken: ClientRequestToken = Field(
        description="Makes the call repeatable: the same token and request give the same job."
    )
    fleet: Arn = Field(description="ARN of the fleet; it has to have robots.")
    deploymentApplicationConfigs: DeploymentApplicationConfigs = Field(description="The application, exactly one.")
    tags: TagMap | None = optional("Tags for the job.")


class SyncDeploymentJobRequest(Shape):
    """Request of `SyncDeploymentJob`: repeats a fleet's latest deployment for robots that have not received it."""

    clientRequestToken: ClientRequestToken = Field(
        description="Makes the call repeatable: the same token and request give the same job."
    )
    fleet: Arn = Field(description="ARN of the fleet.")


class DeploymentJob(Shape):
    """Summary of a deployment job, as a list of deployment jobs shows it."""

    arn: Arn | None = optional("ARN of the job.")
    fleet: Arn | None = optional("ARN of the fleet.")
    status: DeploymentStatus | None = optional("Status of the job.")
    deploymentApplicationConfigs: DeploymentApplicationConfigs | None = optional("The application.")
    deploymentConfig: DeploymentConfig | None = optional("How careful the deployment is.")
    failureReason: GenericString | None = optional("Why it failed, in words.")
    failureCode: DeploymentJobErrorCode | None = optional("Why it failed; absent if not.")
    createdAt: Timestamp | None = optional("When it was accepted.")


class SyncDeploymentJobResponse(DeploymentJob):
    """Response of `SyncDeploymentJob`: the accepted deployment job."""


class CreateDeploymentJobResponse(DeploymentJob):
    """Response of `CreateDeploymentJob`: the accepted deployment job."""

    tags: TagMap | None = optional("The job's tags.")


class ProgressDetail(Shape):
    """Progress of a deployment on one robot: the current step, and its percentage and time left."""

    currentProgress: RobotDeploymentStep | None = optional("Step that the deployment is at.")
    percentDone: PercentDone | None = optional("How much of the download is done, in percent.")
    estimatedTimeRemainingSeconds: GenericInteger | None = optional(
        "How long the download will still take, in seconds."
    )
    targetResource: GenericString | None = optional("ARN of the deployment job.")


class RobotDeployment(Shape):
    """State of a deployment on one robot: status, times, progress and failure."""

    arn: Arn | None = optional("ARN of the robot.")
    deploymentStartTime: Timestamp | None = optional("When it began; absent: not yet.")
    deploymentFinishTime: Timestamp | None = optional("When it ended; absent: not yet.")
    status: RobotStatus | None = optional("How the robot stands.")
    progressDetail: ProgressDetail | None = optional("How far it is, once it has begun.")
    failureReason: GenericString | None = optional("Why it failed, in words.")
    failureCode: DeploymentJobErrorCode | None = optional("Why it failed; absent if not.")


RobotDeploymentSummary = Annotated[list[RobotDeployment], ShapeName("RobotDeploymentSummary")]


class DescribeDeploymentJobRequest(JobReference):
    """Request of `DescribeDeploymentJob`: names the deployment job to describe."""


class DeploymentWait(Shape):
    """The reason why a deployment waits before further robots, such as a missing approval.

    Robots that have begun continue meanwhile.
    """

    cause: DeploymentWaitCause | None = optional("Cause of the wait.")
    since: Timestamp | None = optional("When a person paused it; absent for others.")
    by: NonEmptyString | None = optional("Person who paused it; absent: not said.")
    until: Timestamp | None = optional("When a maintenance window opens; absent for others.")


DeploymentWaits = Annotated[list[DeploymentWait], ShapeName("DeploymentWaits")]
ArnList = Annotated[list[Arn], ShapeName("ArnList")]


class DeploymentRollback(Shape):
    """State of a rollback, in which robots return to the version they had before a deployment."""

    jobs: ArnList | None = optional("ARNs of the deployment jobs that bring them back.")
    robotsLeft: ArnList | None = optional("ARNs of robots that keep the new version, since they had none before.")
    reason: GenericString | None = optional("Why robots do not go back; absent: they do.")


class DescribeDeploymentJobResponse(CreateDeploymentJobResponse):
    """Response of `DescribeDeploymentJob`: one deployment job with the state of each robot."""

    waitsFor: DeploymentWaits | None = optional("Extension: what it waits for besides robots; absent: nothing.")
    rollback: DeploymentRollback | None = optional(
        "Extension: how robots go back to the version before; absent: they do not."
    )

    robotDeploymentSummary: RobotDeploymentSummary | None = optional(
        "The deployments to single robots; empty if it ended before any began."
    )


class ListDeploymentJobsRequest(Shape):
    """Request of `ListDeploymentJobs`: asks for a page of deployment jobs, newest first."""

    filters: Filters | None = optional("`status` or `fleetName`; absent: all jobs.")
    nextToken: PaginationToken | None = optional("Token of the page before, to go on after it.")
    maxResults: FleetMaxResults | None = optional("Entries per page; absent: 200.")


DeploymentJobs = Annotated[list[DeploymentJob], ShapeName("DeploymentJobs", 0, 200)]


class ListDeploymentJobsResponse(Shape):
    """Response of `ListDeploymentJobs`: one page of deployment jobs."""

    deploymentJobs: DeploymentJobs | None = optional("Jobs, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class CancelDeploymentJobRequest(JobReference):
    """Request of `CancelDeploymentJob`: names the deployment job to stop early."""


class CancelDeploymentJobResponse(Shape):
    """Response of `CancelDeploymentJob`: empty; the deployment job is cancelled, or had ended before."""


_DEPLOYMENT_ERRORS: tuple[ErrorClass, ...] = (NOT_FOUND, INVALID, INTERNAL, THROTTLED, LIMIT, CONCURRENT, MISMATCH)

OPERATIONS = deprecated(
    OperationShape(
        CreateDeploymentJobRequest,
        _DEPLOYMENT_ERRORS,
        "Deploys an application to the robots of a fleet, in waves.",
        is_job=True,
    ),
    OperationShape(DescribeDeploymentJobRequest, READ_ERRORS, "Says how a deployment job stands."),
    OperationShape(ListDeploymentJobsRequest, READ_ERRORS, "Lists deployment jobs, newest first."),
    OperationShape(CancelDeploymentJobRequest, READ_ERRORS, "Ends a deployment job early."),
    OperationShape(
        SyncDeploymentJobRequest,
        _DEPLOYMENT_ERRORS,
        "Repeats a fleet's latest deployment for its robots that are not in sync.",
        is_job=True,
    ),
)
