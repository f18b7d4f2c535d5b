"""State of a rollout (installation of an application on a fleet): plan, events, states of robots, and report."""

from typing import Annotated, Literal

from pydantic import Field

from ...wire.base import optional
from ..operations.deployment_jobs import DeploymentConfig, DeploymentJobErrorCode, DeploymentStatus, RobotDeploymentStep
from .rollout_plan import ActionId, Delivery, RolloutPlan, StoredPart, TimeS

OrderState = Literal["none", "offered", "fetched", "canceling", "refused", "closed"]
Departure = Literal["left", "deleted"]
"""Ways in which a robot's membership in a fleet ends."""

OPEN: frozenset[OrderState] = frozenset({"offered", "fetched"})
"""States of orders that count towards the concurrency limit."""

UNANSWERED: frozenset[OrderState] = frozenset({"canceling", "refused"})
"""States of orders that were cancelled, but that the robot may still execute."""


class RobotDeploymentState(StoredPart):
    """State of one robot in a deployment: its order to install the application, its times, outcome and failure."""

    order: OrderState = Field(default="none", description="State of the robot's latest order.")
    action_id: ActionId | None = optional("Number of the robot's latest order; absent: none.")
    earlier_action_id: ActionId | None = optional(
        "Number of an unanswered order of an earlier rollout; its cancellation comes first, then this rollout's order."
    )
    outcome: Literal["succeeded", "failed"] | None = optional("Outcome on the robot; absent: not finished.")
    gone: Departure | None = optional("Whether the robot left the fleet or was deleted; it gets no more orders.")
    returned: bool = Field(
        default=False, description="Whether the robot was offline, is back, and waits for another order."
    )
    step: RobotDeploymentStep | None = optional("Step that the robot last reported.")
    percent_done: float | None = Field(default=None, ge=0, le=100, description="Downloaded share, in percent.")
    percent_at_s: TimeS | None = optional("Time at which the robot reported `percent_done`.")
    download_from_percent: float | None = Field(
        default=None, ge=0, le=100, description="Share that was downloaded when it was first reported, in percent."
    )
    download_from_s: TimeS | None = optional("Time of the first report on the download.")
    heard_s: TimeS | None = optional("Time of the robot's last report about its order.")
    deadline_s: TimeS | None = optional("Time at which the open order times out.")
    offered_s: TimeS | None = optional("Time at which the robot got its latest order.")
    left_s: float | None = Field(
        default=None,
        ge=0,
        allow_inf_nan=False,
        description="Seconds left to fetch the order, while the order is held back and this time does not pass.",
    )
    started_s: TimeS | None = optional("Time at which the robot fetched its latest order.")
    step_times: dict[RobotDeploymentStep, TimeS] = Field(
        default={},
        description="Time at which the robot first reported each step of its latest order, to a tenth of a second.",
    )
    finished_s: TimeS | None = optional("Time at which the outcome was decided.")
    failure_code: DeploymentJobErrorCode | None = optional("Failure code; absent if the robot did not fail.")
    failure_reason: str | None = optional("Reason of the failure as text.")

    @property
    def is_open(self) -> bool:
        """Whether the robot counts towards the concurrency limit: it has an order and has not finished it."""
        return self.order in OPEN

    @property
    def has_ended(self) -> bool:
        """Whether the robot is finished: it installed the application, failed to, left the fleet, or was deleted.

        The rollout, which installs the application on all robots of a fleet, waits only for robots that are not
        finished.
        """
        return self.outcome is not None or self.gone is not None

    @property
    def no_response(self) -> bool:
        """Whether the robot failed because it never fetched its order; it gets another one when it polls again."""
        return self.failure_code == "RobotDeploymentNoResponse"


RolloutStatus = Literal["InProgress", "Succeeded", "Failed", "Canceled"]
"""Statuses of a deployment job that has a rollout; earlier statuses are those of its preparation."""


class Pause(StoredPart):
    """A period in which a person had paused a deployment, so that no robot received an order to install."""

    from_s: TimeS = Field(description="Begin of the pause.")
    until_s: TimeS | None = optional("End of the pause; absent: it continues.")


class Rollback(StoredPart):
    """State of a rollback: robots return to the version that they had before the failed deployment."""

    jobs: tuple[str, ...] = Field(
        default=(), description="ARNs of the deployment jobs that return robots to the earlier version."
    )
    left: tuple[str, ...] = Field(
        default=(), description="ARNs of robots that have the new version and had none before; they keep it."
    )
    is_complete: bool = Field(default=False, description="Whether all necessary deployment jobs have been created.")
    reason: str | None = optional("Reason why robots are not rolled back; absent: they are.")


class Rollout(StoredPart):
    """Stored state of a rollout, the installation of an application on the robots of a fleet."""

    plan: RolloutPlan = Field(description="Plan of the rollout.")
    robots: dict[str, RobotDeploymentState] = Field(description="State of each robot, by ARN.")
    began_s: TimeS = Field(description="Begin of the rollout.")
    now_s: TimeS = Field(description="Time up to which events and time limits have been processed; it never decreases.")
    status: RolloutStatus = Field(default="InProgress", description="Status of the deployment job.")
    failure_code: DeploymentJobErrorCode | None = optional("Failure code of the rollout; absent if it did not fail.")
    failure_reason: str | None = optional("Reason of the failure as text.")
    ended_s: TimeS | None = optional("End of the rollout; absent: it is in progress.")
    pauses: tuple[Pause, ...] = Field(default=(), description="Latest pauses, at most 100.")
    paused: bool = Field(
        default=False, description="Whether a person has paused the rollout, so that no further robot begins."
    )
    paused_by: str | None = optional("Person who paused the rollout; absent: unknown, or not paused.")
    paused_s: TimeS | None = optional("Begin of the present pause; absent: not paused.")
    held: bool = Field(
        default=False,
        description=(
            "Whether orders are held back, because of a pause or outside of maintenance windows. No robot gets "
            "or fetches an order; robots that have begun continue."
        ),
    )
    approved_by: str | None = optional("Person who approved the rollout; absent: unknown.")
    approved_s: TimeS | None = optional("Time of the approval; absent: none.")
    rollback: Rollback | None = optional("State of the rollback; absent: there is none yet.")
    takes_returns: bool = Field(
        default=True, description="Whether robots that come back online get an order, also after the rollout's end."
    )

    @property
    def rollback_is_due(self) -> bool:
        """Whether a planned rollback has to begin or go on: too many robots failed, and none is installing any more."""
        if not self.plan.rolls_back or self.failure_code != "FailureThresholdBreached":
            return False
        is_complete = self.rollback is not None and self.rollback.is_complete
        return not is_complete and all(state.order != "fetched" for state in self.robots.values())


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
"""Failure codes that a robot may report; the service itself sets the others."""

StopCause = Literal["canceled", "rejected", "fleet_deleted", "application_deleted", "superseded"]
"""Reasons for ending a rollout from outside."""


class _OfOrder(StoredPart):
    robot: str = Field(description="ARN of the robot.")
    action_id: ActionId = Field(description="Number of the order.")


class Offered(_OfOrder):
    """Rollout event: a robot whose turn it is was given an order, with an order number from the catalog."""

    kind: Literal["offered"] = Field(default="offered", description="Kind of event.")


class Fetched(_OfOrder):
    """Rollout event: a robot has downloaded the text of its order."""

    kind: Literal["fetched"] = Field(default="fetched", description="Kind of event.")


class Progressed(_OfOrder):
    """Rollout event: a robot reported its progress with the installation."""

    kind: Literal["progressed"] = Field(default="progressed", description="Kind of event.")
    step: RobotDeploymentStep | None = optional("Present step of the installation; absent: unchanged.")
    percent_done: float | None = Field(
        default=None, ge=0, le=100, description="Downloaded share in percent; absent: not reported."
    )


class Succeeded(_OfOrder):
    """Rollout event: a robot runs the new application version."""

    kind: Literal["succeeded"] = Field(default="succeeded", description="Kind of event.")


class Failed(_OfOrder):
    """Rollout event: a robot could not install the deployment."""

    kind: Literal["failed"] = Field(default="failed", description="Kind of event.")
    code: ReportedCode = Field(description="Reason of the failure.")
    reason: str | None = optional("Reason of the failure as text.")


class Canceled(_OfOrder):
    """Rollout event: a robot stopped its installation, on the server's order or by its own decision."""

    kind: Literal["canceled"] = Field(default="canceled", description="Kind of event.")


class CancelRefused(_OfOrder):
    """Rollout event: a robot can no longer cancel its installation and finishes it."""

    kind: Literal["cancel_refused"] = Field(default="cancel_refused", description="Kind of event.")


class RobotGone(StoredPart):
    """Rollout event: a robot left the fleet or was deleted."""

    kind: Literal["robot_gone"] = Field(default="robot_gone", description="Kind of event.")
    robot: str = Field(description="ARN of the robot.")
    how: Departure = Field(description="Whether the robot left the fleet or was deleted.")


class Stopped(StoredPart):
    """Rollout event: the whole rollout was ended early.

    The cause is a person who cancelled it or did not approve it; the deletion of its fleet or application; or, after
    its end, the fleet's next deployment, so that robots that return do not get this one any more.
    """

    kind: Literal["stopped"] = Field(default="stopped", description="Kind of event.")
    why: StopCause = Field(description="Cause for which the rollout was ended.")
    by: str | None = optional("Person who rejected the rollout; absent: unknown.")


class Paused(StoredPart):
    """Rollout event: a person paused the rollout; no further robot begins, robots that have begun continue."""

    kind: Literal["paused"] = Field(default="paused", description="Kind of event.")
    by: str | None = optional("Person who paused the rollout; absent: unknown.")


class Resumed(StoredPart):
    """Rollout event: a person resumed a paused rollout."""

    kind: Literal["resumed"] = Field(default="resumed", description="Kind of event.")


class Approved(StoredPart):
    """Rollout event: a person approved a rollout that waits for approval; it has no effect on any other rollout."""

    kind: Literal["approved"] = Field(default="approved", description="Kind of event.")
    by: str | None = optional("Person who approved the rollout; absent: unknown.")


class Outage(StoredPart):
    """Rollout event: the service was unreachable for robots; their time limits are extended by that time."""

    kind: Literal["outage"] = Field(default="outage", description="Kind of event.")
    since_s: TimeS = Field(description="Begin of the outage.")


Report = Fetched | Progressed | Succeeded | Failed | Canceled | CancelRefused
"""Reports of a robot about an order, as rollout events."""

RolloutEvent = Annotated[
    Report | Offered | RobotGone | Stopped | Paused | Resumed | Approved | Outage,
    Field(discriminator="kind"),
]


class DeploymentReport(StoredPart):
    """Summary of a deployment to a fleet, current or final, with the state of each robot."""

    job: str = Field(description="ARN of the deployment job.")
    fleet: str = Field(description="Name of the fleet.")
    application: str = Field(description="Name of the application.")
    version: str = Field(description="Version of the application.")
    status: DeploymentStatus = Field(description="Status of the deployment job.")
    failure_code: DeploymentJobErrorCode | None = optional("Failure code of the deployment; absent if it did not fail.")
    failure_reason: str | None = optional("Reason of the failure as text.")
    created_s: TimeS = Field(description="Time at which the deployment was requested.")
    now_s: TimeS = Field(description="Time of the report.")
    config: DeploymentConfig = Field(description="Limits of the rollout: concurrency, threshold, timeouts.")
    delivery: Delivery | None = optional("Files and launch configuration that robots get; absent: it was not prepared.")
    rollout: Rollout | None = optional("State of each robot; absent: the rollout has not begun.")
    notes: tuple[str, ...] = Field(
        default=(), description="Causes for which the rollout waits, and how robots are rolled back, as text."
    )
    closed: tuple[Pause, ...] = Field(default=(), description="Times outside of the maintenance windows.")
    waves: tuple[tuple[str, ...], ...] = Field(default=(), description="ARNs of the robots of each wave, in order.")
