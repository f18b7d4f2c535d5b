"""Leases: which job worker runs which job, which jobs wait, and how many job workers died while running a job."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import BindParameter, ColumnElement, Update, and_, bindparam, case, func, null, or_, select, update

from ...schemas.lifecycles import LIFECYCLES
from .queries import COLUMNS, alive, changed_one, has_member, not_found, one_row, resource_of
from .reading import CatalogReader
from .records import Ownership, Resource
from .tables import UtcTime, resources

_BATCH = "simulation-job-batch"
_CHUNK = 500  # of ARNs in one query


def _is_free(now: datetime | BindParameter[Any]) -> ColumnElement[bool]:
    """Returns the SQL condition that a resource has no lease (lock of a job worker), or one that has run out."""
    return or_(resources.c.lease_owner.is_(None), resources.c.lease_expires_at <= now)


# A lease of another that has run out was a lost worker's.
_WAS_LOST = and_(resources.c.lease_owner.is_not(None), resources.c.lease_owner != bindparam("held_by"))

# Made once, as each job takes a lease and gives it back, and making a statement takes as long as executing it.
_TAKEN = (
    update(resources)
    .where(resources.c.arn == bindparam("of"))
    .values(
        lost_workers=resources.c.lost_workers + case((_WAS_LOST, 1), else_=0),
        lease_owner=bindparam("held_by"),
        lease_expires_at=bindparam("until"),
        lost_owner=case((_WAS_LOST, resources.c.lease_owner), else_=resources.c.lost_owner),
        last_owner=bindparam("held_by"),
        owner_since=case(
            (resources.c.last_owner == bindparam("held_by"), resources.c.owner_since),
            else_=bindparam("now", type_=UtcTime),
        ),
    )
)
_CLAIMED = _TAKEN.where(or_(_is_free(bindparam("now")), resources.c.lease_owner == bindparam("held_by")))
_HELD = update(resources).where(resources.c.arn == bindparam("of"), resources.c.lease_owner == bindparam("held_by"))

_OWNERSHIP = select(
    resources.c.arn,
    resources.c.last_owner,
    resources.c.owner_since,
    resources.c.lease_owner,
    resources.c.lost_owner,
    resources.c.needed_environment,
    (resources.c.lease_expires_at <= bindparam("now")).label("has_run_out"),
)


class CatalogLeases(CatalogReader):
    """Leases in the catalog: time-limited locks by which job workers claim the jobs that they run."""

    def claim(self, arn: str, owner: str, lease_s: float) -> bool:
        """Takes the lease of a resource (a lock that runs out unless it is renewed) if no other owner holds it.

        A lease that has run out was its owner's until it died: `lost_workers` counts that. Its owner may take it again.

        Args:
            arn: The resource.
            owner: Name of the caller, which no other has in this process or another.
            lease_s: Time without renewal after which another owner may take it, in seconds.

        Returns:
            Whether `owner` holds the lease now.

        Raises:
            ResourceNotFoundException: The catalog has no such resource.
        """
        now = self._now()
        values = {"now": now, "until": now + timedelta(seconds=lease_s)}
        return self._lease(_CLAIMED, arn, owner, values)

    def claim_child(
        self, parent: str, kind: str, owner: str, lease_s: float, *, most: str, parent_in: Sequence[str], finishing: str
    ) -> str | None:
        """Takes the lease (lock) of the oldest unfinished child, such as a batch's job, that no other owner holds.

        No more of them are ever held at once than the parent's document says: they are counted in the transaction
        that takes the lease, and such transactions of one parent come one after the other. As many may be held beside
        them that only finish.

        Args:
            parent: ARN of the children's parent.
            kind: Kind of the children.
            owner: Name of the caller, which no other has in this process or another.
            lease_s: Time without renewal after which another owner may take it, in seconds.
            most: Member of the parent's document that says how many may be held at once.
            parent_in: Statuses of the parent in which they are taken.
            finishing: Member that the document of a resource has once it only finishes.

        Returns:
            ARN of the resource; `None`: there is none, or as many are held as may be.
        """
        now = self._now()
        # PostgreSQL locks the parent's row; a writer of SQLite has locked the whole file.
        allowed = (
            select(resources.c.document[most].as_integer())
            .where(resources.c.arn == parent, resources.c.status.in_(parent_in))
            .with_for_update(key_share=True)
        )
        living = and_(resources.c.parent == parent, resources.c.kind == kind, resources.c.status.in_(alive(kind)))
        finishes = func.coalesce(func.sum(case((has_member(finishing), 1), else_=0)), 0)
        held = select(func.count(), finishes).select_from(resources).where(living, ~_is_free(now))
        # PostgreSQL locks it: `claim` may be taking it. Such a one is passed over.
        first = (
            select(resources.c.arn)
            .where(living, _is_free(now))
            .order_by(resources.c.sequence)
            .limit(1)
            .with_for_update(skip_locked=True)
        )
        with self._transaction(self._writer) as connection:
            most_held = connection.scalar(allowed) or 0  # first: from here on the transaction is alone
            all_held, finish = connection.execute(held).one()
            if all_held - min(finish, most_held) >= most_held:
                return None
            arn = connection.scalar(first)
            if arn is not None:
                values = {"held_by": owner, "now": now, "until": now + timedelta(seconds=lease_s)}
                connection.execute(_TAKEN, {"of": arn, **values})
            return arn

    def renew(self, arn: str, owner: str, lease_s: float) -> bool:
        """Extends a lease (lock of a resource), even an expired one, unless another owner has taken it.

        Returns:
            Whether `owner` still holds the lease.
        """
        until = self._now() + timedelta(seconds=lease_s)
        return self._lease(_HELD, arn, owner, {"lease_expires_at": until})

    def release(self, arn: str, owner: str) -> bool:
        """Gives up a lease (lock of a resource), so that others can take it at once.

        Returns:
            Whether `owner` held it.
        """
        return self._lease(_HELD, arn, owner, {"lease_owner": None, "lease_expires_at": None})

    def lease_of(self, arn: str) -> tuple[str | None, bool]:
        """Returns the owner of a resource's lease, or `None`, and whether the lease has expired.

        Raises:
            ResourceNotFoundException: The catalog has no such resource.
        """
        held = select(resources.c.lease_owner, resources.c.lease_expires_at <= self._now()).where(
            resources.c.arn == arn
        )
        with self._transaction(self._engine) as connection:
            row = connection.execute(held).one_or_none()
        if row is None:
            raise not_found(arn)
        return row[0], bool(row[1])

    def ownerships(self, arns: Iterable[str]) -> dict[str, Ownership]:
        """Returns who owns or owned the leases of some jobs, by the job's ARN; jobs that do not exist are left out."""
        wanted = sorted(set(arns))
        found: dict[str, Ownership] = {}
        with self._transaction(self._engine) as connection:
            for start in range(0, len(wanted), _CHUNK):
                some = _OWNERSHIP.where(resources.c.arn.in_(wanted[start : start + _CHUNK]))
                for row in connection.execute(some, {"now": self._now()}):
                    found[row.arn] = Ownership(
                        owner=row.last_owner,
                        since=row.owner_since,
                        is_held=row.lease_owner is not None and not row.has_run_out,
                        is_released=row.lease_owner is None,
                        lost_owner=row.lost_owner,
                        needed_environment=row.needed_environment,
                    )
        return found

    def expire_leases(self, owners: str) -> int:
        """Expires the leases of a process that is known to be dead, so that others need not wait.

        Args:
            owners: Prefix of the names of the leases' owners.

        Returns:
            Number of leases that the process held.
        """
        held = resources.c.lease_owner.startswith(owners, autoescape=True)
        with self._transaction(self._writer) as connection:
            ended = connection.execute(update(resources).where(held).values(lease_expires_at=self._now()))
            return ended.rowcount

    def lost_workers(self, arn: str) -> int:
        """Returns how many job workers died while they held a resource's lease and had to be replaced.

        Raises:
            ResourceNotFoundException: The catalog has no such resource.
        """
        with self._transaction(self._engine) as connection:
            lost = connection.scalar(select(resources.c.lost_workers).where(resources.c.arn == arn))
        if lost is None:
            raise not_found(arn)
        return int(lost)

    def forget_lost_workers(self, arn: str, owner: str) -> None:
        """Resets the count of lost job workers to 0, because the job has made progress since.

        Args:
            arn: The resource.
            owner: Holds its lease; otherwise nothing is changed.
        """
        self._lease(_HELD, arn, owner, {"lost_workers": 0})

    def unfinished(
        self, kinds: Sequence[str], limit: int = 100, *, without: Collection[str] = ()
    ) -> tuple[Resource, ...]:
        """Lists the unfinished jobs that no job worker holds, oldest first.

        Jobs of a batch that has not ended are left out: the worker that runs the batch runs them.

        Args:
            kinds: Kinds of the jobs.
            limit: Largest number of resources.
            without: ARNs of jobs that are left out, too.
        """
        batches = resources.alias("batches")
        in_live_batch = (
            select(batches.c.arn)
            .where(batches.c.arn == resources.c.parent, batches.c.kind == _BATCH, batches.c.status.in_(alive(_BATCH)))
            .exists()
        )
        query = select(*COLUMNS).where(
            resources.c.kind.in_(kinds),
            resources.c.status.in_(sorted({status for kind in kinds for status in alive(kind)})),
            or_(resources.c.lease_owner.is_(None), resources.c.lease_expires_at <= self._now()),
            ~in_live_batch,
        )
        if without:
            query = query.where(resources.c.arn.not_in(sorted(without)))
        # Not by the plain column: SQLite would walk along all jobs there ever were instead of the few unfinished.
        oldest_first = query.order_by(resources.c.sequence + 0).limit(limit)
        with self._transaction(self._engine) as connection:
            return tuple(resource_of(row) for row in connection.execute(oldest_first).mappings())

    def ordered_for_oneself(self) -> tuple[Resource, ...]:
        """Lists the unfinished jobs that only the process which ordered them was to run, oldest first, held or not."""
        living = or_(
            *(and_(resources.c.kind == kind, resources.c.status.in_(alive(kind))) for kind in LIFECYCLES),
        )
        query = select(*COLUMNS).where(living, resources.c.needed_environment.is_not(null()))
        with self._transaction(self._engine) as connection:
            rows = connection.execute(query.order_by(resources.c.sequence)).mappings()
            return tuple(resource_of(row) for row in rows)

    def _lease(self, statement: Update, arn: str, owner: str, values: Mapping[str, Any]) -> bool:
        with self._transaction(self._writer) as connection:
            if changed_one(connection.execute(statement, {"of": arn, "held_by": owner, **values})):
                return True
            one_row(connection, arn)
            return False
