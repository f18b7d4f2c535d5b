"""The catalog: every resource, whoever asks, from any thread and any process."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import ColumnElement, Connection, Engine, RowMapping, and_, delete, func, insert, or_, select, update
from sqlalchemy.exc import DBAPIError, IntegrityError

from ...schemas.arns import ResourceArn
from ...schemas.errors import ServiceUnavailableException, StateConflictError
from ...schemas.lifecycles import LIFECYCLES, is_terminal, next_state
from .engine import open_engine, writing
from .pages import decode_page_token, encode_page_token
from .queries import COLUMNS, changed_one, check_free, list_conditions, not_found, one_row, repeated, resource_of
from .records import ClientToken, NewResource, Page, Resource
from .tables import client_tokens, resources

_MAX_ATTEMPTS = 100

Document = dict[str, Any]


class Catalog:
    """Resources in a database; open with `Catalog.open`.

    Every method is one transaction, and raises `ServiceUnavailableException` when the database does
    not do its part: locked for half a minute, full, gone.

    Methods that change a resource raise `StateConflictError` when an `owner` is given that does not
    hold the resource's lease: a performer that lost its lease to another cannot change anything any
    more.
    """

    def __init__(self, url: str, clock: Callable[[], datetime]) -> None:
        self._engine = open_engine(url)
        self._writer = writing(self._engine)
        self._clock = clock

    @classmethod
    def open(cls, url: str, *, clock: Callable[[], datetime]) -> "Catalog":
        """Opens a catalog, creating or updating its tables if need be.

        Args:
          url: SQLAlchemy URL: `sqlite:////folder/catalog.db`, or one of a PostgreSQL database.
          clock: gives the time, with a time zone.

        Raises:
          ConfigurationError: the URL leads nowhere, or a newer program made the catalog.
        """
        return cls(url, clock)

    def close(self) -> None:
        """Closes all connections; the catalog reopens them when it is used again."""
        self._engine.dispose()

    # Creating and deleting

    def create(self, resource: NewResource, *, token: ClientToken | None, unique_name: bool = False) -> Resource:
        """Adds a resource, or returns the one an equal call with the same token added before.

        The answer's ARN tells which: it differs from `resource.arn` if the call is a repetition.

        Args:
          resource: what to add.
          token: the caller's token; `None`: every call adds.
          unique_name: whether no other of its kind may have its name, then or later.

        Raises:
          IdempotentParameterMismatchException: the token was used for another request.
          ResourceAlreadyExistsException: the name is taken, or the ARN.
        """
        try:
            return self._create(resource, token, unique_name)
        except IntegrityError:
            # Somebody else has just added the same; this time it is found before.
            return self._create(resource, token, unique_name)

    def _create(self, resource: NewResource, token: ClientToken | None, unique_name: bool) -> Resource:
        with self._transaction(self._writer) as connection:
            account = ResourceArn.parse(resource.arn).account
            if token is not None and (earlier := repeated(connection, token, account)) is not None:
                return earlier
            check_free(connection, resource, unique_name)
            now = self._now()
            row = {
                "arn": resource.arn,
                "kind": resource.kind,
                "id": resource.id,
                "name": resource.name,
                "unique_name": resource.name if unique_name else None,
                "status": resource.status,
                "parent": resource.parent,
                "created_at": now,
                "updated_at": now,
                "revision": 1,
                "tags": dict(resource.tags),
                "document": dict(resource.document),
            }
            connection.execute(insert(resources).values(row))
            if token is not None:
                connection.execute(
                    insert(client_tokens).values(
                        operation=token.operation,
                        account=account,
                        token=token.token,
                        request_hash=token.request_hash,
                        arn=resource.arn,
                    )
                )
            del row["unique_name"]
            return Resource(**row)

    def delete(self, arn: str) -> None:
        """Removes a resource and forgets the tokens that made it.

        Raises:
          ResourceNotFoundException: there is none.
        """
        with self._transaction(self._writer) as connection:
            if not changed_one(connection.execute(delete(resources).where(resources.c.arn == arn))):
                raise not_found(arn)

    # Reading

    def get(self, arn: str, kind: str | None = None) -> Resource:
        """Reads a resource.

        Args:
          arn: its ARN.
          kind: what it has to be; `None`: anything.

        Raises:
          ResourceNotFoundException: there is none of that ARN and kind.
        """
        with self._transaction(self._engine) as connection:
            return resource_of(one_row(connection, arn, kind))

    def get_many(self, arns: Iterable[str]) -> dict[str, Resource]:
        """Reads several resources; those that do not exist are absent from the answer."""
        wanted = list(arns)
        found: dict[str, Resource] = {}
        with self._transaction(self._engine) as connection:
            for start in range(0, len(wanted), 500):  # databases limit the number of values in a statement
                chunk = wanted[start : start + 500]
                for row in connection.execute(select(*COLUMNS).where(resources.c.arn.in_(chunk))).mappings():
                    found[row["arn"]] = resource_of(row)
        return found

    def made_before(self, token: ClientToken | None, account: str) -> Resource | None:
        """The resource that an earlier call with this token added; asked before anything else is checked.

        Args:
          token: the caller's token; `None`: there was no such call.
          account: whose token it is.

        Raises:
          IdempotentParameterMismatchException: that call was another request.
        """
        if token is None:
            return None
        with self._transaction(self._engine) as connection:
            return repeated(connection, token, account)

    def find(self, kind: str, name: str) -> Resource | None:
        """The newest resource of a kind and name."""
        query = select(*COLUMNS).where(resources.c.kind == kind, resources.c.name == name)
        with self._transaction(self._engine) as connection:
            row = connection.execute(query.order_by(resources.c.sequence.desc()).limit(1)).mappings().one_or_none()
        return None if row is None else resource_of(row)

    def children(self, parent: str, kind: str) -> tuple[Resource, ...]:
        """The resources of a kind that came from a parent, oldest first."""
        query = select(*COLUMNS).where(resources.c.parent == parent, resources.c.kind == kind)
        with self._transaction(self._engine) as connection:
            return tuple(
                resource_of(row) for row in connection.execute(query.order_by(resources.c.sequence)).mappings()
            )

    def count_children(self, parent: str, kind: str) -> dict[str, int]:
        """How many resources of a kind that came from a parent are in each status."""
        query = select(resources.c.status, func.count()).where(resources.c.parent == parent, resources.c.kind == kind)
        with self._transaction(self._engine) as connection:
            return {row[0]: row[1] for row in connection.execute(query.group_by(resources.c.status))}

    def list(
        self,
        kind: str,
        *,
        filters: Mapping[str, Sequence[str]] | None = None,
        limit: int = 100,
        after: str | None = None,
    ) -> Page:
        """Reads a page of resources, newest first; resources added meanwhile do not shift later pages.

        Args:
          kind: what is listed.
          filters: for `name`, `parent` or `status` the values that are wanted.
          limit: how many at most.
          after: the page before's `next_token`; `None`: the first page.

        Raises:
          InvalidParameterException: a filter is not known, or the token is not of this list.
        """
        wanted = filters or {}
        query = select(resources.c.sequence, *COLUMNS).where(*list_conditions(kind, wanted))
        if after is not None:
            query = query.where(resources.c.sequence < decode_page_token(kind, wanted, after))
        with self._transaction(self._engine) as connection:
            rows = connection.execute(query.order_by(resources.c.sequence.desc()).limit(limit + 1)).mappings().all()
        more = len(rows) > limit
        token = encode_page_token(kind, wanted, rows[limit - 1]["sequence"]) if more else None
        return Page(tuple(resource_of(row) for row in rows[:limit]), token)

    # Changing

    def update(self, arn: str, changes: Callable[[Document], Document], *, owner: str | None = None) -> Resource:
        """Changes a resource's document.

        Args:
          arn: its ARN.
          changes: given the document, returns the new one; has to be quick, and is called again
            when somebody else changed the resource meanwhile.
          owner: who has to hold the lease; `None`: it does not matter.

        Raises:
          ResourceNotFoundException: there is no such resource.
          StateConflictError: `owner` does not hold the lease.
        """
        return self._change(arn, owner, lambda row: {"document": changes(dict(row["document"]))})

    def transition(
        self,
        arn: str,
        event: str,
        *,
        document_changes: Mapping[str, Any] | None = None,
        owner: str | None = None,
    ) -> Resource:
        """Moves a resource to the state that follows an event; of several callers one succeeds.

        Args:
          arn: its ARN.
          event: what happened, an event of the kind's lifecycle.
          document_changes: members of the document that are set with it.
          owner: who has to hold the lease; `None`: it does not matter.

        Raises:
          ResourceNotFoundException: there is no such resource.
          StateConflictError: the event cannot happen in its state, its kind has no lifecycle, or
            `owner` does not hold the lease.
        """

        def compute(row: RowMapping) -> dict[str, Any]:
            if row["kind"] not in LIFECYCLES:
                raise StateConflictError(f"{arn} is a {row['kind']}, which has no lifecycle; {event!r} cannot happen")
            try:
                status = next_state(LIFECYCLES[row["kind"]], row["status"], event)
            except StateConflictError as error:
                raise StateConflictError(f"{arn}: {error}") from error
            return {"status": status, "document": {**row["document"], **(document_changes or {})}}

        return self._change(arn, owner, compute)

    def _change(self, arn: str, owner: str | None, compute: Callable[[RowMapping], dict[str, Any]]) -> Resource:
        """Compare and set: writes what `compute` makes of the row unless the row changed meanwhile."""
        for _ in range(_MAX_ATTEMPTS):
            with self._transaction(self._writer) as connection:
                row = one_row(connection, arn)
                if owner is not None and row["lease_owner"] != owner:
                    raise StateConflictError(f"{arn}: {owner!r} does not hold the lease; {row['lease_owner']!r} does")
                values = {**compute(row), "revision": row["revision"] + 1, "updated_at": self._now()}
                unchanged = and_(resources.c.arn == arn, resources.c.revision == row["revision"])
                if changed_one(connection.execute(update(resources).where(unchanged).values(values))):
                    return resource_of(row, **values)
        raise StateConflictError(f"{arn} was changed by others {_MAX_ATTEMPTS} times in a row; try again later")

    # Cancelling

    def request_cancel(self, arn: str) -> Resource:
        """Notes that a resource is to be cancelled; its performer sees it. Of no effect on one that has ended.

        Raises:
          ResourceNotFoundException: there is no such resource.
        """
        with self._transaction(self._writer) as connection:
            row = one_row(connection, arn)
            if not is_terminal(row["kind"], row["status"]):
                connection.execute(update(resources).where(resources.c.arn == arn).values(cancel_requested=True))
            return resource_of(row)

    def cancel_requested(self, arn: str) -> bool:
        """Whether a resource is to be cancelled; quick enough to be asked all the time.

        Raises:
          ResourceNotFoundException: there is no such resource.
        """
        with self._transaction(self._engine) as connection:
            asked = connection.scalar(select(resources.c.cancel_requested).where(resources.c.arn == arn))
        if asked is None:
            raise not_found(arn)
        return bool(asked)

    # Leases: who performs a resource

    def claim(self, arn: str, owner: str, lease_s: float) -> bool:
        """Takes a resource's lease if nobody else holds it.

        Args:
          arn: the resource.
          owner: who asks; unlike anybody else, in this process or another.
          lease_s: after how many seconds another may take it, unless it is renewed.

        Returns:
          Whether `owner` holds the lease now.

        Raises:
          ResourceNotFoundException: there is no such resource.
        """
        now = self._now()
        free = or_(
            resources.c.lease_owner.is_(None), resources.c.lease_owner == owner, resources.c.lease_expires_at <= now
        )
        return self._lease(arn, free, {"lease_owner": owner, "lease_expires_at": now + timedelta(seconds=lease_s)})

    def renew(self, arn: str, owner: str, lease_s: float) -> bool:
        """Prolongs a lease, even one that ran out, as long as nobody else has taken it.

        Returns:
          Whether `owner` still holds the lease.
        """
        until = self._now() + timedelta(seconds=lease_s)
        return self._lease(arn, resources.c.lease_owner == owner, {"lease_expires_at": until})

    def release(self, arn: str, owner: str) -> bool:
        """Gives a lease back.

        Returns:
          Whether `owner` held it.
        """
        return self._lease(arn, resources.c.lease_owner == owner, {"lease_owner": None, "lease_expires_at": None})

    def _lease(self, arn: str, condition: ColumnElement[bool], values: Mapping[str, Any]) -> bool:
        with self._transaction(self._writer) as connection:
            taken = connection.execute(update(resources).where(resources.c.arn == arn, condition).values(values))
            if changed_one(taken):
                return True
            one_row(connection, arn)
            return False

    @contextmanager
    def _transaction(self, engine: Engine) -> Iterator[Connection]:
        try:
            with engine.begin() as connection:
                yield connection
        except IntegrityError:
            raise
        except DBAPIError as error:
            raise ServiceUnavailableException(f"the catalog {engine.url!r} does not answer: {error.orig}") from error

    def _now(self) -> datetime:
        return self._clock().astimezone(UTC)
