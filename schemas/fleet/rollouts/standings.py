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
    percent_done: float | None = optional("Share of its download, in percent.")


class RobotStanding(_Standing):
    """Status of one robot of a fleet, as `robomaker fleet status` reports it."""

    robot: str = Field(description="Name of the robot.")
    kind: RobotKind | None = optional("Kind of program that updates it; absent: it is not enrolled.")
    status: str = Field(description="Status of the robot, as in `DescribeRobot`.")
    version: str | None = optional("Application and version that it installed last.")
    last_seen: datetime | None = optional("When it polled last; absent: never.")
    order: OrderStanding | None = optional("Order that is open for it; absent: none.")
    failure_code: DeploymentJobErrorCode | None = optional("Why the latest deployment to it failed; absent if not.")
    failure_reason: str | None = optional("The same in words.")


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
    wave: int | None = optional("Number of its current wave; absent: it has not begun.")
    waves: int | None = optional("How many waves it has; absent: it has not begun.")
    failed_percent: float | None = optional("Share of the robots taking part that has failed so far, in percent.")
    threshold_percent: int | None = optional("At which share it stops, in percent.")
    paused: bool = Field(
        default=False, description="Whether a person has paused the deployment, so that no further robot begins."
    )
    waits: tuple[DeploymentWait, ...] = Field(
        default=(), description="Causes, other than robots, for which the deployment waits."
    )
    rolls_back: str | None = optional(
        "ARN of the deployment that failed and whose robots it brings back; absent: none."
    )
    rollback_is_due: bool = Field(
        default=False, description="Whether the failure threshold is reached and a rollback deployment follows."
    )
    rollback: DeploymentRollback | None = optional(
        "How robots go back to the version before; absent: they do not, or not yet."
    )
    failure_code: DeploymentJobErrorCode | None = optional("Why it failed; absent if not.")
    failure_reason: str | None = optional("The same in words.")


class FleetStanding(_Standing):
    """Status of a fleet of robots with its deployment, as `robomaker fleet status` reports it."""

    fleet: str = Field(description="Name of the fleet.")
    arn: str = Field(description="ARN of the fleet.")
    robots: tuple[RobotStanding, ...] = Field(description="Robots of the fleet, in order of registration.")
    deployment: DeploymentStanding | None = optional("Its latest deployment; absent: none.")
