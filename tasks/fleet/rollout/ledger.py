"""State machine of a rollout with indexes, so that an event costs the same in a fleet of ten and of ten thousand.

`Ledger(rollout)` reads a stored rollout, `rollout()` gives it back as one; between the two, `apply` takes in events one
by one. Time-outs that are due happen first, each at its own moment, so a ledger that was asked rarely ends up like one
that was asked each second. It draws no numbers and reads no clock: the same events at the same times give the same
rollout.

How the whole ends:

| what | status | failure code | robots that have begun |
| --- | --- | --- | --- |
| each robot has ended | `Succeeded` | | |
| the threshold is reached | `Failed` | `FailureThresholdBreached` | go on to their end |
| its time is up | `Failed` | `FleetDeploymentTimeout` | canceled, with this code |
| a person cancels it, or does not approve it | `Canceled` | | canceled, `RobotDeploymentAborted` |
| its application is deleted | `Failed` | `RobotApplicationDoesNotExist` | canceled, with this code |
| its fleet is deleted | `Failed` | `DeploymentFleetDoesNotExist` | canceled, with this code |

While a rollout is *held*, since a person paused it or no maintenance window is open, no robot gets an order or fetches
one, and the time-outs of orders that were not fetched stand still. Robots that have begun go on, and theirs run on. So
does the time of the whole, also while it waits for approval.

Orders that robots have not fetched are canceled, too; these robots are as if they had never been asked. After
`Succeeded` and `FleetDeploymentTimeout`, robots that never fetched their order still get one when they return.
The status of a rollout that has ended stays; its robots may still change, by what they report themselves.
"""

from collections.abc import Mapping
from dataclasses import replace

from ....schemas.fleet.operations.deployment_jobs import DeploymentJobErrorCode
from ....schemas.fleet.rollouts.rollout import (
    UNANSWERED,
    Approved,
    Offered,
    Outage,
    Paused,
    Resumed,
    RobotDeploymentState,
    RobotGone,
    Rollback,
    Rollout,
    RolloutEvent,
    StopCause,
    Stopped,
)
from ....schemas.fleet.rollouts.rollout_plan import RolloutPlan
from .failure_thresholds import Tally, Verdict
from .maintenance_windows import is_open, next_change_s
from .pauses import with_pause
from .robot_transitions import changed, held_back, let_go, offered, reported, revoked, withdrawn
from .time_outs import Deadlines, timed_out
from .waves import Line, waits, waits_again

_STOPS: dict[StopCause, tuple[Verdict, DeploymentJobErrorCode]] = {
    "canceled": (Verdict("Canceled"), "RobotDeploymentAborted"),
    "rejected": (Verdict("Canceled", None, "the deployment was not approved"), "RobotDeploymentAborted"),
    "superseded": (Verdict("Canceled", None, "the fleet has a newer deployment"), "RobotDeploymentAborted"),
    "application_deleted": (
        Verdict("Failed", "RobotApplicationDoesNotExist", "the robot application was deleted"),
        "RobotApplicationDoesNotExist",
    ),
    "fleet_deleted": (
        Verdict("Failed", "DeploymentFleetDoesNotExist", "the fleet was deleted"),
        "DeploymentFleetDoesNotExist",
    ),
}
"""Final status of the rollout, and failure code of robots that have begun, by cause of the stop."""


def begin(plan: RolloutPlan, now_s: float, earlier: Mapping[str, int] | None = None) -> Rollout:
    """Creates the initial state of a rollout (deployment to the robots of a fleet); unfit robots fail at once.

    Args:
        plan: The rollout's plan.
        now_s: The time.
        earlier: Orders of earlier rollouts that robots have not answered, by robot: `Ledger.unanswered` of the last.
    """
    robots: dict[str, RobotDeploymentState] = {}
    for robot in plan.robots:
        state = RobotDeploymentState(earlier_action_id=(earlier or {}).get(robot.arn))
        if robot.unfit_code is not None:
            failure = {"failure_code": robot.unfit_code, "failure_reason": robot.unfit_reason}
            state = changed(state, outcome="failed", finished_s=now_s, **failure)
        robots[robot.arn] = state
    held = not is_open(plan.windows, now_s)
    ledger = Ledger(Rollout(plan=plan, robots=robots, began_s=now_s, now_s=now_s, held=held))
    ledger.pass_time(now_s)
    return ledger.rollout()


class Ledger:
    """State machine of a rollout (deployment to robots), which applies events. Not for several threads at once."""

    def __init__(self, rollout: Rollout) -> None:
        """Reads a stored rollout, which stays unchanged."""
        self._rollout = rollout
        self._plan = rollout.plan
        self._robots = {robot: rollout.robots[robot] for robot in rollout.plan.order}
        self._now_s = rollout.now_s
        self._tally = Tally(rollout.plan)
        for robot, state in self._robots.items():
            self._tally.count(robot, state, 1)
        self._line = Line(rollout.plan, self._robots)
        self._deadlines = Deadlines(self._robots)
        self._change_s = next_change_s(self._plan.windows, self._now_s)

    def rollout(self) -> Rollout:
        """Returns the current state of the deployment to the robots, to be stored."""
        return self._rollout.model_copy(update={"robots": dict(self._robots), "now_s": self._now_s})

    @property
    def status(self) -> str:
        """Status of the deployment to the robots, such as `InProgress` or `Failed`."""
        return self._rollout.status

    @property
    def waits_for_approval(self) -> bool:
        """Whether all canary robots are finished, and the others wait until a person approves the deployment."""
        is_asked = self._plan.requires_approval and self._rollout.approved_s is None
        return is_asked and self._is_active and self._tally.canaries.has_ended

    @property
    def open_orders(self) -> int:
        """Number of robots that have an open order."""
        return self._tally.open

    def robot(self, arn: str) -> RobotDeploymentState:
        """Returns the state of a robot in the deployment: its order (to install the application) and outcome."""
        return self._robots[arn]

    def note_rollback(self, rollback: Rollback) -> None:
        """Records the rollback of a failed deployment: how robots return to their old version."""
        self._set(rollback=rollback)

    def unanswered(self) -> dict[str, int]:
        """Returns cancelled orders that robots have not answered and may still carry out, by robot."""
        orders: dict[str, int] = {}
        for robot, state in self._robots.items():
            number = state.earlier_action_id or (state.action_id if state.order in UNANSWERED else None)
            if number is not None:
                orders[robot] = number
        return orders

    def offers(self) -> tuple[str, ...]:
        """Returns the robots that should each get an order now; each order is confirmed with an `Offered` event.

        Ask again after each event, and at `wake_s`.
        """
        if self._rollout.held or not self._rollout.takes_returns:
            return ()
        free = self._plan.concurrency - self._tally.open
        return self._line.next(free, first=self._is_active, others=self._is_released)

    def wake_s(self) -> float | None:
        """Returns when to check again, in seconds since the epoch: at the next time-out or maintenance window.

        `None`: only events change the rollout.
        """
        return self._wake_s() if self._is_active or self._tally.open or self._line.has_returns else None

    def apply(self, event: RolloutEvent, now_s: float) -> None:
        """Applies an event, such as a robot's report, to the state, after the time-outs that came before it.

        Args:
            event: The event to apply. Robots that are not of this rollout are left alone.
            now_s: Time of the event, in seconds since the epoch; times before an earlier event count as that event's.
        """
        if isinstance(event, Outage):
            self._outage(event, now_s)
        self.pass_time(now_s)
        match event:
            case RobotGone():
                self._gone(event)
            case Stopped():
                self._stopped(event)
            case Paused() | Resumed() | Approved():
                self._decided(event)
            case Offered():
                self._offer(event)
            case Outage():
                pass
            case _ if event.robot in self._robots:
                self._put(
                    event.robot,
                    reported(self._robots[event.robot], event, self._now_s, self._plan.robot_timeout_s),
                )
            case _:
                pass
        self._judge()

    def pass_time(self, now_s: float) -> None:
        """Applies what happens by itself up to a time: time-outs, and maintenance windows that open or close."""
        self._judge()
        now_s = max(now_s, self._now_s)
        while (wake_s := self._wake_s()) is not None and wake_s <= now_s:
            self._now_s = max(self._now_s, wake_s)
            deadline = self._deadlines.next()
            if deadline is not None and deadline[0] <= wake_s:
                robot = deadline[1]
                self._put(robot, timed_out(self._robots[robot], self._plan.robot_timeout_s))
                self._judge()
            elif self._is_active and self._end_s <= wake_s:
                self._time_is_up()
            else:
                self._hold_or_let_go()
        self._now_s = now_s

    def _wake_s(self) -> float | None:
        deadline = self._deadlines.next()
        times = [deadline[0]] if deadline is not None else []
        if self._is_active:
            times.append(self._end_s)
        if self._change_s is not None:
            times.append(self._change_s)
        return min(times, default=None)

    @property
    def _end_s(self) -> float:
        """Returns when the whole rollout times out, in seconds since the epoch."""
        return self._rollout.began_s + self._plan.job_timeout_s

    @property
    def _is_released(self) -> bool:
        """Whether robots other than the canaries may get orders."""
        return self._tally.canaries.has_ended and not self.waits_for_approval

    @property
    def _is_active(self) -> bool:
        return self._rollout.status == "InProgress"

    def _offer(self, event: Offered) -> None:
        """Records an order if the robot may get one now; else nothing changes, and its number stays unused."""
        state = self._robots.get(event.robot)
        if state is None or self._rollout.held or not self._rollout.takes_returns:
            return
        first = waits(state) and self._is_active
        turn = not first or event.robot in self._plan.canaries or self._is_released
        used = event.action_id in (state.action_id, state.earlier_action_id)
        free = self._tally.open < self._plan.concurrency
        if (first or waits_again(state)) and turn and free and not used:
            self._put(event.robot, offered(state, event.action_id, self._now_s, self._plan.robot_timeout_s))

    def _decided(self, event: Paused | Resumed | Approved) -> None:
        match event:
            case Paused() if not self._rollout.paused:
                pauses = with_pause(self._rollout.pauses, event, self._now_s)
                self._set(paused=True, paused_by=event.by, paused_s=self._now_s, pauses=pauses)
            case Resumed():
                pauses = with_pause(self._rollout.pauses, event, self._now_s)
                self._set(paused=False, paused_by=None, paused_s=None, pauses=pauses)
            case Approved() if self.waits_for_approval:
                self._set(approved_by=event.by, approved_s=self._now_s)
            case _:
                return
        self._hold_or_let_go()

    def _hold_or_let_go(self) -> None:
        """Holds back orders that were not fetched, or releases them, depending on pauses and maintenance windows."""
        windows = self._plan.windows
        self._change_s = next_change_s(windows, self._now_s)
        held = self._rollout.paused or not is_open(windows, self._now_s)
        if held != self._rollout.held:
            self._set(held=held)
            change = held_back if held else let_go
            for robot, state in list(self._robots.items()):
                self._put(robot, change(state, self._now_s))

    def _gone(self, event: RobotGone) -> None:
        state = self._robots.get(event.robot)
        if state is not None:
            state = changed(state, gone=event.how, returned=False)
            if state.is_open:
                state = withdrawn(state)
            self._put(event.robot, state)

    def _stopped(self, event: Stopped) -> None:
        verdict, code = _STOPS[event.why]
        if event.by is not None:
            verdict = replace(verdict, reason=f"{verdict.reason or 'the deployment was canceled'}, says {event.by}")
        if self._is_active:
            self._end(verdict)
        elif event.why in ("canceled", "rejected"):  # a deployment that has ended stays as it is
            return
        self._set(takes_returns=False)
        self._revoke(code, verdict.reason or "the deployment was canceled", begun=True)

    def _time_is_up(self) -> None:
        reason = f"the deployment took longer than {self._plan.job_timeout_s:g} s"
        self._end(Verdict("Failed", "FleetDeploymentTimeout", reason))
        self._revoke("FleetDeploymentTimeout", reason, begun=True)

    def _judge(self) -> None:
        if not self._is_active:
            return
        verdict = self._tally.verdict()
        if verdict is not None:
            self._end(verdict)
            if verdict.status == "Failed":
                self._set(takes_returns=False)
                self._revoke("RobotDeploymentAborted", "the deployment was stopped", begun=False)

    def _end(self, verdict: Verdict) -> None:
        self._set(status=verdict.status, failure_code=verdict.code, failure_reason=verdict.reason, ended_s=self._now_s)

    def _revoke(self, code: DeploymentJobErrorCode, reason: str, *, begun: bool) -> None:
        """Marks orders to install as cancelled: all open ones, or only those that robots have not fetched."""
        for robot, state in list(self._robots.items()):
            if state.is_open and (begun or state.order == "offered"):
                self._put(robot, revoked(state, self._now_s, code, reason))

    def _set(self, **members: object) -> None:
        self._rollout = self._rollout.model_copy(update=members)

    def _put(self, robot: str, state: RobotDeploymentState) -> None:
        before = self._robots[robot]
        if state is before:
            return
        self._tally.count(robot, before, -1)
        self._tally.count(robot, state, 1)
        self._robots[robot] = state
        if state.deadline_s != before.deadline_s:
            self._deadlines.add(robot, state)
        self._line.update(robot)

    def _outage(self, event: Outage, now_s: float) -> None:
        """Extends the deadlines of robots by the part of an outage that was not applied yet."""
        self.pass_time(min(event.since_s, now_s))
        lasted_s = now_s - self._now_s
        if lasted_s > 0:
            for robot, state in list(self._robots.items()):
                if state.deadline_s is not None:
                    self._put(robot, changed(state, deadline_s=state.deadline_s + lasted_s))
            self._now_s = now_s  # windows that opened in between were of no use
