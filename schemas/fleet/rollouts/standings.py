"""States of fleets, their robots and latest deployments, as `robomaker fleet status` and the console show them."""

from datetime import datetime
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from ...wire.base import optional
from ..operations.deployment_jobs import (
    DeploymentJobErrorCode,
    DeploymentRollback,
    DeploymentStatus,
    DeploymentWait,
    RobotDeploymentStep,
)

RobotKind = Literal["agent", "updater"]


class _Standing(BaseModel):
    """Base class of the parts of a fleet's state; members have the names of the JSON output."""

    model_config = ConfigDict(frozen=True)


class OrderStanding(_Standing):
    """A robot's open order to install or to cancel, as `robomaker fleet status` reports it."""

    number: int = Field(description="Number of the order, as the robot knows it.")
    state: str = Field(description="State of the order: offered, fetched, canceling or refused.")
    step: RobotDeploymentStep | None = optional("Step that the robot last reported.")
    percent_done: float | None = optional("Downloaded share, in percent.")


class RobotStanding(_Standing):
    """Status of one robot of a fleet, as `robomaker fleet status` reports it."""

    robot: str = Field(description="Name of the robot.")
    kind: RobotKind | None = optional("Kind of updater on the robot; absent: it is not enrolled.")
    status: str = Field(description="Status of the robot, as in `DescribeRobot`.")
    version: str | None = optional("Application and version that the robot installed last.")
    last_seen: datetime | None = optional("Time of the robot's last poll; absent: never.")
    order: OrderStanding | None = optional("Open order of the robot; absent: none.")
    failure_code: DeploymentJobErrorCode | None = optional(
        "Failure code of the latest deployment to the robot; absent if it did not fail."
    )
    failure_reason: str | None = optional("Reason of the failure as text.")


class DeploymentStanding(_Standing):
    """Status of a deployment to a fleet, as `robomaker fleet status` reports it."""

    job: str = Field(description="ARN of the deployment job.")
    status: DeploymentStatus = Field(description="Status of the deployment job.")
    application: str = Field(description="Name of the application.")
    version: str = Field(description="Version of the application.")
    created_at: datetime = Field(description="Time at which the deployment was requested.")
    robots: int = Field(default=0, description="Number of robots of the deployment.")
    counts: dict[str, int] = Field(
        default={},
        description="Numbers of robots that succeeded, failed, were canceled, are deploying, or are waiting.",
    )
    wave: int | None = optional("Number of the current wave; absent: the deployment has not begun.")
    waves: int | None = optional("Number of waves; absent: the deployment has not begun.")
    failed_percent: float | None = optional("Share of the robots taking part that has failed so far, in percent.")
    threshold_percent: int | None = optional("Share of failed robots at which the deployment stops, in percent.")
    paused: bool = Field(
        default=False, description="Whether a person has paused the deployment, so that no further robot begins."
    )
    waits: tuple[DeploymentWait, ...] = Field(
        default=(), description="Causes, other than robots, for which the deployment waits."
    )
    rolls_back: str | None = optional("ARN of the failed deployment whose robots this one rolls back; absent: none.")
    rollback_is_due: bool = Field(
        default=False, description="Whether the failure threshold is reached and a rollback deployment follows."
    )
    rollback: DeploymentRollback | None = optional("State of the rollback; absent: there is none yet.")
    failure_code: DeploymentJobErrorCode | None = optional("Failure code of the deployment; absent if it did not fail.")
    failure_reason: str | None = optional("Reason of the failure as text.")


class FleetStanding(_Standing):
    """Status of a fleet of robots with its deployment, as `robomaker fleet status` reports it."""

    fleet: str = Field(description="Name of the fleet.")
    arn: str = Field(description="ARN of the fleet.")
    robots: tuple[RobotStanding, ...] = Field(description="Robots of the fleet, in order of registration.")
    deployment: DeploymentStanding | None = optional("Latest deployment of the fleet; absent: none.")
