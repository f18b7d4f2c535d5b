"""Read access to the catalog: one resource, several, children of a parent, pages of lists, unfinished jobs."""

from collections.abc import Callable, Collection, Generator, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from datetime import UTC, datetime
from types import MappingProxyType

from sqlalchemy import Connection, Engine, bindparam, func, literal_column, select
from sqlalchemy.exc import DBAPIError, IntegrityError

from ...schemas.wire.errors import ServiceUnavailableException
from .client_tokens import ClientToken, find_resource
from .database import open_engine, reading_once, writing
from .queries import (
    COLUMNS,
    alive,
    decode_page_token,
    encode_page_token,
    has_member,
    list_query,
    newest_query,
    not_found,
    one_row,
    only_members,
    resource_of,
    resource_with,
)
from .records import Page, Resource
from .tables import resources

# Made once: they are asked several times for each job, some several times a second, and making a statement costs too.
_STANDING = select(resources.c.status, resources.c.cancel_requested).where(resources.c.arn == bindparam("of"))
_NEWEST = (
    select(*COLUMNS)
    .where(resources.c.kind == bindparam("of"), resources.c.name == bindparam("called"))
    .order_by(resources.c.sequence.desc())
    .limit(1)
)
# Grouped by no column, or SQLite walks the index by status, through all resources of the kind, to have them in groups.
_STATUS = resources.c.status.concat(literal_column("''"))
_STATUSES = (
    select(_STATUS, func.count())
    .where(resources.c.parent == bindparam("of"), resources.c.kind == bindparam("each"))
    .group_by(_STATUS)
)
_REVISIONS = (
    select(resources.c.arn, resources.c.revision)
    .where(resources.c.parent == bindparam("of"), resources.c.kind == bindparam("each"))
    .order_by(resources.c.sequence)
)


class CatalogReader:
    """Read access to the catalog, the database of all resources; its subclass `Catalog` adds the changes."""

    def __init__(self, url: str, clock: Callable[[], datetime]) -> None:
        self._engine = open_engine(url)
        self._writer, self._once = writing(self._engine), reading_once(self._engine)
        self._clock = clock

    def reading(self) -> AbstractContextManager[Connection]:
        """Returns a read transaction on the catalog's database, to be entered, for optional tables such as fleets."""
        return self._transaction(self._engine)

    def writing(self) -> AbstractContextManager[Connection]:
        """Returns a write transaction on the catalog's database, to be entered, for optional tables such as fleets."""
        return self._transaction(self._writer)

    def close(self) -> None:
        """Closes all database connections; the catalog reopens them when used again."""
        self._engine.dispose()

    def get(self, arn: str, kind: str | None = None) -> Resource:
        """Returns the resource with an ARN.

        Args:
            arn: ARN of the resource.
            kind: Expected kind of the resource; `None`: any.

        Raises:
            ResourceNotFoundException: The catalog has no resource of this ARN and kind.
        """
        with self._transaction(self._once) as connection:
            return resource_of(one_row(connection, arn, kind))

    def get_many(self, arns: Iterable[str], members: Sequence[str] | None = None) -> dict[str, Resource]:
        """Returns several resources by their ARNs; those that do not exist are left out.

        Args:
            arns: ARNs of the resources.
            members: Members of the documents to read; `None`: all.
        """
        wanted = list(arns)
        found: dict[str, Resource] = {}
        with self._transaction(self._engine) as connection:
            for start in range(0, len(wanted), 500):  # databases limit the number of values in a statement
                chunk = wanted[start : start + 500]
                query = select(resources.c.sequence, *COLUMNS).where(resources.c.arn.in_(chunk))
                query = query if members is None else only_members(query, members)
                for row in connection.execute(query).mappings():
                    found[row["arn"]] = resource_of(row) if members is None else resource_with(row, members)
        return found

    def find_by_client_token(self, token: ClientToken | None, account: str) -> Resource | None:
        """Returns the resource that an earlier call with the same client token created; `None` if there is none.

        Handlers ask this before they check anything else: a repeated call succeeds whatever has changed since.

        Args:
            token: The caller's token; `None`: the call has none, so it repeats no other.
            account: Account that the token belongs to.

        Raises:
            IdempotentParameterMismatchException: The earlier call with this client token had another request.
        """
        if token is None:
            return None
        with self._transaction(self._engine) as connection:
            return find_resource(connection, token, account)

    def find(self, kind: str, name: str) -> Resource | None:
        """Returns the newest resource of a kind with that name; `None` if there is none."""
        with self._transaction(self._once) as connection:
            row = connection.execute(_NEWEST, {"of": kind, "called": name}).mappings().one_or_none()
        return None if row is None else resource_of(row)

    def with_ids(self, kind: str, beginning: str, ending: str = "", *, limit: int) -> tuple[Resource, ...]:
        """Lists the resources of a kind whose ids begin and end so, newest first.

        Args:
            kind: Their kind.
            beginning: Beginning of their ids.
            ending: End of their ids; empty: any.
            limit: How many at most.
        """
        wanted = resources.c.kind == kind, resources.c.id.startswith(beginning, autoescape=True)
        query = select(*COLUMNS).where(*wanted).order_by(resources.c.sequence.desc()).limit(limit)
        if ending:
            query = query.where(resources.c.id.endswith(ending, autoescape=True))
        with self._transaction(self._engine) as connection:
            return tuple(resource_of(row) for row in connection.execute(query).mappings())

    def children(self, parent: str, kind: str) -> tuple[Resource, ...]:
        """Lists the children of one kind of a resource (such as the jobs of a batch), oldest first."""
        query = select(*COLUMNS).where(resources.c.parent == parent, resources.c.kind == kind)
        with self._transaction(self._engine) as connection:
            return tuple(
                resource_of(row) for row in connection.execute(query.order_by(resources.c.sequence)).mappings()
            )

    def child_revisions(self, parent: str, kind: str) -> dict[str, int]:
        """Returns the revision numbers of a resource's children, by ARN; each change of a child raises its number."""
        with self._transaction(self._once) as connection:
            return {row[0]: row[1] for row in connection.execute(_REVISIONS, {"of": parent, "each": kind})}

    def standing(self, arn: str) -> tuple[str, bool]:
        """Returns a resource's status, and whether its cancellation was requested; fast enough to be polled.

        Raises:
            ResourceNotFoundException: The catalog has no such resource.
        """
        with self._transaction(self._once) as connection:
            row = connection.execute(_STANDING, {"of": arn}).one_or_none()
        if row is None:
            raise not_found(arn)
        return row[0], bool(row[1])

    def count_each(self, parents: Iterable[str], kind: str) -> dict[str, int]:
        """Counts the children of several parents, by parent; parents without any are left out."""
        query = select(resources.c.parent, func.count()).where(
            resources.c.parent.in_(list(parents)), resources.c.kind == kind
        )
        with self._transaction(self._engine) as connection:
            return {row[0]: row[1] for row in connection.execute(query.group_by(resources.c.parent))}

    def count_children(self, parent: str, kind: str) -> dict[str, int]:
        """Counts the children of one kind of a resource by their status; statuses without any are left out."""
        with self._transaction(self._once) as connection:
            return {row[0]: row[1] for row in connection.execute(_STATUSES, {"of": parent, "each": kind})}

    def count_alive(self, parent: str, kind: str, *, having: str) -> dict[str, int]:
        """Counts the unfinished children of a parent whose document has a given member, by status."""
        of_kind = (resources.c.parent == parent, resources.c.kind == kind, resources.c.status.in_(alive(kind)))
        query = select(_STATUS, func.count()).where(*of_kind, has_member(having)).group_by(_STATUS)
        with self._transaction(self._once) as connection:
            return {row[0]: row[1] for row in connection.execute(query)}

    def list(
        self,
        kinds: str | Sequence[str],
        *,
        filters: Mapping[str, Sequence[str]] | None = None,
        limit: int = 100,
        after: str | None = None,
        scope: str = "",
        members: Sequence[str] | None = None,
        without: Mapping[str, Collection[str]] = MappingProxyType({}),
    ) -> Page:
        """Returns a page of a list of resources, newest first; resources added meanwhile do not shift later pages.

        Args:
            kinds: Kinds of the listed resources.
            filters: For `name`, `parent`, `status`, `tag` (written `key=value`) or a label the values that are
                wanted, one of which has to be equal.
            limit: Largest number of resources.
            after: The page before's `next_token`; `None`: the first page.
            scope: Operation for which the list is made; page tokens of other operations are refused.
            members: Members of the documents to read, for kinds whose documents are large;
                `None`: all.
            without: Names that are left out, by kind.

        Raises:
            InvalidParameterException: The token is not of this list.
        """
        wanted = filters or {}
        each_kind = (kinds,) if isinstance(kinds, str) else tuple(kinds)
        listed = " ".join((scope, *each_kind))
        before = None if after is None else decode_page_token(listed, wanted, after)
        query = list_query(each_kind, wanted, before, limit + 1, without)
        with self._transaction(self._engine) as connection:
            rows = connection.execute(query if members is None else only_members(query, members)).mappings().all()
        more = len(rows) > limit
        token = encode_page_token(listed, wanted, rows[limit - 1]["sequence"]) if more else None
        found = (resource_of(row) if members is None else resource_with(row, members) for row in rows[:limit])
        return Page(tuple(found), token)

    def newest(
        self, wanted: Mapping[str, Sequence[str]], *, not_below: str, limit: int, members: Sequence[str]
    ) -> tuple[Resource, ...]:
        """Lists the newest resources of each kind that are in given statuses, newest first.

        Args:
            wanted: The statuses, by kind.
            not_below: Resources whose parent is of this kind are left out.
            limit: Largest number of resources of each kind.
            members: Members of the documents to read.
        """
        query = only_members(newest_query(wanted, not_below, limit), members)
        with self._transaction(self._once) as connection:
            return tuple(resource_with(row, members) for row in connection.execute(query).mappings())

    def count(self) -> dict[str, dict[str, int]]:
        """Counts all resources in the catalog, by kind and then by status; absent ones are left out."""
        query = select(resources.c.kind, resources.c.status, func.count()).group_by(
            resources.c.kind, resources.c.status
        )
        counts: dict[str, dict[str, int]] = {}
        with self._transaction(self._engine) as connection:
            for kind, status, number in connection.execute(query):
                counts.setdefault(kind, {})[status] = number
        return counts

    @property
    def address(self) -> str:
        """Database URL of the catalog, without a password."""
        return self._engine.url.render_as_string(hide_password=True)

    def children_standing(self, parent: str, kind: str) -> dict[str, str]:
        """Returns the statuses of a resource's children of one kind, by their ARN."""
        query = select(resources.c.arn, resources.c.status).where(
            resources.c.parent == parent, resources.c.kind == kind
        )
        with self._transaction(self._engine) as connection:
            return {row[0]: row[1] for row in connection.execute(query)}

    @contextmanager
    def _transaction(self, engine: Engine) -> Generator[Connection]:
        try:
            with engine.begin() as connection:
                yield connection
        except IntegrityError:
            raise
        except DBAPIError as error:
            raise ServiceUnavailableException(f"the catalog {engine.url!r} does not answer: {error.orig}") from error

    def _now(self) -> datetime:
        return self._clock().astimezone(UTC)
