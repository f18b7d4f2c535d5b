"""The rollout: its plan, how each robot stands, and how the whole ended."""

from typing import Literal

from pydantic import Field

from ..operations.deployment_jobs import DeploymentJobErrorCode
from .plan import RolloutPlan
from .robots import RobotDeploymentState
from .stored import StoredPart, TimeS

RolloutStatus = Literal["InProgress", "Succeeded", "Failed", "Canceled"]
"""Statuses of a deployment job that a rollout has; what comes before is preparation."""


class Pause(StoredPart):
    """A time in which no robot got an order, since a person wanted it so."""

    from_s: TimeS = Field(description="When it began.")
    until_s: TimeS | None = Field(default=None, description="When the rollout was resumed; absent: not yet.")


class Rollout(StoredPart):
    """A rollout as it is stored."""

    plan: RolloutPlan = Field(description="What it will do.")
    robots: dict[str, RobotDeploymentState] = Field(description="How each robot stands, by ARN.")
    began_s: TimeS = Field(description="When it began.")
    now_s: TimeS = Field(description="Up to when events and time-outs are part of it; it never goes back.")
    status: RolloutStatus = Field(default="InProgress", description="Status of the deployment job.")
    failure_code: DeploymentJobErrorCode | None = Field(default=None, description="Why it failed; absent if not.")
    failure_reason: str | None = Field(default=None, description="The same in words.")
    ended_s: TimeS | None = Field(default=None, description="When it ended; absent: not yet.")
    paused: bool = Field(default=False, description="Whether no robot gets an order for now.")
    pauses: tuple[Pause, ...] = Field(default=(), description="When it was paused, the latest hundred times.")
    takes_returns: bool = Field(
        default=True, description="Whether robots that were away and return get an order, also after its end."
    )
