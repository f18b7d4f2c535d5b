"""Stored rollout of a deployment job: applies events from the catalog and time-outs, and gives robots their orders.

Any process may do this, several at once: a rollout is stored only if no other changed it meanwhile, and applied events
are removed with it. Normally the run of the deployment job does it; calls that stop a deployment do it at once, and
after the job's end, robots' reports cause it.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

from pydantic import TypeAdapter

from ...schemas.documents.document_base import FailureChanges
from ...schemas.fleet.documents import RobotDocument, RobotMembership
from ...schemas.fleet.operations.deployment_jobs import DeploymentLaunchConfig
from ...schemas.fleet.rollouts.rollout import (
    Canceled,
    Departure,
    Offered,
    Outage,
    Report,
    RobotGone,
    Rollback,
    Rollout,
    RolloutEvent,
    StopCause,
    Stopped,
)
from ...schemas.fleet.rollouts.rollout_plan import Artifact, Delivery
from ...schemas.lifecycles import is_terminal
from ...schemas.wire.errors import ResourceNotFoundException, ServiceUnavailableException, StateConflictError
from ..catalog import Resource, Stored
from ..service.service import Service
from .catalog_rollouts import Rollouts, StoredEvent
from .rollout.ledger import Ledger
from .rollout.statuses import robot_status

_EVENT: TypeAdapter[RolloutEvent] = TypeAdapter(RolloutEvent)
_ENDS = {"Succeeded": "succeed", "Failed": "fail", "Canceled": "cancel"}
_MAX_ATTEMPTS = 100

GAP_S = 60.0
"""Gap between two updates of a rollout, in seconds, from which on the service counts as having been down.

Robots could not do much in that time, so their time-outs are extended by it.
"""


@dataclass(frozen=True)
class _Read:
    """Rollout as it was read from the catalog, with its revision."""

    revision: int
    rollout: Rollout


class KeptRollout:
    """The stored state of a deployment to robots, which applies events and saves the result. For one thread.

    Args:
        job: The deployment job; it has a rollout.
        service: The service, with its catalog and object store.

    Raises:
        ResourceNotFoundException: The deployment job has no rollout.
    """

    def __init__(self, job: Resource, service: Service) -> None:
        self.job = job
        self._service = service
        self._load()

    @property
    def rollout(self) -> Rollout:
        """State of the deployment's robots, as this object last read or stored it."""
        return self._read.rollout

    def fold(self, *events: RolloutEvent) -> bool:
        """Applies stored events, given ones and time-outs, gives robots new orders, saves, and ends the job if done.

        Returns:
            Whether anything happened.

        Raises:
            ServiceUnavailableException: The catalog does not answer; ask again.
        """
        happened = self._fold(events)
        if self.rollout.status != "InProgress":
            self._end_job()
            happened = self._fold(()) or happened  # what was reported before the job had ended
        return happened

    def refresh(self) -> None:
        """Reads the stored state of the robots again, because another process has changed it."""
        self._load()

    def keep_alive(self) -> None:
        """Stores that the service ran until now; a later gap counts as an outage, which extends time limits."""
        self._ledger.pass_time(self._now_s())
        if not self._store(self._ledger, ()):
            self._load()

    def is_outdated(self) -> bool:
        """Whether another process has changed the stored state of the robots since it was read."""
        return Rollouts(self._service.catalog).rollout_revision(self.job.arn) != self._read.revision

    def note_rollback(self, rollback: Rollback) -> None:
        """Stores the state of the rollback, in which robots return to the application version they had before.

        It tries again if another process has changed the deployment, and raises an error after some tries.
        """
        for _ in range(_MAX_ATTEMPTS):
            if self.rollout.rollback == rollback:
                return
            self._ledger.note_rollback(rollback)
            if self._store(self._ledger, ()):
                return
            self._load()
        raise _changed_by_others(self.job.arn)

    def unanswered(self) -> dict[str, int]:
        """Returns cancelled orders that robots have not answered and may still carry out, by robot."""
        return self._ledger.unanswered()

    def give_away(self, orders: Mapping[str, int]) -> list[str]:
        """Closes unanswered orders that a later deployment takes over: it waits for the robots' answers to them.

        Args:
            orders: Numbers of the orders, by robot; orders of other robots are not changed.

        Returns:
            The robots of them that have answered already.
        """
        for _ in range(_MAX_ATTEMPTS):
            own = {robot: number for robot, number in orders.items() if self._last_order(robot) == number}
            mine = self._ledger.unanswered()
            for robot, number in own.items():
                self._ledger.apply(Canceled(robot=robot, action_id=number), self._now_s())
            if own.keys().isdisjoint(mine) or self._store(self._ledger, ()):
                return [robot for robot in own if robot not in mine]
            self._load()
        raise _changed_by_others(self.job.arn)

    def _last_order(self, robot: str) -> int | None:
        state = self.rollout.robots.get(robot)
        return None if state is None else (state.earlier_action_id or state.action_id)

    def _fold(self, events: Sequence[RolloutEvent]) -> bool:
        try:
            for _ in range(_MAX_ATTEMPTS):
                waiting = Rollouts(self._service.catalog).events(self.job.arn)
                if not self._take_in(waiting, events):
                    return False
                if self._store(self._ledger, waiting):
                    return True
                self._load()
        except BaseException:
            self._load()  # without what was not stored
            raise
        raise _changed_by_others(self.job.arn)

    def _take_in(self, waiting: Sequence[StoredEvent], events: Sequence[RolloutEvent]) -> bool:
        """Applies events and time-outs up to now; returns whether anything happened."""
        ledger, now_s = self._ledger, self._now_s()
        wake_s, watched_s = ledger.wake_s(), self._watched_s
        for each in waiting:
            watched_s = _bridge(ledger, watched_s, each.at_s)
            ledger.apply(_EVENT.validate_python(each.event), each.at_s)
        self._watched_s = _bridge(ledger, watched_s, now_s)
        for event in events:
            ledger.apply(event, now_s)
        ledger.pass_time(now_s)
        offered = self._offer(ledger, now_s)
        return bool(waiting or events or offered) or (wake_s is not None and wake_s <= now_s)

    def _offer(self, ledger: Ledger, now_s: float) -> bool:
        offers = ledger.offers()
        numbers = Rollouts(self._service.catalog).number_orders(self.job.arn, len(offers)) if offers else []
        for robot, number in zip(offers, numbers, strict=True):
            ledger.apply(Offered(robot=robot, action_id=number), now_s)
        return bool(offers)

    def _store(self, ledger: Ledger, applied: Sequence[StoredEvent]) -> bool:
        before, after = self.rollout, ledger.rollout()
        numbers = [each.sequence for each in applied]
        revision = self._read.revision
        stored = Rollouts(self._service.catalog).replace_rollout(
            self.job.arn, revision, after.to_json(), is_open=has_orders(after), applied=numbers
        )
        if stored:
            self._read = _Read(revision + 1, after)
            self._show(before, after)
        return stored

    def _show(self, before: Rollout, after: Rollout) -> None:
        """Stores, in the robots' records, the statuses of robots that differ between two states of the deployment."""
        active, was_active = after.status == "InProgress", before.status == "InProgress"
        for robot, state in after.robots.items():
            old = before.robots[robot]
            if (old is state and active == was_active) or state.gone is not None:
                continue
            status = robot_status(state, active=active)
            if status is not None and status != robot_status(old, active=was_active):
                set_robot_status(robot, str(self.job.parent), status, self._service)

    def _end_job(self) -> None:
        rollout, catalog = self.rollout, self._service.catalog
        if is_terminal(self.job.kind, catalog.standing(self.job.arn)[0]):
            return
        changes = FailureChanges(failure_code=rollout.failure_code, failure_reason=rollout.failure_reason)
        with suppress(StateConflictError):  # another has just done so
            catalog.transition(self.job.arn, _ENDS[rollout.status], document_changes=changes)

    def _load(self) -> None:
        stored = Rollouts(self._service.catalog).rollout(self.job.arn)
        if stored is None:
            raise ResourceNotFoundException(f"{self.job.arn} has no rollout")
        self._read = _Read(stored.revision, Rollout.of_json(dict(stored.rollout)))
        self._ledger = Ledger(self._read.rollout)
        self._watched_s = self._read.rollout.now_s

    def _now_s(self) -> float:
        return self._service.clock().timestamp()


def _bridge(ledger: Ledger, since_s: float, until_s: float) -> float:
    """Extends time-outs by a gap in which the service was not running; returns the later of both times."""
    if until_s - since_s > GAP_S:
        ledger.apply(Outage(since_s=since_s), until_s)
    return max(since_s, until_s)


def _changed_by_others(job: str) -> ServiceUnavailableException:
    return ServiceUnavailableException(f"the rollout of {job} is being changed by others; try again")


def has_orders(rollout: Rollout) -> bool:
    """Whether robots of a deployment have orders to install, may still get some, or have to be rolled back.

    Robots that were deleted do not count, as they answer nothing.
    """
    return (
        rollout.status == "InProgress"
        or rollout.rollback_is_due
        or any(
            state.order not in ("none", "closed")
            or state.earlier_action_id is not None
            or (state.returned and rollout.takes_returns)
            for state in rollout.robots.values()
            if state.gone != "deleted"
        )
    )


def set_robot_status(robot: str, fleet: str, status: str, service: Service) -> None:
    """Sets the status of a robot in the catalog; does nothing if the robot was deleted or has left the fleet."""

    def unchanged(stored: Stored) -> RobotMembership:
        if RobotDocument.model_validate(stored).fleet != fleet:
            raise ResourceNotFoundException(f"{robot} is not in {fleet}")
        return RobotMembership()

    with suppress(ResourceNotFoundException):
        service.catalog.update(robot, unchanged, status=status)


@dataclass(frozen=True)
class OpenRollout:
    """A deployment to robots that may have open orders (to install or cancel), as it was last read."""

    job: str
    """ARN of the deployment job of a rollout."""

    revision: int
    """Revision number of the stored rollout; it grows with each change."""

    rollout: Rollout
    """State of the rollout and of each robot.

    A robot's `earlier_action_id` has to be answered before its `order` and `action_id`.
    """

    artifacts: dict[str, Artifact]
    """Files that robots download, by the robot's ARN; robots that cannot get the application are missing."""

    launch: DeploymentLaunchConfig
    """Launch configuration of the application in a rollout."""


def served_rollouts(service: Service, known: Mapping[str, OpenRollout] | None = None) -> list[OpenRollout]:
    """Returns the open rollouts, after applying late reports about deployments that have ended.

    No run applies these reports any more. All are applied together, since each time the whole rollout is read.
    """
    catalog = service.catalog
    for job in catalog.get_many(Rollouts(catalog).jobs_with_events()).values():
        if is_terminal(job.kind, job.status):
            with suppress(ResourceNotFoundException):  # it was deleted meanwhile
                KeptRollout(job, service).fold()
    return open_rollouts(service, known)


def open_rollouts(service: Service, known: Mapping[str, OpenRollout] | None = None) -> list[OpenRollout]:
    """Returns the rollouts whose robots may have open orders, also of jobs that have ended.

    Args:
        service: The service, with its catalog and object store.
        known: Rollouts that were read before, by job; unchanged ones are not read again.

    Returns:
        The rollouts, those of older jobs first.

    Raises:
        ServiceUnavailableException: The catalog does not answer.
    """
    found: list[OpenRollout] = []
    for job, revision in Rollouts(service.catalog).open_rollouts().items():
        before = (known or {}).get(job)
        if before is not None and before.revision == revision:
            found.append(before)
        elif (stored := Rollouts(service.catalog).rollout(job)) is not None:
            delivery = Delivery.of_json(dict(stored.delivery))
            rollout = Rollout.of_json(dict(stored.rollout))
            found.append(OpenRollout(job, stored.revision, rollout, delivery.by_robot(), delivery.launch))
    return found


def report(service: Service, job: str, event: Report, at_s: float) -> None:
    """Stores a robot's report on its order to install, as an event that the deployment applies later.

    After the job's end, `served_rollouts` makes it part of the rollout.

    Args:
        service: The service, with its catalog and object store.
        job: ARN of the deployment job that the order belongs to; of one that has taken the order over, or the first.
        event: The robot's report; repetitions change nothing, and neither do orders of jobs that do not exist.
        at_s: Time of the event, in seconds since the epoch.

    Raises:
        ServiceUnavailableException: The catalog does not answer; the robot has to say it again.
    """
    with suppress(ResourceNotFoundException):
        Rollouts(service.catalog).add_event(job, event.to_json(), at_s, order=event.action_id)


def note_departure(robot: str, fleet: str, how: Departure, service: Service) -> None:
    """Adds an event to the rollouts of a fleet: a robot left the fleet or was deleted."""
    event = RobotGone(robot=robot, how=how)
    for job in Rollouts(service.catalog).open_rollouts(fleet):
        _note(service, job, event, service.clock().timestamp())


def stop(job: str, why: StopCause, service: Service) -> bool:
    """Ends a deployment to robots and its job at once: no robot gets an order any more, and open ones are cancelled.

    Returns:
        False if it has no rollout, so that nothing was done.
    """
    if Rollouts(service.catalog).rollout(job) is None:
        return False
    KeptRollout(service.catalog.get(job), service).fold(Stopped(why=why))
    return True


def _note(service: Service, job: str, event: RolloutEvent, at_s: float) -> None:
    catalog = service.catalog
    Rollouts(catalog).add_event(job, event.to_json(), at_s)
    found = catalog.get(job)
    if is_terminal(found.kind, found.status):  # no run takes it in
        KeptRollout(found, service).fold()
