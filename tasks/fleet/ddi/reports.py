"""Reports that the server received from robots, for the rollout and the catalog.

A report may come twice, when a robot did not see the answer: what takes reports has to take them repeatedly.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from .feedback import Attributes, Feedback


@dataclass(frozen=True)
class OrderFetched:
    """A robot read its order for the first time."""

    robot: str
    action_id: int
    at_s: float
    """Seconds since 1970."""


@dataclass(frozen=True)
class OrderFeedback:
    """A robot said how far it is with its order, or how it ended (`feedback.order_end`)."""

    robot: str
    feedback: Feedback
    at_s: float


@dataclass(frozen=True)
class CancelFeedback:
    """A robot answered that its order is cancelled: it is (`feedback.cancel_end`), or the order goes on."""

    robot: str
    feedback: Feedback
    at_s: float


@dataclass(frozen=True)
class AttributesSent:
    """A robot said what it is."""

    robot: str
    attributes: Attributes
    at_s: float


@dataclass(frozen=True)
class RobotsSeen:
    """When robots polled last, gathered over some seconds: seconds since 1970 by robot."""

    last_seen_s: Mapping[str, float]


RobotReport = OrderFetched | OrderFeedback | CancelFeedback | AttributesSent | RobotsSeen
