"""Catalog of all resources, usable from any thread and any process."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import Connection, RowMapping, and_, bindparam, delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from ...schemas.documents.document_base import Changes, Document
from ...schemas.documents.kinds import upgraded
from ...schemas.lifecycles import LIFECYCLES, is_terminal
from ...schemas.state_machines import next_state
from ...schemas.wire.arns import ResourceArn
from ...schemas.wire.errors import LimitExceededException, StateConflictError
from .client_tokens import ClientToken, find_resource, store_token
from .leases import CatalogLeases
from .queries import (
    COLUMNS,
    changed_one,
    check_free,
    insert_labels,
    not_found,
    one_row,
    replace_labels,
    resource_of,
)
from .records import FirstLease, NewResource, Resource
from .resource_tags import insert_tags, merged_tags, replace_tags
from .tables import resources

_MAX_ATTEMPTS = 100
_CHUNK = 500  # of ARNs in one query

_CHANGED_DOCUMENT = (
    update(resources)
    .where(resources.c.arn == bindparam("meant"))
    .values(document=bindparam("changed"), revision=resources.c.revision + 1)
)

# Made once: each job is changed about five times, and making a statement takes as long as executing it. What an update
# sets, or an insert adds, are the values that it is executed with.
_UNCHANGED = update(resources).where(resources.c.arn == bindparam("of"), resources.c.revision == bindparam("seen"))
_UNCHANGED_AND_HELD = _UNCHANGED.where(resources.c.lease_owner == bindparam("held_by"))
_ADDED = insert(resources).returning(resources.c.sequence)

Stored = dict[str, Any]
"""Resource document as it is stored, in plain JSON."""

Change = Changes | Mapping[str, Any]
"""Change of a document: a whole `Document`, or `Changes` of some members; a mapping is plain JSON."""


class Catalog(CatalogLeases):
    """Database of all resources (worlds, jobs, applications, robots) with methods to change them. Open it with `open`.

    Every method is one transaction, and raises `ServiceUnavailableException` when the database does
    not do its part: locked for half a minute, full, gone.

    Methods that change a resource raise `StateConflictError` when an `owner` is given that does not
    hold the resource's lease: a job worker that lost its lease to another cannot change anything any
    more.
    """

    @classmethod
    def open(cls, url: str, *, clock: Callable[[], datetime]) -> "Catalog":
        """Opens a catalog database, and creates or updates its tables if necessary.

        Args:
            url: SQLAlchemy URL: `sqlite:////folder/catalog.db`, or one of a PostgreSQL database.
            clock: Function that returns the time, with a time zone.

        Raises:
            ConfigurationError: The URL leads nowhere, or a newer program made the catalog.
        """
        return cls(url, clock)

    # Creating and deleting

    def create(
        self,
        resource: NewResource,
        *,
        token: ClientToken | None,
        unique_name: bool = False,
        lease: FirstLease | None = None,
    ) -> Resource:
        """Adds a resource to the catalog, or returns the one that an earlier call with the same client token added.

        The answer's ARN tells which: it differs from `resource.arn` if the call is a repetition.

        Args:
            resource: The resource to add.
            token: The caller's token; `None`: every call adds.
            unique_name: Whether no other of its kind may have its name, then or later.
            lease: Lease of the resource, if it is held from the beginning; `None`: any job worker may take it.

        Raises:
            IdempotentParameterMismatchException: The token was used for another request.
            ResourceAlreadyExistsException: The name is taken, or the ARN.
        """
        try:
            return self._create(resource, token, unique_name, lease)
        except IntegrityError:
            # Somebody else has just added the same; this time it is found before.
            return self._create(resource, token, unique_name, lease)

    def _create(
        self, resource: NewResource, token: ClientToken | None, unique_name: bool, lease: FirstLease | None
    ) -> Resource:
        with self._transaction(self._writer) as connection:
            account = ResourceArn.parse(resource.arn).account
            if token is not None and (earlier := find_resource(connection, token, account)) is not None:
                return earlier
            check_free(connection, resource, unique_name)
            created = self._insert(connection, resource, unique_name, lease)
            if token is not None:
                store_token(connection, token, account, resource.arn)
            return created

    def _insert(
        self,
        connection: Connection,
        resource: NewResource,
        unique_name: bool = False,
        lease: FirstLease | None = None,
    ) -> Resource:
        now = self._now()
        row: dict[str, Any] = {
            "arn": resource.arn,
            "kind": resource.kind,
            "id": resource.id,
            "name": resource.name,
            "status": resource.status,
            "parent": resource.parent,
            "created_at": now,
            "updated_at": now,
            "revision": 1,
            "tags": dict(resource.tags),
            "labels": {key: list(values) for key, values in resource.labels.items()},
            "document": dict(resource.document),
        }
        others: dict[str, Any] = {"unique_name": resource.name if unique_name else None}
        if lease is not None:
            others |= {
                "lease_owner": lease.owner,
                "lease_expires_at": now + timedelta(seconds=lease.lease_s),
                "last_owner": lease.owner,
                "owner_since": now,
                "needed_environment": dict(lease.needed_environment),
            }
        sequence = connection.execute(_ADDED, {**row, **others}).scalar_one()
        insert_labels(connection, sequence, resource.labels)
        insert_tags(connection, resource.kind, sequence, resource.tags)
        return Resource(**row)

    def create_numbered(self, parent: str, make: Callable[[Resource, int], NewResource], *, most: int) -> Resource:
        """Adds and returns a child resource (such as a version) with its parent's next number, which no other gets.

        Args:
            parent: ARN of the resource they belong to; its document counts them in `lastNumber`.
            make: Makes the child from the parent and the number; its errors are passed on.
            most: Limit of children of that kind.

        Raises:
            ResourceNotFoundException: The catalog has no such parent.
            LimitExceededException: The parent has `most` children already.
        """
        for _ in range(_MAX_ATTEMPTS):
            with self._transaction(self._writer) as connection:
                row = one_row(connection, parent)
                number = int(row["document"].get("lastNumber", 0)) + 1
                child = make(resource_of(row), number)
                # Two who count at once are told apart by the parent's revision; the second counts again.
                unchanged = and_(resources.c.arn == parent, resources.c.revision == row["revision"])
                counted = {"document": {**row["document"], "lastNumber": number}, "revision": row["revision"] + 1}
                if not changed_one(connection.execute(update(resources).where(unchanged).values(counted))):
                    continue
                siblings = and_(resources.c.parent == parent, resources.c.kind == child.kind)
                if (existing := connection.scalar(select(func.count()).where(siblings)) or 0) >= most:
                    raise LimitExceededException(
                        f"{parent} has {existing} of at most {most} of kind {child.kind}; delete some first"
                    )
                check_free(connection, child, unique_name=False)
                return self._insert(connection, child)
        raise _changed_by_others(parent)

    def delete(self, arn: str, *, children: Sequence[str] = ()) -> None:
        """Deletes a resource from the catalog, with the client tokens that created it.

        Args:
            arn: ARN of the resource.
            children: Kinds of children that go with it.

        Raises:
            ResourceNotFoundException: The catalog has no such resource.
        """
        with self._transaction(self._writer) as connection:
            if not changed_one(connection.execute(delete(resources).where(resources.c.arn == arn))):
                raise not_found(arn)
            if children:
                theirs = and_(resources.c.parent == arn, resources.c.kind.in_(children))
                connection.execute(delete(resources).where(theirs))

    # Changing

    def update(
        self,
        arn: str,
        changes: Changes | Callable[[Stored], Change],
        *,
        owner: str | None = None,
        name: str | None = None,
        labels: Mapping[str, Sequence[str]] | None = None,
        status: str | None = None,
    ) -> Resource:
        """Changes members of a resource's document in the catalog, and returns the changed resource.

        Args:
            arn: ARN of the resource.
            changes: The members that are set; or a function that, given the document, returns these or
                the whole new document. It has to be quick, and is called again when another process
                changed the resource meanwhile; what it raises is raised, and nothing is changed.
            owner: Owner that has to hold the lease; `None`: the lease is not checked.
            name: New name, for kinds whose names may repeat; `None`: unchanged.
            labels: New labels; `None`: unchanged.
            status: New status, for kinds without a lifecycle; `None`: unchanged.

        Raises:
            ResourceNotFoundException: The catalog has no such resource.
            StateConflictError: `owner` does not hold the lease.
        """
        given = {"name": name, "labels": labels, "status": status}
        others = {column: value for column, value in given.items() if value is not None}

        def compute(row: RowMapping) -> dict[str, Any]:
            if status is not None and row["kind"] in LIFECYCLES:
                raise StateConflictError(f"{arn} is a {row['kind']}; its status changes by events only")
            document = upgraded(row["kind"], row["document"], arn)
            return {
                **others,
                "document": _changed(document, changes if isinstance(changes, Changes) else changes(document)),
            }

        return self._change(arn, owner, compute)

    def update_many(self, changes: Mapping[str, Changes]) -> None:
        """Changes the documents of many resources in one transaction.

        Args:
            changes: The members that are set, by ARN; resources that do not exist are left out.
        """
        if not changes:
            return
        now, arns = self._now(), sorted(changes)
        with self._transaction(self._writer) as connection:
            for start in range(0, len(arns), _CHUNK):
                # In the same order for all callers, so that none waits for another that waits for it.
                some = resources.c.arn.in_(arns[start : start + _CHUNK])
                query = select(*COLUMNS).where(some).order_by(resources.c.sequence).with_for_update()
                rows = connection.execute(query).mappings().all()
                values = [
                    {
                        "meant": row["arn"],
                        "changed": _changed(upgraded(row["kind"], row["document"], row["arn"]), change),
                    }
                    for row in rows
                    if (change := changes[row["arn"]])
                ]
                if values:
                    connection.execute(_CHANGED_DOCUMENT.values(updated_at=now), values)

    def set_tags(self, arn: str, tags: Mapping[str, str]) -> Resource:
        """Adds tags to a resource, or replaces their values, and returns it; this does not count as an update of it.

        Raises:
            ResourceNotFoundException: The catalog has no such resource.
            InvalidParameterException: The resource would have more than 50 tags.
        """

        def merged(row: RowMapping) -> dict[str, Any]:
            return {"tags": merged_tags(arn, row["tags"], tags), "updated_at": row["updated_at"]}

        return self._change(arn, None, merged)

    def remove_tags(self, arn: str, keys: Iterable[str]) -> Resource:
        """Removes tags from a resource, by key, and returns it; keys that it does not have are ignored.

        Raises:
            ResourceNotFoundException: The catalog has no such resource.
        """
        gone = set(keys)

        def remaining(row: RowMapping) -> dict[str, Any]:
            tags = {key: value for key, value in row["tags"].items() if key not in gone}
            return {"tags": tags, "updated_at": row["updated_at"]}

        return self._change(arn, None, remaining)

    def transition(
        self,
        arn: str,
        event: str,
        *,
        document_changes: Change | None = None,
        owner: str | None = None,
        labels: Mapping[str, Sequence[str]] | None = None,
    ) -> Resource:
        """Changes a resource's status by an event of its state machine, and returns the resource.

        Of several concurrent callers one succeeds.

        Args:
            arn: ARN of the resource.
            event: Event of the kind's lifecycle.
            document_changes: Members of the document that are set with it.
            owner: Owner that has to hold the lease; `None`: the lease is not checked.
            labels: Labels that are set with it; others stay; `None`: all stay as they are.

        Raises:
            ResourceNotFoundException: The catalog has no such resource.
            StateConflictError: The event cannot happen in its state, or as it is to be cancelled; its kind has no
                lifecycle, or `owner` does not hold the lease.
        """

        def compute(row: RowMapping) -> dict[str, Any]:
            if row["kind"] not in LIFECYCLES:
                raise StateConflictError(f"{arn} is a {row['kind']}, which has no lifecycle; {event!r} cannot happen")
            machine = LIFECYCLES[row["kind"]]
            if row["cancel_requested"] and event in machine.not_when_canceled:
                raise StateConflictError(f"{arn} is to be cancelled; {event!r} cannot happen any more")
            try:
                status = next_state(machine, row["status"], event)
            except StateConflictError as error:
                raise StateConflictError(f"{arn}: {error}") from error
            changes = document_changes.to_json() if isinstance(document_changes, Changes) else document_changes or {}
            values: dict[str, Any] = {
                "status": status,
                "document": {**upgraded(row["kind"], row["document"], arn), **changes},
            }
            if labels is not None:
                values["labels"] = {**row["labels"], **{key: list(each) for key, each in labels.items()}}
            return values

        return self._change(arn, owner, compute)

    def _change(self, arn: str, owner: str | None, compute: Callable[[RowMapping], dict[str, Any]]) -> Resource:
        """Changes a resource's row by compare-and-set with the values that `compute` returns, and returns the resource.

        The change is repeated if another process changed the row meanwhile. Raises `StateConflictError` if `owner` does
        not hold the lease, `ResourceNotFoundException` if there is no such resource, and an error after too many
        attempts.
        """
        for _ in range(_MAX_ATTEMPTS):
            with self._transaction(self._writer) as connection:
                row = one_row(connection, arn)
                if owner is not None and row["lease_owner"] != owner:
                    raise StateConflictError(f"{arn}: {owner!r} does not hold the lease; {row['lease_owner']!r} does")
                values: dict[str, Any] = {"updated_at": self._now(), **compute(row), "revision": row["revision"] + 1}
                still: dict[str, Any] = {"of": arn, "seen": row["revision"]}
                if owner is not None:  # who may have lost the lease since the row was read
                    still["held_by"] = owner
                changing = _UNCHANGED if owner is None else _UNCHANGED_AND_HELD
                if changed_one(connection.execute(changing, {**still, **values})):
                    if "labels" in values:
                        replace_labels(connection, arn, values["labels"])
                    if "tags" in values:
                        replace_tags(connection, arn, values["tags"])
                    return resource_of(row, **values)
        raise _changed_by_others(arn)

    # Cancelling

    def request_cancel(self, arn: str) -> Resource:
        """Marks a resource to be cancelled, for its job worker to see, and returns it; an ended one is not changed.

        Raises:
            ResourceNotFoundException: The catalog has no such resource.
        """
        with self._transaction(self._writer) as connection:
            row = one_row(connection, arn)
            if not is_terminal(row["kind"], row["status"]):
                # The new revision makes who changes it at the same time look again.
                noted = {"cancel_requested": True, "revision": resources.c.revision + 1}
                connection.execute(update(resources).where(resources.c.arn == arn).values(**noted))
            return resource_of(row)

    def cancel_requested(self, arn: str) -> bool:
        """Whether a resource is marked to be cancelled; fast enough to be polled.

        Raises:
            ResourceNotFoundException: The catalog has no such resource.
        """
        return self.standing(arn)[1]


def _changed(document: Stored, change: Change) -> Stored:
    """Returns a stored document after a change: `Changes` set some members, a whole document replaces it."""
    if isinstance(change, Document):
        return change.to_json()
    return {**document, **change.to_json()} if isinstance(change, Changes) else dict(change)


def _changed_by_others(arn: str) -> StateConflictError:
    return StateConflictError(f"{arn} was changed by others {_MAX_ATTEMPTS} times in a row; try again later")
