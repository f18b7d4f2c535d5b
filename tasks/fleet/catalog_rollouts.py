"""Database tables of rollouts: their states, the numbers of orders to robots, and events that are not applied yet.

```
  add_event ──> rollout_events ──> read, applied, replace_rollout (one transaction) ──> rollouts
```

A rollout is changed by compare-and-set on its revision. Events that were applied are removed in the same transaction,
so each counts, and none is lost if the process dies in between.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import and_, delete, insert, select, update
from sqlalchemy.exc import IntegrityError

from ..catalog import Catalog
from ..catalog.queries import changed_one, not_found
from ..catalog.tables import resources
from .tables import robot_orders, rollout_events, rollouts

_MOST_EVENTS = 1000


@dataclass(frozen=True)
class StoredRollout:
    """A rollout (deployment to robots) as the catalog stores it, in plain JSON."""

    job: str
    revision: int
    is_open: bool
    delivery: Mapping[str, Any]
    rollout: Mapping[str, Any]


@dataclass(frozen=True)
class StoredEvent:
    """A stored event of a deployment to robots, such as a robot's report, not yet applied; in plain JSON."""

    sequence: int
    at_s: float
    event: Mapping[str, Any]


class Rollouts:
    """Database access to the rollouts of deployment jobs; each method is one transaction.

    Args:
        catalog: Keeps them beside its resources.
    """

    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog

    def begin_rollout(self, job: str, delivery: Mapping[str, Any], rollout: Mapping[str, Any]) -> bool:
        """Stores a rollout (state of a deployment to robots) for a deployment job, unless it has one.

        Returns:
            False if the job has one, which stays as it is.

        Raises:
            ResourceNotFoundException: The catalog has no such job.
        """
        row = {"job": job, "revision": 1, "is_open": True, "delivery": dict(delivery), "rollout": dict(rollout)}
        try:
            with self._catalog.writing() as connection:
                connection.execute(insert(rollouts).values(row))
        except IntegrityError:
            if self.rollout(job) is None:
                raise not_found(job) from None
            return False
        return True

    def rollout(self, job: str) -> StoredRollout | None:
        """Reads the state of a deployment's robots; `None` if the job does not exist, or has not begun with robots."""
        with self._catalog.reading() as connection:
            row = connection.execute(select(rollouts).where(rollouts.c.job == job)).mappings().one_or_none()
        return None if row is None else StoredRollout(**row)

    def rollout_revision(self, job: str) -> int | None:
        """Returns the revision number of the stored state of a deployment's robots; `None` if there is none."""
        with self._catalog.reading() as connection:
            return connection.scalar(select(rollouts.c.revision).where(rollouts.c.job == job))

    def open_rollouts(self, fleet: str | None = None) -> dict[str, int]:
        """Returns the revisions of deployments whose robots may have open orders, by deployment job, oldest first.

        Args:
            fleet: ARN of the fleet; `None`: all fleets.
        """
        query = select(rollouts.c.job, rollouts.c.revision).join(resources, resources.c.arn == rollouts.c.job)
        query = query.where(rollouts.c.is_open).order_by(resources.c.sequence)
        if fleet is not None:
            query = query.where(resources.c.parent == fleet)
        with self._catalog.reading() as connection:
            return {row[0]: row[1] for row in connection.execute(query)}

    def replace_rollout(
        self, job: str, revision: int, rollout: Mapping[str, Any], *, is_open: bool, applied: Sequence[int] = ()
    ) -> bool:
        """Stores the robots' new state and removes the applied events, unless another process changed the state.

        Args:
            job: ARN of its deployment job.
            revision: The revision that was read; the next is one more.
            rollout: Current state of the rollout.
            is_open: Whether its robots may have orders.
            applied: The `sequence` of each event that it has taken in.

        Returns:
            Whether it was stored.
        """
        unchanged = and_(rollouts.c.job == job, rollouts.c.revision == revision)
        values = {"revision": revision + 1, "rollout": dict(rollout), "is_open": is_open}
        with self._catalog.writing() as connection:
            if not changed_one(connection.execute(update(rollouts).where(unchanged).values(values))):
                return False
            if applied:  # each by its own number: PostgreSQL may show a smaller one later
                connection.execute(delete(rollout_events).where(rollout_events.c.sequence.in_(applied)))
        return True

    def number_orders(self, job: str, count: int) -> list[int]:
        """Reserves unique, increasing numbers for orders to robots.

        Raises:
            ResourceNotFoundException: The catalog has no such job.
        """
        try:
            with self._catalog.writing() as connection:
                added = insert(robot_orders).values(job=job).returning(robot_orders.c.number)
                return [int(connection.execute(added).scalar_one()) for _ in range(count)]
        except IntegrityError:
            raise not_found(job) from None

    def move_orders(self, numbers: Sequence[int], job: str) -> None:
        """Redirects robots' reports on some orders to a later deployment, which waits until robots give these up."""
        with self._catalog.writing() as connection:
            for start in range(0, len(numbers), 500):
                chunk = numbers[start : start + 500]
                moved = update(robot_orders).where(robot_orders.c.number.in_(chunk)).values(job=job)
                connection.execute(moved)

    def add_event(self, job: str, event: Mapping[str, Any], at_s: float, *, order: int | None = None) -> str:
        """Stores an event (such as a robot's report) for the rollout of a deployment job.

        Args:
            job: ARN of the deployment job.
            event: The event to apply.
            at_s: Time of the event, in seconds since the epoch.
            order: The number of the order that it is about; it decides the job, if that order was moved.

        Returns:
            The job that it was stored for.

        Raises:
            ResourceNotFoundException: The catalog has no such job.
        """
        try:
            with self._catalog.writing() as connection:
                owner = select(robot_orders.c.job).where(robot_orders.c.number == order)
                meant = (connection.scalar(owner) if order is not None else None) or job
                connection.execute(insert(rollout_events).values(job=meant, at_s=at_s, event=dict(event)))
                return str(meant)
        except IntegrityError:
            raise not_found(job) from None

    def jobs_with_events(self) -> list[str]:
        """Returns the ARNs of the deployment jobs that have events not yet applied to their rollouts."""
        query = select(rollout_events.c.job).distinct()
        with self._catalog.reading() as connection:
            return sorted(connection.scalars(query))

    def events(self, job: str) -> tuple[StoredEvent, ...]:
        """Returns a job's events that are not yet applied to its rollout, in order; the first thousand."""
        columns = (rollout_events.c.sequence, rollout_events.c.at_s, rollout_events.c.event)
        query = select(*columns).where(rollout_events.c.job == job).order_by(rollout_events.c.sequence)
        with self._catalog.reading() as connection:
            return tuple(StoredEvent(*row) for row in connection.execute(query.limit(_MOST_EVENTS)))
