"""Pieces of queries that several of the catalog's methods use."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

from sqlalchemy import ColumnElement, Connection, CursorResult, RowMapping, and_, delete, insert, or_, select

from ...schemas.errors import (
    IdempotentParameterMismatchException,
    ResourceAlreadyExistsException,
    ResourceNotFoundException,
)
from .records import ClientToken, NewResource, Resource
from .tables import client_tokens, resource_labels, resources

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
"""What a `Resource` is made of."""

_FILTERS = {"name": resources.c.name, "parent": resources.c.parent, "status": resources.c.status}


def resource_of(row: RowMapping, **changes: Any) -> Resource:
    """Makes a resource of a row, with some values replaced."""
    values = {column.name: row[column.name] for column in COLUMNS} | changes
    values["labels"] = values["labels"] or {}  # rows from before there were labels have none
    return Resource(**values)


def not_found(arn: str) -> ResourceNotFoundException:
    """The error that says so."""
    return ResourceNotFoundException(f"there is no resource {arn}")


def changed_one(result: Any) -> bool:
    """Whether a statement changed a row."""
    return cast("CursorResult[Any]", result).rowcount == 1


def one_row(connection: Connection, arn: str, kind: str | None = None) -> RowMapping:
    """Reads the row of a resource, with the lease's owner.

    Raises:
      ResourceNotFoundException: there is none of that ARN and kind.
    """
    query = select(*COLUMNS, resources.c.lease_owner).where(resources.c.arn == arn)
    row = connection.execute(query).mappings().one_or_none()
    if row is None:
        raise not_found(arn)
    if kind is not None and row["kind"] != kind:
        raise ResourceNotFoundException(f"{arn} is a {row['kind']}; give the ARN of a {kind}")
    return row


def list_conditions(kinds: Sequence[str], filters: Mapping[str, Sequence[str]]) -> list[ColumnElement[bool]]:
    """The conditions for a list: of some kinds, and for each filter one of its values.

    A filter that names no column is one of a label.
    """
    one_kind = len(kinds) == 1
    conditions: list[ColumnElement[bool]] = [resources.c.kind == kinds[0] if one_kind else resources.c.kind.in_(kinds)]
    for name, values in filters.items():
        if (column := _FILTERS.get(name)) is not None:
            conditions.append(column.in_(values))
            continue
        labelled = select(resource_labels.c.sequence).where(
            resource_labels.c.key == name, resource_labels.c.value.in_(values)
        )
        conditions.append(resources.c.sequence.in_(labelled))
    return conditions


def insert_labels(connection: Connection, sequence: int, labels: Mapping[str, Sequence[str]]) -> None:
    """Adds the labels of a row, by which lists find it."""
    rows = [
        {"sequence": sequence, "key": key, "value": value}
        for key, values in labels.items()
        for value in dict.fromkeys(values)
    ]
    if rows:
        connection.execute(insert(resource_labels), rows)


def replace_labels(connection: Connection, arn: str, labels: Mapping[str, Sequence[str]]) -> None:
    """Puts other labels in the place of a row's."""
    sequence = connection.scalar(select(resources.c.sequence).where(resources.c.arn == arn))
    if sequence is not None:
        connection.execute(delete(resource_labels).where(resource_labels.c.sequence == sequence))
        insert_labels(connection, sequence, labels)


def repeated(connection: Connection, token: ClientToken, account: str) -> Resource | None:
    """The resource that an earlier call of an account with the same token added.

    Raises:
      IdempotentParameterMismatchException: that call was another request.
    """
    query = select(client_tokens.c.request_hash, client_tokens.c.arn).where(
        client_tokens.c.operation == token.operation,
        client_tokens.c.account == account,
        client_tokens.c.token == token.token,
    )
    earlier = connection.execute(query).mappings().one_or_none()
    if earlier is None:
        return None
    if earlier["request_hash"] != token.request_hash:
        raise IdempotentParameterMismatchException(
            f"clientRequestToken {token.token!r} was used for {earlier['arn']} with another request; use a new token"
        )
    return resource_of(one_row(connection, earlier["arn"]))


def check_free(connection: Connection, resource: NewResource, unique_name: bool) -> None:
    """Checks that a resource's ARN, and its name where that has to be unique, are not taken.

    Raises:
      ResourceAlreadyExistsException: one of them is.
    """
    taken = [resources.c.arn == resource.arn]
    if unique_name:
        taken.append(and_(resources.c.kind == resource.kind, resources.c.unique_name == resource.name))
    existing = connection.scalar(select(resources.c.arn).where(or_(*taken)).limit(1))
    if existing is not None:
        what = "that ARN" if existing == resource.arn else f"the name {resource.name!r}"
        raise ResourceAlreadyExistsException(f"{existing} already has {what}; choose another")
