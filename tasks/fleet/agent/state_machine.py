"""State machine of the robot agent, as a pure function: a state and an event give the next state.

```
  idle ──> validating ──> condition ──> downloading ──> pre_launch ──> launching ──> post_launch ──> watching ──> idle
              │  a failure, a cancellation: idle, the good version has run on  │         │              │  good version
              └──────────────────────────────────────────────────────────────> └──> returning <────────┘  exchanged
```

Each phase stands for one thing that is done, which may be done again after a power loss; the state is on disk before
it is begun. So a state with its phase says all that a restarted agent needs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Union

from .deployment import Deployment, Order, Version
from .errors import NUMBERS
from .newer_deployments import is_newer, why_refused

MAX_RESTARTS = 5
"""Limit of restarts of the agent while it tries a new version, after which it returns to the previous one.

The new version may be the cause of the robot's crashes.
"""


MAX_ENDS = 3
"""Limit of crashes of a new version's application before it was steady once, after which the robot goes back.

One may be chance, and pauses grow: the third comes some seconds after the first.
"""


class Phase(str, Enum):
    """Phase of the agent's work on an order (validating, downloading, launching, ...)."""

    IDLE = "idle"
    VALIDATING = "validating"
    CONDITION = "condition"
    DOWNLOADING = "downloading"
    PRE_LAUNCH = "pre_launch"
    LAUNCHING = "launching"
    POST_LAUNCH = "post_launch"
    WATCHING = "watching"
    RETURNING = "returning"


STEPS = {
    Phase.VALIDATING: "Validating",
    Phase.CONDITION: "ExecutingDownloadCondition",
    Phase.DOWNLOADING: "DownloadingExtracting",
    Phase.PRE_LAUNCH: "ExecutingPreLaunch",
    Phase.LAUNCHING: "Launching",
    Phase.POST_LAUNCH: "ExecutingPostLaunch",
    Phase.WATCHING: "ExecutingPostLaunch",
    Phase.RETURNING: "ExecutingPostLaunch",
}
"""RoboMaker's name of each phase of an installation."""

BEFORE_SWITCH = (Phase.VALIDATING, Phase.CONDITION, Phase.DOWNLOADING, Phase.PRE_LAUNCH)
"""Phases in which an order can still be given up: the running version has not been touched."""

TRIED = (Phase.LAUNCHING, Phase.POST_LAUNCH, Phase.WATCHING)
"""Phases in which the new version should be running."""


@dataclass(frozen=True)
class End:
    """Result of an order to a robot, stored until the update server has received it."""

    order: Order
    execution: str
    """Execution state of an ended order to report: `closed` or `canceled`."""

    finished: str
    """Result of an ended order to report: `success` or `failure`."""

    code: int | None = None
    details: tuple[str, ...] = ()
    is_delivered: bool = False

    def is_of(self, order: Order) -> bool:
        """Whether this stored result is that of a given order."""
        return self.order.action_id == order.action_id and self.order.target in ("", order.target)


@dataclass(frozen=True)
class Probation:
    """Time from the success of an order until its application has run steadily once."""

    order: Order
    back: Version | None = None
    """Version that ran before, to which the robot returns if the new one fails; `None`: there was none."""

    ends: int = 0
    """Number of times that the application has ended by itself during the probation."""


@dataclass(frozen=True)
class State:
    """Complete stored state of a robot's agent."""

    phase: Phase = Phase.IDLE
    order: Order | None = None
    """Open order of the robot; `None` when idle."""

    deployment: Deployment | None = None
    """Deployment of the robot's open order, once its deployment document was verified."""

    good: Version | None = None
    """Last application version that proved healthy on the robot."""

    previous: Version | None = None
    """Healthy application version before the last one; it stays on disk."""

    failure: tuple[str, str] | None = None
    """Failure code and reason, while the agent returns to the previous version."""

    end: End | None = None
    """Result of the robot's latest order; `None`: no order has ended."""

    restarts: int = 0
    """Number of the agent's restarts since it began to try the new version."""

    floors: Mapping[str, int] = field(default_factory=dict)
    """Newest metadata version seen of each TUF role; older ones are refused."""

    newest_s: float = 0.0
    """Latest time at which the repository was fresh, in seconds since 1970; earlier metadata is refused."""

    number: int = 0
    """Number of the last deployment finished on this robot; deployments up to this number are ignored."""

    probation: Probation | None = None
    """Probation of the good version while it has not run long enough to count as steady; else `None`."""

    trouble: str = ""
    """Reason why the robot left a version that it had already reported as installed; empty: it did not."""


@dataclass(frozen=True)
class Ordered:
    """Agent event: the server has an order."""

    order: Order


@dataclass(frozen=True)
class Cancelled:
    """Agent event: the server wants an order cancelled."""

    action_id: int


@dataclass(frozen=True)
class Withdrawn:
    """Agent event: the server has no order any more."""


@dataclass(frozen=True)
class Trusted:
    """Agent event: the update repository was verified as up to date."""

    floors: Mapping[str, int]
    newest_s: float


@dataclass(frozen=True)
class Checked:
    """Agent event: the deployment document was verified."""

    deployment: Deployment


@dataclass(frozen=True)
class Passed:
    """Agent event: a phase of an installation succeeded."""

    phase: Phase


@dataclass(frozen=True)
class Failed:
    """Agent event: a phase of an installation failed."""

    phase: Phase
    code: str
    reason: str


@dataclass(frozen=True)
class Delivered:
    """Agent event: the server knows how an order ended."""

    order: Order


@dataclass(frozen=True)
class Ended:
    """Agent event: the application of the good version ended by itself, before it was steady."""

    how: str


@dataclass(frozen=True)
class Steady:
    """Agent event: the application of the good version has run steadily."""


@dataclass(frozen=True)
class Restarted:
    """Agent event: the agent has started."""


Event = Union[Ordered, Cancelled, Withdrawn, Trusted, Checked, Passed, Failed, Delivered, Ended, Steady, Restarted]

_NEXT = {
    Phase.CONDITION: Phase.DOWNLOADING,
    Phase.DOWNLOADING: Phase.PRE_LAUNCH,
    Phase.PRE_LAUNCH: Phase.LAUNCHING,
    Phase.LAUNCHING: Phase.POST_LAUNCH,
    Phase.POST_LAUNCH: Phase.WATCHING,
}


def wanted(state: State) -> Version | None:
    """Returns the application version that should be running: the one on trial, else the last good one, or `None`."""
    if state.phase in TRIED and state.deployment is not None:
        return state.deployment.version
    return state.good


def kept(state: State) -> set[str]:
    """Returns the folders of versions that must stay on disk."""
    before = state.probation and state.probation.back
    versions = [state.good, state.previous, before, state.deployment and state.deployment.version]
    return {version.folder for version in versions if version is not None}


def advance(state: State, event: Event) -> State:
    """Returns the robot agent's state after an event; late events change nothing."""
    if isinstance(event, Trusted):
        return _trusted(state, event)
    if isinstance(event, Ordered):
        return _ordered(state, event.order)
    if isinstance(event, (Ended, Steady)):
        return _on_probation(state, event)
    if isinstance(event, Delivered):
        is_it = state.end is not None and state.end.order == event.order
        return replace(state, end=replace(state.end, is_delivered=True)) if is_it and state.end else state
    if state.order is None:
        return _cancelled_unknown(state, event) if isinstance(event, Cancelled) else state
    return _carried_on(state, state.order, event)


def _on_probation(state: State, event: Ended | Steady) -> State:
    """Returns the state after the good version's application ended by itself or became steady.

    After too many ends, the robot returns to the previous version.
    """
    known = state.probation
    if known is None or state.phase in (*TRIED, Phase.RETURNING):
        return state
    if isinstance(event, Steady):
        return replace(state, probation=None)
    ends = known.ends + 1
    if ends < MAX_ENDS:
        return replace(state, probation=replace(known, ends=ends))
    back = f"version {known.back.version}" if known.back else "running nothing"
    reason = (
        f"the new version is unhealthy: it keeps restarting, {ends} times before it was up steadily; the last time "
        f"{event.how}; the robot went back to {back}"
    )
    details = (STEPS[Phase.WATCHING], reason)
    end = End(known.order, "closed", "failure", NUMBERS["RobotDeploymentAborted"], details)
    previous = None if state.previous == known.back else state.previous
    left = f"version {state.good.version} kept" if state.good else "it kept"
    trouble = f"{left} restarting, so the robot went back to {back}: {event.how}"
    return replace(state, good=known.back, previous=previous, probation=None, end=end, trouble=trouble)


def _carried_on(state: State, order: Order, event: Event) -> State:
    """Returns the robot agent's state after an event while there is an open order."""
    if isinstance(event, Restarted):
        return _restarted(state)
    if isinstance(event, Checked):
        return _checked(state, event.deployment)
    if isinstance(event, Passed):
        return _passed(state) if event.phase is state.phase else state
    if isinstance(event, Failed):
        return _failed(state, event.code, event.reason) if event.phase is state.phase else state
    if state.phase not in BEFORE_SWITCH:
        return state
    if isinstance(event, Withdrawn):
        return _idle(state)
    is_it = isinstance(event, Cancelled) and event.action_id == order.action_id
    return _ended(state, "canceled", "success") if is_it else state


def _trusted(state: State, event: Trusted) -> State:
    roles = {*state.floors, *event.floors}
    floors = {role: max(state.floors.get(role, 0), event.floors.get(role, 0)) for role in roles}
    return replace(state, floors=floors, newest_s=max(state.newest_s, event.newest_s))


def _ordered(state: State, order: Order) -> State:
    if state.order is not None:
        # Another order in place of this one: the server has forgotten this one.
        can_change = state.phase in BEFORE_SWITCH and order != state.order
        return replace(_idle(state), phase=Phase.VALIDATING, order=order) if can_change else state
    if state.end is not None and (state.end.is_of(order) or not state.end.is_delivered):
        return replace(state, end=replace(state.end, is_delivered=False))
    return replace(state, phase=Phase.VALIDATING, order=order, deployment=None, failure=None, restarts=0)


def _cancelled_unknown(state: State, event: Cancelled) -> State:
    """Returns the state after the cancellation of an order that this robot never received, or that has ended."""
    if state.end is not None and (state.end.order.action_id == event.action_id or not state.end.is_delivered):
        return replace(state, end=replace(state.end, is_delivered=False))
    return replace(state, end=End(Order(event.action_id, ""), "canceled", "success"))


def _restarted(state: State) -> State:
    if state.phase not in TRIED:
        return state
    if state.restarts >= MAX_RESTARTS:
        reason = f"the agent was started again {MAX_RESTARTS} times while the new version ran"
        return _failed(state, "RobotDeploymentAborted", reason)
    return replace(state, restarts=state.restarts + 1)


def _checked(state: State, deployment: Deployment) -> State:
    if state.phase is not Phase.VALIDATING:
        return state
    if not is_newer(deployment, state.number):
        return _known(state, deployment)
    phase = Phase.DOWNLOADING if deployment.condition is None else Phase.CONDITION
    return replace(state, phase=phase, deployment=deployment)


def _known(state: State, deployment: Deployment) -> State:
    """Returns the state after an order whose deployment is not new: the order has ended.

    It is a success if this very deployment brought the last good version, else a failure. Such orders may come from an
    attacker, as they are not signed.
    """
    reason = why_refused(deployment, state.number, state.good)
    if reason is None:
        return _ended(state, "closed", "success", ("Finished",))
    return _ended_badly(state, "RobotDeploymentAborted", reason)


def _passed(state: State) -> State:
    if state.phase is Phase.WATCHING and state.deployment is not None:
        version = state.deployment.version
        has_changed = state.good is not None and state.good.folder != version.folder
        previous = state.good if has_changed else state.previous
        assert state.order is not None
        probation = Probation(state.order, state.good)
        good = replace(state, good=version, previous=previous, probation=probation, trouble="")
        return _ended(good, "closed", "success", ("Finished",))
    if state.phase is Phase.RETURNING and state.failure is not None:
        return _ended_badly(state, *state.failure)
    following = _following(state)
    return state if following is None else replace(state, phase=following)


def _following(state: State) -> Phase | None:
    """Returns the phase after the current one.

    Phases of scripts that the deployment does not have are skipped, as each would cost a save and a message.
    """
    following = _NEXT.get(state.phase)
    launch = state.deployment.version.launch if state.deployment is not None else None
    if following is Phase.PRE_LAUNCH and launch is not None and launch.before is None:
        return Phase.LAUNCHING
    if following is Phase.POST_LAUNCH and launch is not None and launch.after is None:
        return Phase.WATCHING
    return following


def _failed(state: State, code: str, reason: str) -> State:
    if state.phase in TRIED:
        back = "the robot went back to " + (f"version {state.good.version}" if state.good else "running nothing")
        return replace(state, phase=Phase.RETURNING, failure=(code, f"{reason}; {back}"))
    if state.phase is Phase.RETURNING and state.failure is not None:
        first, before = state.failure
        return _ended_badly(state, first, f"{before}, which failed: {reason}")
    return _ended_badly(state, code, reason)


def _ended_badly(state: State, code: str, reason: str) -> State:
    return _ended(state, "closed", "failure", (STEPS.get(state.phase, "Finished"), reason), NUMBERS[code])


def _ended(
    state: State, execution: str, finished: str, details: tuple[str, ...] = (), code: int | None = None
) -> State:
    assert state.order is not None
    is_new = execution == "closed" and state.deployment is not None
    number = state.deployment.number if is_new and state.deployment is not None else state.number
    return replace(_idle(state), end=End(state.order, execution, finished, code, details), number=number)


def _idle(state: State) -> State:
    return replace(state, phase=Phase.IDLE, order=None, deployment=None, failure=None, restarts=0)
