"""Rollouts in the catalog, for what speaks to the robots: which orders are open, and what robots report of them.

```
          open_rollouts                 report
   robots <──────────── the catalog <──────────── robots
                         │      ^
                 events  v      │  orders, cancellations
                   the run of the deployment job
```
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

from ...schemas.lifecycles import is_terminal
from ...schemas.operations.deployment_jobs import DeploymentLaunchConfig
from ...schemas.rollouts.artifacts import Artifact, Delivery
from ...schemas.rollouts.events import Report, RobotGone, RolloutEvent, StopCause, Stopped
from ...schemas.rollouts.robots import Departure
from ...schemas.rollouts.rollout import Rollout
from ...schemas.wire.errors import ResourceNotFoundException
from ..service.service import Service
from .kept_rollouts import KeptRollout


@dataclass(frozen=True)
class OpenRollout:
    """A rollout whose robots may have orders to carry out, or to give up."""

    job: str
    """ARN of its deployment job."""

    revision: int
    """Grows with each change."""

    rollout: Rollout
    """How each robot stands: `order` and `action_id`, and `earlier_action_id`, which comes first."""

    artifacts: dict[str, Artifact]
    """Files that robots download, by the robot's ARN; robots that cannot get the application are absent."""

    launch: DeploymentLaunchConfig
    """How the application is started."""


def served_rollouts(service: Service, known: Mapping[str, OpenRollout] | None = None) -> list[OpenRollout]:
    """The same as `open_rollouts`, once what robots reported of deployments that have ended was taken in.

    No run takes that in any more. It is done for all reports together, since each time the whole rollout is read.
    """
    catalog = service.catalog
    for job in catalog.get_many(catalog.jobs_with_events()).values():
        if is_terminal(job.kind, job.status):
            with suppress(ResourceNotFoundException):  # it was deleted meanwhile
                KeptRollout(job, service).fold()
    return open_rollouts(service, known)


def open_rollouts(service: Service, known: Mapping[str, OpenRollout] | None = None) -> list[OpenRollout]:
    """The rollouts whose robots may have orders to carry out or to give up, also those of jobs that have ended.

    Args:
        service: where they are stored.
        known: those that were read before, by job; what has not changed is not read again.

    Returns:
        Them, those of older jobs first.

    Raises:
        ServiceUnavailableException: the catalog does not answer.
    """
    found: list[OpenRollout] = []
    for job, revision in service.catalog.open_rollouts().items():
        before = (known or {}).get(job)
        if before is not None and before.revision == revision:
            found.append(before)
        elif (stored := service.catalog.rollout(job)) is not None:
            delivery = Delivery.of_json(dict(stored.delivery))
            rollout = Rollout.of_json(dict(stored.rollout))
            found.append(OpenRollout(job, stored.revision, rollout, delivery.by_robot(), delivery.launch))
    return found


def report(service: Service, job: str, event: Report, at_s: float) -> None:
    """Takes in what a robot reported; once it returns, that is stored.

    After the job's end, `served_rollouts` makes it part of the rollout.

    Args:
        service: where the rollout is stored.
        job: ARN of the deployment job that the order belongs to; of one that has taken the order over, or the first.
        event: what the robot said; repetitions change nothing, and neither do orders of jobs that do not exist.
        at_s: when, in seconds since the epoch.

    Raises:
        ServiceUnavailableException: the catalog does not answer; the robot has to say it again.
    """
    with suppress(ResourceNotFoundException):
        service.catalog.add_event(job, event.to_json(), at_s, order=event.action_id)


def note_departure(robot: str, fleet: str, how: Departure, service: Service) -> None:
    """Tells the rollouts of a fleet that a robot left it or was deleted."""
    event = RobotGone(robot=robot, how=how)
    for job in service.catalog.open_rollouts(fleet):
        _note(service, job, event, service.clock().timestamp())


def stop(job: str, why: StopCause, service: Service) -> bool:
    """Ends the rollout of a job, and the job with it, at once.

    Returns:
        False if it has no rollout, so that nothing was done.
    """
    if service.catalog.rollout(job) is None:
        return False
    KeptRollout(service.catalog.get(job), service).fold(Stopped(why=why))
    return True


def _note(service: Service, job: str, event: RolloutEvent, at_s: float) -> None:
    catalog = service.catalog
    catalog.add_event(job, event.to_json(), at_s)
    found = catalog.get(job)
    if is_terminal(found.kind, found.status):  # no run takes it in
        KeptRollout(found, service).fold()
