"""Keeps the in-memory table of open orders in step with the stored rollouts.

A robot has one order at a time, and the oldest comes first: a cancelled order is in the table until the robot has
answered, also when another rollout has an order for it. An order that the robot closed does not come back while the
catalog is a moment behind. An order that is held back, since its rollout is paused or no maintenance window is open, is
not in the table until it is released, unless the robot has read it.
"""

import threading
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import cast, get_args

from ...schemas.fleet.operations.deployment_jobs import RobotDeploymentStep
from ...schemas.fleet.rollouts.rollout import (
    OPEN,
    Canceled,
    CancelRefused,
    Failed,
    Fetched,
    Progressed,
    Report,
    ReportedCode,
    RobotDeploymentState,
    Succeeded,
)
from ...schemas.fleet.rollouts.rollout_plan import Artifact
from .agent.errors import NAMES
from .ddi.open_orders import OpenOrders, RobotState
from .ddi.orders import RobotOrder
from .ddi.received_reports import CancelFeedback, Execution, Feedback, OrderEnd, OrderFeedback, OrderFetched
from .fleet_records import KnownRobots
from .kept_rollouts import OpenRollout

OrderReport = OrderFetched | OrderFeedback | CancelFeedback

_INSTALLED = ("Installed Chunk", "All Chunks Installed")
_SKIPPED = "Skipped Update"
_ERROR = "ERROR"
_KEPT_ERRORS = 3
_STEPS: frozenset[str] = frozenset(get_args(get_args(RobotDeploymentStep)[0]))


@dataclass(frozen=True)
class SaidBefore:
    """Summary of a robot's earlier feedback on an order, as needed to interpret later feedback."""

    proceeded: bool = False
    installed: bool = False
    errors: tuple[str, ...] = ()
    """Last error texts of a robot about its order, oldest first."""

    withheld: ReportedCode | None = None
    """Reason why the server could not send the installation file at the robot's last request."""


def heard(before: SaidBefore, feedback: Feedback) -> SaidBefore:
    """Adds a feedback to the summary of an order's feedback."""
    errors = [text.removeprefix(_ERROR).lstrip(" :") for text in feedback.details if text.startswith(_ERROR)]
    return replace(
        before,
        proceeded=before.proceeded or feedback.order_end is None,
        installed=before.installed or any(text.startswith(_INSTALLED) for text in feedback.details),
        errors=(*before.errors, *errors)[-_KEPT_ERRORS:],
    )


def event_of(report: OrderReport, robot: str, known: SaidBefore) -> Report:
    """Translates a robot's report, as its updater sends it, into an event of the deployment to robots.

    Args:
        report: The robot's report.
        robot: ARN of the robot; reports have the robot's own id.
        known: State of the order, including this report (`heard`).
    """
    if isinstance(report, OrderFetched):
        return Fetched(robot=robot, action_id=report.action_id)
    feedback = report.feedback
    if isinstance(report, CancelFeedback):
        return _answer_to_cancellation(feedback, robot)
    match feedback.order_end:
        case None:
            return _progress(feedback, robot, known)
        case OrderEnd.CANCELED:
            return Canceled(robot=robot, action_id=feedback.action_id)
        case OrderEnd.FAILED:
            return _failure(feedback, robot, known)
        case OrderEnd.FINISHED:
            return _success(feedback, robot, known)


def _answer_to_cancellation(feedback: Feedback, robot: str) -> Report:
    if feedback.cancel_end is not None:
        return Canceled(robot=robot, action_id=feedback.action_id)
    if feedback.execution is Execution.REJECTED:
        return CancelRefused(robot=robot, action_id=feedback.action_id)
    return Progressed(robot=robot, action_id=feedback.action_id)


def _progress(feedback: Feedback, robot: str, known: SaidBefore) -> Progressed:
    said = next((text for text in feedback.details[:1] if text in _STEPS), None)
    step: str | None = said
    if step is None and feedback.execution in (Execution.PROCEEDING, Execution.DOWNLOAD):
        step = "ExecutingPostLaunch" if known.installed else "DownloadingExtracting"
    percent = None
    # SWUpdate counts the file as one part; how much of it was sent is known better here.
    if step == "DownloadingExtracting" and feedback.count is not None and (feedback.of or 0) > 1:
        percent = min(100.0, 100.0 * feedback.count / (feedback.of or 1))
    return Progressed.model_validate(
        {"robot": robot, "action_id": feedback.action_id, "step": step, "percent_done": percent}
    )


def _failure(feedback: Feedback, robot: str, known: SaidBefore) -> Failed:
    if (said := _code(feedback)) is not None:
        texts = [text for text in feedback.details if text not in _STEPS]
        return Failed(robot=robot, action_id=feedback.action_id, code=said, reason="; ".join(texts) or None)
    if known.installed:  # what it complained of before did not keep it from installing
        code: ReportedCode = "PostLaunchFileFailure"
        reason = "; ".join(feedback.details or known.errors)
    else:  # SWUpdate ends each of these with the same words
        code = known.withheld or "ExtractingBundleFailure"
        reason = "; ".join(known.errors or feedback.details)
    return Failed(robot=robot, action_id=feedback.action_id, code=code, reason=reason or None)


def _code(feedback: Feedback) -> ReportedCode | None:
    """Returns the failure code that the project's agent reported; `None` for numbers of other updaters."""
    return cast("ReportedCode | None", NAMES.get(feedback.code or 0))


def _success(feedback: Feedback, robot: str, known: SaidBefore) -> Report:
    if known.proceeded and not any(text.startswith(_SKIPPED) for text in feedback.details):
        return Succeeded(robot=robot, action_id=feedback.action_id)
    said = f" ({'; '.join(feedback.details)})" if feedback.details else ""
    reason = f"the robot closed its order as a success and had installed nothing{said}"
    return Failed(robot=robot, action_id=feedback.action_id, code="RobotDeploymentAborted", reason=reason)


MAX_EXPECTED = 200
"""Limit of the robots of a rollout, next in order, that poll often because they soon get an order."""

OrderKey = tuple[str, int]
"""Identifier of an order: the robot's id, and the number of the order."""


@dataclass(frozen=True)
class _Wanted:
    order: RobotOrder
    is_cancelling: bool


class OrderKeeper:
    """Keeps the in-memory table of robots' orders in step with the stored rollouts.

    `sync` is called by one thread, the rest by any.

    Args:
        orders: The table.
        robots: The enrolled robots.
    """

    def __init__(self, orders: OpenOrders, robots: KnownRobots) -> None:
        self._orders = orders
        self._robots = robots
        self._jobs: dict[OrderKey, str] = {}
        self._said: dict[OrderKey, SaidBefore] = {}
        self._ordered: dict[OrderKey, Artifact] = {}
        self._artifacts: dict[str, Artifact] = {}
        self._expected: frozenset[str] = frozenset()
        self._held: frozenset[OrderKey] = frozenset()
        self._closed: frozenset[OrderKey] = frozenset()
        self._closed_before: frozenset[OrderKey] = frozenset()
        self._lock = threading.Lock()

    def sync(self, rollouts: Iterable[OpenRollout]) -> None:
        """Updates the table of open orders from the rollouts, those of older jobs first."""
        wishes = _Wishes(self._robots)
        for rollout in rollouts:
            wishes.add(rollout)
        opened = self._orders.open()
        with self._lock:
            kept = {(robot, order.action_id) for robot, order in opened.items()}
            self._jobs = {key: job for key, job in self._jobs.items() if key in kept} | wishes.jobs
            self._said = wishes.said | {key: said for key, said in self._said.items() if key in self._jobs}
            self._ordered = {key: each for key, each in self._ordered.items() if key in kept} | wishes.ordered
            self._artifacts = wishes.artifacts
        self._held = frozenset(wishes.held)
        self._closed_before, self._closed = self._closed, frozenset(wishes.closed)
        for robot in opened.keys() | wishes.wanted.keys():
            self._put(robot, wishes.wanted.get(robot, []))
        self._expect(frozenset(wishes.expected))
        self._orders.count_active()

    def job(self, key: OrderKey) -> str | None:
        """Returns the ARN of the deployment job that an order belongs to; `None` if it was deleted."""
        return self._jobs.get(key)

    def said(self, key: OrderKey) -> SaidBefore:
        """Returns the summary of the robot's feedback on an order so far."""
        return self._said.get(key) or SaidBefore()

    def remember(self, key: OrderKey, said: SaidBefore) -> None:
        """Stores the summary of the robot's feedback on an order so far."""
        with self._lock:
            self._said[key] = said

    def ordered(self, key: OrderKey) -> Artifact | None:
        """Returns the file that an order installs; `None` if the order exists only to be cancelled."""
        return self._ordered.get(key)

    def artifact(self, order: RobotOrder) -> Artifact | None:
        """Returns the stored file that an order installs; `None` if no open deployment has it any more."""
        return self._artifacts.get(order.sha256)

    def files(self) -> frozenset[str]:
        """Returns the SHA-256 of each installation file of open rollouts."""
        return frozenset(self._artifacts)

    def _put(self, robot: str, wanted: list[_Wanted]) -> None:
        state = self._orders.state(robot)
        if (order := state.order) is not None:
            wish = next((each for each in wanted if each.order.action_id == order.action_id), None)
            key = (robot, order.action_id)
            if wish is None and key in self._held:
                self._orders.withhold(*key)
            elif wish is None and key in self._closed:  # the robot said so to another server
                # Twice in a row: of an order that a new rollout takes over, the old one may have been read without it.
                if key in self._closed_before:
                    self._orders.close(*key)
            elif (is_cancelling := wish is None or wish.is_cancelling) != state.is_cancelling:
                change = self._orders.cancel if is_cancelling else self._orders.carry_on
                change(robot, order.action_id)
            return
        if (wish := _oldest(wanted, state)) is not None:
            self._orders.offer(wish.order)
            if wish.is_cancelling:
                self._orders.cancel(robot, wish.order.action_id)

    def _expect(self, expected: frozenset[str]) -> None:
        self._orders.expect(self._expected - expected, is_expected=False)
        self._orders.expect(expected - self._expected)
        self._expected = expected


def _oldest(wanted: list[_Wanted], state: RobotState) -> _Wanted | None:
    """Returns the oldest wanted order that the robot has not closed; `None` if it has closed all."""
    fresh = [each for each in wanted if each.order.action_id > state.last_action_id]
    return min(fresh, key=lambda each: each.order.action_id, default=None)


class _Wishes:
    """Orders, files, and robots about to get orders, of all open rollouts, for enrolled robots."""

    def __init__(self, robots: KnownRobots) -> None:
        self._robots = robots
        self.wanted: dict[str, list[_Wanted]] = {}
        self.closed: set[OrderKey] = set()
        self.held: set[OrderKey] = set()
        self.jobs: dict[OrderKey, str] = {}
        self.said: dict[OrderKey, SaidBefore] = {}
        self.artifacts: dict[str, Artifact] = {}
        self.ordered: dict[OrderKey, Artifact] = {}
        self.expected: list[str] = []

    def add(self, rollout: OpenRollout) -> None:
        self.artifacts |= {artifact.sha256: artifact for artifact in rollout.artifacts.values()}
        waiting = 0
        most = min(MAX_EXPECTED, rollout.rollout.plan.concurrency)
        is_active = rollout.rollout.status == "InProgress" and not rollout.rollout.held
        plan = rollout.rollout.plan
        # Those behind an approval may wait for days.
        first = frozenset(plan.canaries) if plan.requires_approval and rollout.rollout.approved_s is None else None
        for arn, state in rollout.rollout.robots.items():
            robot = self._robots.id(arn)
            if robot is None:
                continue
            self._add_robot(robot, rollout.artifacts.get(arn), state, rollout)
            if (
                is_active
                and waiting < most
                and state.order == "none"
                and not state.has_ended
                and (first is None or arn in first)
            ):
                waiting += 1
                self.expected.append(robot)

    def _add_robot(
        self, robot: str, artifact: Artifact | None, state: RobotDeploymentState, rollout: OpenRollout
    ) -> None:
        for number in (state.earlier_action_id, state.action_id):
            if number is not None:
                self.jobs[robot, number] = rollout.job
        if artifact is None:
            return
        if state.earlier_action_id is not None:
            self._want(robot, state.earlier_action_id, artifact, rollout, is_cancelling=True)
        if state.action_id is None:
            return
        key = (robot, state.action_id)
        self.ordered[key] = artifact
        self.said[key] = SaidBefore(state.step is not None, state.step == "ExecutingPostLaunch")
        if state.order == "offered" and rollout.rollout.held:
            self.held.add(key)
        elif state.order in OPEN or state.order == "refused":
            self._want(robot, state.action_id, artifact, rollout, is_cancelling=False)
        elif state.order == "canceling":
            self._want(robot, state.action_id, artifact, rollout, is_cancelling=True)
        else:
            self.closed.add(key)

    def _want(
        self, robot: str, action_id: int, artifact: Artifact, rollout: OpenRollout, *, is_cancelling: bool
    ) -> None:
        wanted = self.wanted.setdefault(robot, [])
        for place, known in enumerate(wanted):
            if known.order.action_id == action_id:  # one rollout's own, and one that the next waits for
                wanted[place] = _Wanted(known.order, known.is_cancelling and is_cancelling)
                return
        # Of an order that is only there to be given up, nothing but the number is read.
        wanted.append(_Wanted(self._order(robot, action_id, artifact, rollout), is_cancelling))

    def _order(self, robot: str, action_id: int, artifact: Artifact, rollout: OpenRollout) -> RobotOrder:
        return RobotOrder(
            action_id=action_id,
            robot=robot,
            launch=rollout.launch,
            tags=None if artifact.target is None else dict(self._robots.tags(robot)),
            **artifact.model_dump(include=set(RobotOrder.model_fields)),
        )
