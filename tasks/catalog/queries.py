"""Parts of SQL queries of the catalog: pages and their tokens, tags, a few members of large documents."""

import base64
import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, cast

from sqlalchemy import (
    JSON,
    ColumnElement,
    Connection,
    CursorResult,
    FromClause,
    Label,
    RowMapping,
    Select,
    and_,
    bindparam,
    delete,
    func,
    insert,
    literal,
    not_,
    null,
    or_,
    select,
)
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement

from ...schemas.lifecycles import LIFECYCLES
from ...schemas.wire.errors import InvalidParameterException, ResourceAlreadyExistsException, ResourceNotFoundException
from .records import NewResource, Resource
from .tables import resource_labels, resource_tags, resources

Filters = Mapping[str, Sequence[str]]


def encode_page_token(kind: str, filters: Filters, sequence: int) -> str:
    """Makes the pagination token for the page of a list that follows an entry.

    Args:
        kind: Kind of the listed resources.
        filters: Conditions of the list.
        sequence: The entry's place in the order of creation.
    """
    return base64.urlsafe_b64encode(f"{sequence}.{_fingerprint(kind, filters)}".encode()).decode()


def decode_page_token(kind: str, filters: Filters, token: str) -> int:
    """Decodes a pagination token, and checks that it belongs to the same list.

    Returns:
        The place of the entry that the page follows.

    Raises:
        InvalidParameterException: The text is not a pagination token, or is that of another list.
    """
    try:
        sequence = int(base64.urlsafe_b64decode(token).decode("ascii").partition(".")[0])
    except ValueError as error:
        raise InvalidParameterException(f"nextToken is {token!r}; it has to come from the page before") from error
    if token != encode_page_token(kind, filters, sequence):
        raise InvalidParameterException(
            "nextToken came from another list or other filters; repeat the call it came from, with the token added"
        )
    return sequence


def _fingerprint(kind: str, filters: Filters) -> str:
    canonical = json.dumps([kind, {name: sorted(values) for name, values in filters.items()}], sort_keys=True)
    return hashlib.sha256(canonical.encode()).hexdigest()[:16]


class _Picked(FunctionElement[Any]):
    """SQL function: JSON array of some members of an object, in order; `null` for missing members.

    One call for all of them is used, because with one for each, a list of 1,000 jobs takes three times as long.
    """

    type = JSON()
    inherit_cache = True


@compiles(_Picked, "sqlite")
def _on_sqlite(element: _Picked, compiler: SQLCompiler, **more: Any) -> str:
    document, *names = (compiler.process(clause, **more) for clause in element.clauses)
    # With a single path it would be no array; so the first one comes twice.
    paths = (f"""'$."' || {name} || '"'""" for name in (names[0], *names))
    return f"JSON_EXTRACT({document}, {', '.join(paths)})"


@compiles(_Picked, "postgresql")
def _on_postgresql(element: _Picked, compiler: SQLCompiler, **more: Any) -> str:
    document, *names = (compiler.process(clause, **more) for clause in element.clauses)
    picked = (f"{document} -> CAST({name} AS TEXT)" for name in (names[0], *names))
    return f"JSON_BUILD_ARRAY({', '.join(picked)})"


def picked(members: Sequence[str]) -> Label[Any]:
    """Returns a database column with only some members of a resource's document; an empty one if none is named."""
    column: ColumnElement[Any] = _Picked(resources.c.document, *map(literal, members)) if members else null()
    return column.label(resources.c.document.name)


def of_picked(values: Sequence[Any] | None, members: Sequence[str]) -> Mapping[str, Any]:
    """Returns the document members that `picked` has selected, by name; members without a value are left out."""
    found = zip(members, (values or [None])[1:], strict=True)
    return {member: value for member, value in found if value is not None}


COLUMNS = (
    resources.c.arn,
    resources.c.kind,
    resources.c.id,
    resources.c.name,
    resources.c.status,
    resources.c.parent,
    resources.c.created_at,
    resources.c.updated_at,
    resources.c.revision,
    resources.c.tags,
    resources.c.labels,
    resources.c.document,
)
"""Database columns from which a `Resource` is made."""

# Made once: making it takes as long as executing it, and it is the query of most calls.
_ONE_ROW = select(*COLUMNS, resources.c.lease_owner, resources.c.cancel_requested).where(
    resources.c.arn == bindparam("arn")
)

_SEQUENCE = select(resources.c.sequence).where(resources.c.arn == bindparam("of"))
_OLD_LABELS = delete(resource_labels).where(resource_labels.c.sequence == bindparam("of"))

TAG = "tag"
"""Name of the list filter for tags."""

_FILTERS = {"name": resources.c.name, "parent": resources.c.parent, "status": resources.c.status}


def resource_of(row: RowMapping, **changes: Any) -> Resource:
    """Returns the resource that a database row holds, with some values replaced."""
    values = {column.name: row[column.name] for column in COLUMNS} | changes
    return Resource(**values)


def not_found(arn: str) -> ResourceNotFoundException:
    """Returns, without raising it, the error for an ARN that is not in the catalog."""
    return ResourceNotFoundException(f"there is no resource {arn}")


def changed_one(result: Any) -> bool:
    """Whether a database statement changed exactly one row."""
    return cast("CursorResult[Any]", result).rowcount == 1


def one_row(connection: Connection, arn: str, kind: str | None = None) -> RowMapping:
    """Returns the database row of a resource, with its lease's owner.

    Raises:
        ResourceNotFoundException: The catalog has no resource of this ARN and kind.
    """
    row = connection.execute(_ONE_ROW, {"arn": arn}).mappings().one_or_none()
    if row is None:
        raise not_found(arn)
    if kind is not None and row["kind"] != kind:
        raise ResourceNotFoundException(f"{arn} is a {row['kind']}; give the ARN of a {kind}")
    return row


def list_query(
    kinds: Sequence[str],
    filters: Mapping[str, Sequence[str]],
    before: int | None,
    limit: int,
    without: Mapping[str, Collection[str]] = MappingProxyType({}),
) -> Select[Any]:
    """Makes the database query for a page of a list of resources, newest first.

    Args:
        kinds: Kinds of the listed resources.
        filters: For each name the values one of which is wanted; a name that is no column is a label, `tag` is a
            tag, written `key=value`.
        before: The place in the order of creation that the page lies before; `None`: the first page.
        limit: Largest number of rows.
        without: Names that are left out, by kind.
    """
    kind, order = resources.c.kind, resources.c.sequence
    query: Select[Any] = select(resources.c.sequence, *COLUMNS)
    query = query.where(kind == kinds[0] if len(kinds) == 1 else kind.in_(kinds))
    for of_kind, names in without.items():
        query = query.where(not_(and_(kind == of_kind, resources.c.name.in_(names))))
    for name, values in filters.items():
        if (column := _FILTERS.get(name)) is not None:
            query = query.where(column.in_(values))
        elif name == TAG and len(values) == len(kinds) == 1:
            # A join walks along the tag's index in the wanted order and stops when the page is full.
            tagged = resource_tags.alias()
            query = query.join(tagged, tagged.c.sequence == resources.c.sequence)
            query = query.where(tagged.c.kind == kinds[0], _has_tag(tagged, values[0]))
            order = tagged.c.sequence
        elif name == TAG:
            tags = resource_tags.c
            has_one = or_(*(_has_tag(resource_tags, value) for value in values))
            query = query.where(resources.c.sequence.in_(select(tags.sequence).where(tags.kind.in_(kinds), has_one)))
        elif len(values) == 1:
            # As for a tag.
            label = resource_labels.alias()
            query = query.join(label, label.c.sequence == resources.c.sequence)
            query = query.where(label.c.key == name, label.c.value == values[0])
            order = label.c.sequence
        else:
            labels = resource_labels.c
            query = query.where(
                resources.c.sequence.in_(select(labels.sequence).where(labels.key == name, labels.value.in_(values)))
            )
    if before is not None:
        query = query.where(order < before)
    return query.order_by(order.desc()).limit(limit)


def newest_query(wanted: Mapping[str, Sequence[str]], not_below: str, limit: int) -> Select[Any]:
    """Makes the database query for the newest resources of each kind that are in given statuses.

    Args:
        wanted: The statuses, by kind.
        not_below: Resources whose parent is of this kind are left out.
        limit: Largest number of resources of each kind.
    """
    is_below = func.coalesce(resources.c.parent, "").contains(f":{not_below}/", autoescape=True)
    standing = or_(*(and_(resources.c.kind == kind, resources.c.status.in_(each)) for kind, each in wanted.items()))
    place = func.row_number().over(partition_by=resources.c.kind, order_by=resources.c.sequence.desc())
    ranked = select(resources.c.sequence, place.label("place")).where(standing, ~is_below).subquery()
    newest = select(ranked.c.sequence).where(ranked.c.place <= limit)
    query: Select[Any] = select(resources.c.sequence, *COLUMNS)
    return query.where(resources.c.sequence.in_(newest)).order_by(resources.c.sequence.desc())


def _has_tag(tags: FromClause, written: str) -> ColumnElement[bool]:
    key, _, value = written.partition("=")
    return and_(tags.c.key == key, tags.c.value == value)


def alive(kind: str) -> list[str]:
    """Returns the statuses in which a job of a kind has not ended."""
    return sorted(set(LIFECYCLES[kind].states) - LIFECYCLES[kind].terminal)


def has_member(name: str) -> ColumnElement[bool]:
    """Makes the SQL condition that a resource's document has a text member of that name."""
    return resources.c.document[name].as_string().is_not(None)


def only_members(query: Select[Any], members: Sequence[str]) -> Select[Any]:
    """Returns a database query that reads only a few members of each document."""
    columns = (column for column in COLUMNS if column is not resources.c.document)
    return query.with_only_columns(resources.c.sequence, *columns, picked(members))


def resource_with(row: RowMapping, members: Sequence[str]) -> Resource:
    """Makes a resource from a row with only some members of its document."""
    return resource_of(row, document=of_picked(row["document"], members))


def insert_labels(connection: Connection, sequence: int, labels: Mapping[str, Sequence[str]]) -> None:
    """Adds labels (key-value pairs by which lists filter) to a resource's database row; existing ones stay."""
    rows = [
        {"sequence": sequence, "key": key, "value": value}
        for key, values in labels.items()
        for value in dict.fromkeys(values)
    ]
    if rows:
        connection.execute(insert(resource_labels), rows)


def replace_labels(connection: Connection, arn: str, labels: Mapping[str, Sequence[str]]) -> None:
    """Replaces all labels (key-value pairs by which lists filter) of a resource; does nothing if it does not exist."""
    sequence = connection.scalar(_SEQUENCE, {"of": arn})
    if sequence is not None:
        connection.execute(_OLD_LABELS, {"of": sequence})
        insert_labels(connection, sequence, labels)


def check_free(connection: Connection, resource: NewResource, unique_name: bool) -> None:
    """Raises an error if a new resource's ARN is taken, or its name where names have to be unique.

    Raises:
        ResourceAlreadyExistsException: The ARN or the name is taken.
    """
    taken = [resources.c.arn == resource.arn]
    if unique_name:
        taken.append(and_(resources.c.kind == resource.kind, resources.c.unique_name == resource.name))
    found = connection.execute(select(resources.c.arn, resources.c.unique_name).where(or_(*taken)).limit(1)).first()
    if found is not None:
        # Of two that were made in the same millisecond, the ARN is the same because the name is.
        is_name = unique_name and found.unique_name == resource.name
        what = f"the name {resource.name!r}" if is_name else "that ARN"
        raise ResourceAlreadyExistsException(f"{found.arn} already has {what}; choose another")
