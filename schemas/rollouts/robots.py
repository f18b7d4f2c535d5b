"""How one robot of a rollout stands: its order, what it reported, and how that ended.

```
             Offered            Fetched             Succeeded, Failed, Canceled
   none ───────────> offered ───────────> fetched ─────────────────────────────────> closed
     ^                  └────────┬──────────┘                                          ^  │
     │             time-out, cancel, stop of the rollout                               │  │
     │                           v                                                     │  │
     │                       canceling ──── Canceled, or its own result ───────────────┤  │
     │                           └── CancelRefused ──> refused ──── its own result ────┘  │
     └──────── (another order) a robot that never fetched its order has answered ─────────┘
```

An order is *open* while it is offered or fetched; only these count for the concurrency. A canceled order blocks the
robot, and only the robot, until it answers. A robot's outcome is decided by the first end of an order, and put right by
its own later result: a robot that was given up and then succeeds is in sync.
"""

from typing import Literal

from pydantic import Field

from ..operations.deployment_jobs import DeploymentJobErrorCode, RobotDeploymentStep
from ..wire.base import optional
from .stored import ActionId, StoredPart, TimeS

OrderState = Literal["none", "offered", "fetched", "canceling", "refused", "closed"]
Departure = Literal["left", "deleted"]
"""How a robot departed from a fleet."""

OPEN: frozenset[OrderState] = frozenset({"offered", "fetched"})
"""States of orders that count for the concurrency."""

UNANSWERED: frozenset[OrderState] = frozenset({"canceling", "refused"})
"""States of orders that were canceled, and that the robot may still carry out."""


class RobotDeploymentState(StoredPart):
    """How one robot of a rollout stands."""

    order: OrderState = Field(default="none", description="State of its latest order.")
    action_id: ActionId | None = optional("Number of its latest order; absent: it has had none.")
    earlier_action_id: ActionId | None = optional(
        "Number of an order of an earlier rollout that it has not answered; it gets that one's "
        "cancellation first, and its order of this rollout after it."
    )
    outcome: Literal["succeeded", "failed"] | None = optional("How it ended; absent: not yet.")
    gone: Departure | None = optional("Whether it left the fleet or was deleted; it gets no order any more.")
    returned: bool = Field(
        default=False, description="Whether it was away, has been heard of again, and waits for another order."
    )
    step: RobotDeploymentStep | None = optional("Step that it last reported.")
    percent_done: float | None = Field(default=None, ge=0, le=100, description="Share of its download, in percent.")
    percent_at_s: TimeS | None = optional("When it reported that share.")
    download_from_percent: float | None = Field(
        default=None, ge=0, le=100, description="Share of the download that was there when it was first reported."
    )
    download_from_s: TimeS | None = optional("When the download was first reported.")
    heard_s: TimeS | None = optional("When it last reported anything about its order.")
    deadline_s: TimeS | None = optional("When its open order times out.")
    offered_s: TimeS | None = optional("When it got its latest order.")
    left_s: float | None = Field(
        default=None,
        ge=0,
        allow_inf_nan=False,
        description="Time that is left to fetch its order, in seconds, while the order is held back; it stands still.",
    )
    started_s: TimeS | None = optional("When it fetched its latest order.")
    step_times: dict[RobotDeploymentStep, TimeS] = Field(
        default={}, description="When it first reported each step of its latest order, to a tenth of a second."
    )
    finished_s: TimeS | None = optional("When its outcome was decided.")
    failure_code: DeploymentJobErrorCode | None = optional("Why it failed; absent if not.")
    failure_reason: str | None = optional("The same in words.")

    @property
    def is_open(self) -> bool:
        """Whether its order counts for the concurrency."""
        return self.order in OPEN

    @property
    def has_ended(self) -> bool:
        """Whether the rollout has nothing to wait for with this robot."""
        return self.outcome is not None or self.gone is not None

    @property
    def no_response(self) -> bool:
        """Whether it failed since it never fetched its order, so that it gets another when it returns."""
        return self.failure_code == "RobotDeploymentNoResponse"
