"""Plan of a rollout: the robots in order, how many at a time, and when the rollout stops.

AWS does not document which percentages apply if a request has none. Here both are 20:

* At most a fifth of a fleet is without its application at the same time, and a rollout takes five rounds. * A version
that breaks each robot of the first round stops there. A good version is not stopped by robots that are   offline,
unless a fifth of the fleet is.
"""

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic.alias_generators import to_camel

from ...wire.base import optional
from ...wire.errors import InvalidParameterException
from ..operations.deployment_jobs import DEFAULT_ROBOT_TIMEOUT_S, DeploymentLaunchConfig, MaintenanceWindow

MAX_ACTION_ID = 2**31 - 1
"""Maximum number of an order: clients of hawkBit store it as a signed 32-bit integer."""

ActionId = Annotated[int, Field(ge=1, le=MAX_ACTION_ID)]
"""Number of an order to one robot, unique in the catalog."""

TimeS = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
"""Time in seconds since the epoch."""


class StoredPart(BaseModel):
    """Immutable base class of the objects of a stored rollout; members added by newer releases are kept unread.

    `documents.base.Part` does the same for small documents, but converts to JSON in Python, which takes five times as
    long; the rollout of a large fleet is written very often.
    """

    model_config = ConfigDict(
        alias_generator=to_camel,
        validate_by_name=True,
        validate_by_alias=True,
        frozen=True,
        extra="ignore",
        defer_build=True,
    )

    def to_json(self) -> dict[str, Any]:
        """Returns the object as plain JSON values; absent members are left out."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)

    @classmethod
    def of_json(cls, stored: dict[str, Any]) -> Self:
        """Reads an object from the JSON that `to_json` returned."""
        return cls.model_validate(stored)


DEFAULT_CONCURRENT_PERCENTAGE = 20
"""Default maximum share of a fleet that is deployed to at the same time, in percent."""

DEFAULT_THRESHOLD_PERCENTAGE = 20
"""Default share of a fleet that has to fail for a deployment to stop, in percent."""

JOB_TIMEOUT_S = 30 * 24 * 3600.0
"""Time limit of a whole deployment, in seconds."""

UnfitCode = Literal[
    "DownloadConditionFailed",
    "MissingRobotApplicationArchitecture",
    "MissingRobotArchitecture",
    "MissingRobotDeploymentResource",
]
"""Reasons for which a robot cannot get the application at all."""


class PlannedRobot(StoredPart):
    """A robot in the plan of a deployment: the version it had before, and why it cannot get the new one, if so."""

    arn: str = Field(description="ARN of the robot.")
    installed: str | None = optional("Application and version before the rollout, such as `courier 1`; absent: none.")
    unfit_code: UnfitCode | None = optional(
        "Reason why the robot cannot get the application; absent: it can. It then fails, and does not count."
    )
    unfit_reason: str | None = optional("Reason as text.")
    earlier_job: str | None = optional(
        "ARN of the deployment job that had installed the earlier, different version; absent: there is none "
        "to return to."
    )


class RolloutPlan(StoredPart):
    """Immutable plan of a rollout to a fleet: its robots in order, and its limits (concurrency, failures, time)."""

    robots: tuple[PlannedRobot, ...] = Field(
        description="Robots of the fleet, in the order in which they get the deployment."
    )
    concurrent_percentage: int = Field(
        default=DEFAULT_CONCURRENT_PERCENTAGE,
        ge=1,
        le=100,
        description=(
            "Maximum share of robots that install at the same time, in percent, rounded down to robots; at "
            "least one robot."
        ),
    )
    threshold_percentage: int = Field(
        default=DEFAULT_THRESHOLD_PERCENTAGE,
        ge=1,
        le=100,
        description="Share of participating robots that has to fail for the rollout to stop, in percent.",
    )
    robot_timeout_s: float = Field(
        default=float(DEFAULT_ROBOT_TIMEOUT_S),
        gt=0,
        allow_inf_nan=False,
        description="Time limit in seconds for a robot to fetch its order, and again to execute it.",
    )
    job_timeout_s: float = Field(
        default=JOB_TIMEOUT_S, gt=0, allow_inf_nan=False, description="Time limit of the whole rollout, in seconds."
    )
    canaries: tuple[str, ...] = Field(
        default=(),
        description="ARNs of robots that come first (canaries); the others wait until all of these have finished.",
    )
    requires_approval: bool = Field(
        default=False,
        description="Whether other robots wait for a person's approval after the canaries have finished.",
    )
    windows: tuple[MaintenanceWindow, ...] = Field(
        default=(), description="Times at which robots may get and fetch orders; empty: always."
    )
    rolls_back: bool = Field(
        default=False, description="Whether robots return to the earlier version once the threshold is reached."
    )

    @model_validator(mode="after")
    def _checked(self) -> Self:
        """Checks the robots of a rollout's plan, and returns the plan.

        Raises InvalidParameterException if it has none, one twice, or a canary that is none of them.
        """
        known = _each_once("robots", self.order)
        if not known:
            raise InvalidParameterException(
                "robots: the plan of a rollout has none; register some with the fleet first"
            )
        if strange := _each_once("canaries", self.canaries) - known:
            raise InvalidParameterException(
                f"canaries: {min(strange)} is not among the robots; name robots of the fleet"
            )
        return self

    @property
    def order(self) -> tuple[str, ...]:
        """ARNs of the robots, in the order in which they receive the deployment."""
        return tuple(robot.arn for robot in self.robots)

    @property
    def concurrency(self) -> int:
        """Number of robots that may install the deployment at the same time."""
        return max(1, len(self.robots) * self.concurrent_percentage // 100)


def _each_once(member: str, arns: tuple[str, ...]) -> set[str]:
    seen: set[str] = set()
    for arn in arns:
        if arn in seen:
            raise InvalidParameterException(f"{member}: {arn} is there twice; name each robot once")
        seen.add(arn)
    return seen


class Artifact(StoredPart):
    """An installation file in the object store, with the hash and size by which a robot checks its download."""

    bucket: str = Field(description="Name of the file's bucket.")
    key: str = Field(description="Key of the file.")
    file_name: str = Field(description="File name in orders; SWUpdate accepts only `.swu`.")
    size_bytes: int = Field(ge=1, description="Size of the file, in bytes.")
    sha256: str = Field(description="SHA-256 of the file, in hexadecimal.")
    sha1: str = Field(description="SHA-1 of the file, in hexadecimal.")
    md5: str = Field(description="MD5 of the file, in hexadecimal.")
    archive_sha256: str | None = optional(
        "SHA-256 of the application's archive inside the file, in hexadecimal; absent: the file is the archive."
    )
    name: str = Field(description="Name of the application in the file.")
    version: str = Field(description="Version of the application in the file.")
    target: str | None = optional("Path of the signed deployment document that an agent fetches; absent: none.")

    @property
    def delivers(self) -> str:
        """SHA-256 (hexadecimal) of the application archive that a robot gets with this file."""
        return self.archive_sha256 or self.sha256


class Delivery(StoredPart):
    """Installation files and launch configuration that a deployment gives to its robots; they do not change."""

    artifacts: dict[str, Artifact] = Field(description="Files for third-party updaters, by architecture.")
    agent_artifacts: dict[str, Artifact] = Field(
        default={}, description="Files for this project's agent, by architecture."
    )
    agents: frozenset[str] = Field(
        default=frozenset(), description="ARNs of the robots that have this project's agent."
    )
    architectures: dict[str, str] = Field(description="Architecture of each robot that gets a file, by ARN.")
    launch: DeploymentLaunchConfig = Field(description="Launch configuration of the application.")

    def by_robot(self) -> dict[str, Artifact]:
        """Returns the installation file of each robot, by robot ARN."""
        return {robot: self._files(robot)[architecture] for robot, architecture in self.architectures.items()}

    def _files(self, robot: str) -> dict[str, Artifact]:
        return self.agent_artifacts if robot in self.agents else self.artifacts
