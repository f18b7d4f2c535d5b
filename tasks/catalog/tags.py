"""Tags of resources as rows, by which lists find them; what a resource answers of its tags is in its own row."""

from collections.abc import Mapping

from sqlalchemy import Connection, bindparam, delete, insert, select

from .tables import resource_tags, resources

_ADDED = insert(resource_tags)
_PLACE = select(resources.c.kind, resources.c.sequence).where(resources.c.arn == bindparam("of"))
_OLD = delete(resource_tags).where(resource_tags.c.sequence == bindparam("of"))


def insert_tags(connection: Connection, kind: str, sequence: int, tags: Mapping[str, str]) -> None:
    """Adds the tags of a row, by which lists find it."""
    rows = [{"kind": kind, "key": key, "value": value, "sequence": sequence} for key, value in tags.items()]
    if rows:
        connection.execute(_ADDED, rows)


def replace_tags(connection: Connection, arn: str, tags: Mapping[str, str]) -> None:
    """Puts other tags in the place of a row's."""
    place = connection.execute(_PLACE, {"of": arn}).one_or_none()
    if place is not None:
        connection.execute(_OLD, {"of": place.sequence})
        insert_tags(connection, place.kind, place.sequence, tags)
