"""The rollout: its plan, how each robot stands, and how the whole ended."""

from typing import Literal

from pydantic import Field

from ..operations.deployment_jobs import DeploymentJobErrorCode
from ..wire.base import optional
from .plan import RolloutPlan
from .robots import RobotDeploymentState
from .stored import StoredPart, TimeS

RolloutStatus = Literal["InProgress", "Succeeded", "Failed", "Canceled"]
"""Statuses of a deployment job that a rollout has; what comes before is preparation."""


class Pause(StoredPart):
    """A time in which no robot got an order, since a person wanted it so."""

    from_s: TimeS = Field(description="When it began.")
    until_s: TimeS | None = optional("When the rollout was resumed; absent: not yet.")


class Rollback(StoredPart):
    """How robots go back to the version that they had before a rollout."""

    jobs: tuple[str, ...] = Field(default=(), description="ARNs of the deployment jobs that bring them back.")
    left: tuple[str, ...] = Field(
        default=(), description="ARNs of robots that have the new version and had none before; they keep it."
    )
    is_complete: bool = Field(default=False, description="Whether all jobs that are needed have been made.")
    reason: str | None = optional("Why robots do not go back; absent: they do.")


class Rollout(StoredPart):
    """A rollout as it is stored."""

    plan: RolloutPlan = Field(description="Plan of the rollout.")
    robots: dict[str, RobotDeploymentState] = Field(description="How each robot stands, by ARN.")
    began_s: TimeS = Field(description="When it began.")
    now_s: TimeS = Field(description="Up to when events and time-outs are part of it; it never goes back.")
    status: RolloutStatus = Field(default="InProgress", description="Status of the deployment job.")
    failure_code: DeploymentJobErrorCode | None = optional("Why it failed; absent if not.")
    failure_reason: str | None = optional("The same in words.")
    ended_s: TimeS | None = optional("When it ended; absent: not yet.")
    pauses: tuple[Pause, ...] = Field(default=(), description="When it was paused, the latest hundred times.")
    paused: bool = Field(default=False, description="Whether a person wants no robot to begin for now.")
    paused_by: str | None = optional("Person who paused it; absent: not said, or it is not paused.")
    paused_s: TimeS | None = optional("When it was paused; absent: it is not.")
    held: bool = Field(
        default=False,
        description="Whether orders are held back: it is paused, or no maintenance window is open. No robot gets an "
        "order or fetches one; robots that have begun go on.",
    )
    approved_by: str | None = optional("Person who approved it; absent: not said.")
    approved_s: TimeS | None = optional("When it was approved; absent: it was not.")
    rollback: Rollback | None = optional("How robots go back; absent: they do not, or not yet.")
    takes_returns: bool = Field(
        default=True, description="Whether robots that were away and return get an order, also after its end."
    )

    @property
    def rollback_is_due(self) -> bool:
        """Whether robots are to go back now: the threshold was reached, and those that had begun have ended."""
        if not self.plan.rolls_back or self.failure_code != "FailureThresholdBreached":
            return False
        is_complete = self.rollback is not None and self.rollback.is_complete
        return not is_complete and all(state.order != "fetched" for state in self.robots.values())
