"""What can happen in a rollout: reports of robots, decisions of people, and orders that were offered.

Reports name the order that they are about. A report about an order that is closed, or that the robot never had, changes
nothing; so events may be repeated, and may arrive late or in any sequence.
"""

from typing import Annotated, Literal

from pydantic import Field

from ..operations.deployment_jobs import RobotDeploymentStep
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

    kind: Literal["offered"] = Field(default="offered", description="Which event this is.")


class Fetched(_OfOrder):
    """The robot has read its order."""

    kind: Literal["fetched"] = Field(default="fetched", description="Which event this is.")


class Progressed(_OfOrder):
    """The robot said how far it is."""

    kind: Literal["progressed"] = Field(default="progressed", description="Which event this is.")
    step: RobotDeploymentStep | None = Field(default=None, description="What it does; absent: the same as before.")
    percent_done: float | None = Field(
        default=None, ge=0, le=100, description="Share of its download, in percent; absent: not reported."
    )


class Succeeded(_OfOrder):
    """The robot runs the new version."""

    kind: Literal["succeeded"] = Field(default="succeeded", description="Which event this is.")


class Failed(_OfOrder):
    """The robot could not carry out its order."""

    kind: Literal["failed"] = Field(default="failed", description="Which event this is.")
    code: ReportedCode = Field(description="Why.")
    reason: str | None = Field(default=None, description="The same in words.")


class Canceled(_OfOrder):
    """The robot has given up its order, because it was told to or by itself."""

    kind: Literal["canceled"] = Field(default="canceled", description="Which event this is.")


class CancelRefused(_OfOrder):
    """The robot cannot give up its order any more and carries it to its end."""

    kind: Literal["cancel_refused"] = Field(default="cancel_refused", description="Which event this is.")


class RobotGone(StoredPart):
    """A robot left the fleet or was deleted."""

    kind: Literal["robot_gone"] = Field(default="robot_gone", description="Which event this is.")
    robot: str = Field(description="ARN of the robot.")
    how: Departure = Field(description="What was done to it.")


class Stopped(StoredPart):
    """The whole rollout was ended.

    By a person who canceled it, or did not approve it; by the deletion of its fleet or of its application; or, after
    its end, by the fleet's next deployment, so that robots that return do not get this one any more.
    """

    kind: Literal["stopped"] = Field(default="stopped", description="Which event this is.")
    why: StopCause = Field(description="What ended it.")
    by: str | None = Field(default=None, description="Who, where a person did not approve it; absent: not said.")


class Paused(StoredPart):
    """A person wants no robot to begin until the rollout is resumed; robots that have begun go on."""

    kind: Literal["paused"] = Field(default="paused", description="Which event this is.")
    by: str | None = Field(default=None, description="Who; absent: not said.")


class Resumed(StoredPart):
    """A person lets a paused rollout go on."""

    kind: Literal["resumed"] = Field(default="resumed", description="Which event this is.")


class Approved(StoredPart):
    """A person lets a rollout that waits for approval go on; of no effect on one that does not wait for it."""

    kind: Literal["approved"] = Field(default="approved", description="Which event this is.")
    by: str | None = Field(default=None, description="Who; absent: not said.")


class Outage(StoredPart):
    """Robots could not reach the service until now; time-outs of robots stand still for so long."""

    kind: Literal["outage"] = Field(default="outage", description="Which event this is.")
    since_s: TimeS = Field(description="When it began.")


Report = Fetched | Progressed | Succeeded | Failed | Canceled | CancelRefused
"""What a robot may report of an order."""

RolloutEvent = Annotated[
    Report | Offered | RobotGone | Stopped | Paused | Resumed | Approved | Outage,
    Field(discriminator="kind"),
]
