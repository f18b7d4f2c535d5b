"""Events of a rollout: reports of robots, decisions of people, and orders that were offered.

Reports name the order that they are about. A report about an order that is closed, or that the robot never had, changes
nothing; so events may be repeated, and may arrive late or in any sequence.
"""

from typing import Annotated, Literal

from pydantic import Field

from ..operations.deployment_jobs import RobotDeploymentStep
from ..wire.base import optional
from .robots import Departure
from .stored import ActionId, StoredPart, TimeS

ReportedCode = Literal[
    "BadPermissionError",
    "DownloadConditionFailed",
    "EnvironmentSetupError",
    "EtagMismatch",
    "ExtractingBundleFailure",
    "InternalServerError",
    "PostLaunchFileFailure",
    "PreLaunchFileFailure",
    "ResourceNotFound",
    "RobotDeploymentAborted",
]
"""Failure codes that a robot may report; the others are found by the service."""

StopCause = Literal["canceled", "rejected", "fleet_deleted", "application_deleted", "superseded"]
"""Why a rollout is ended from outside."""


class _OfOrder(StoredPart):
    robot: str = Field(description="ARN of the robot.")
    action_id: ActionId = Field(description="Number of the order.")


class Offered(_OfOrder):
    """A robot whose turn it is was given an order; its number came from the catalog."""

    kind: Literal["offered"] = Field(default="offered", description="Kind of event.")


class Fetched(_OfOrder):
    """The robot has read its order."""

    kind: Literal["fetched"] = Field(default="fetched", description="Kind of event.")


class Progressed(_OfOrder):
    """The robot said how far it is."""

    kind: Literal["progressed"] = Field(default="progressed", description="Kind of event.")
    step: RobotDeploymentStep | None = optional("Step that the robot is at; absent: the same as before.")
    percent_done: float | None = Field(
        default=None, ge=0, le=100, description="Share of its download, in percent; absent: not reported."
    )


class Succeeded(_OfOrder):
    """The robot runs the new version."""

    kind: Literal["succeeded"] = Field(default="succeeded", description="Kind of event.")


class Failed(_OfOrder):
    """The robot could not carry out its order."""

    kind: Literal["failed"] = Field(default="failed", description="Kind of event.")
    code: ReportedCode = Field(description="Why.")
    reason: str | None = optional("The same in words.")


class Canceled(_OfOrder):
    """The robot has given up its order, because it was told to or by itself."""

    kind: Literal["canceled"] = Field(default="canceled", description="Kind of event.")


class CancelRefused(_OfOrder):
    """The robot cannot give up its order any more and carries it to its end."""

    kind: Literal["cancel_refused"] = Field(default="cancel_refused", description="Kind of event.")


class RobotGone(StoredPart):
    """A robot left the fleet or was deleted."""

    kind: Literal["robot_gone"] = Field(default="robot_gone", description="Kind of event.")
    robot: str = Field(description="ARN of the robot.")
    how: Departure = Field(description="Whether it left the fleet or was deleted.")


class Stopped(StoredPart):
    """The whole rollout was ended.

    By a person who canceled it, or did not approve it; by the deletion of its fleet or of its application; or, after
    its end, by the fleet's next deployment, so that robots that return do not get this one any more.
    """

    kind: Literal["stopped"] = Field(default="stopped", description="Kind of event.")
    why: StopCause = Field(description="Cause of the end.")
    by: str | None = optional("Person who did not approve it; absent: not said.")


class Paused(StoredPart):
    """A person wants no robot to begin until the rollout is resumed; robots that have begun go on."""

    kind: Literal["paused"] = Field(default="paused", description="Kind of event.")
    by: str | None = optional("Person who paused it; absent: not said.")


class Resumed(StoredPart):
    """A person lets a paused rollout go on."""

    kind: Literal["resumed"] = Field(default="resumed", description="Kind of event.")


class Approved(StoredPart):
    """A person lets a rollout that waits for approval go on; of no effect on one that does not wait for it."""

    kind: Literal["approved"] = Field(default="approved", description="Kind of event.")
    by: str | None = optional("Person who approved it; absent: not said.")


class Outage(StoredPart):
    """Robots could not reach the service until now; time-outs of robots stand still for so long."""

    kind: Literal["outage"] = Field(default="outage", description="Kind of event.")
    since_s: TimeS = Field(description="When it began.")


Report = Fetched | Progressed | Succeeded | Failed | Canceled | CancelRefused
"""Reports of a robot about an order."""

RolloutEvent = Annotated[
    Report | Offered | RobotGone | Stopped | Paused | Resumed | Approved | Outage,
    Field(discriminator="kind"),
]
