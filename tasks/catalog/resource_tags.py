"""Tags of resources in the catalog: how many a resource may have, and the rows by which lists filter."""

from collections.abc import Mapping

from sqlalchemy import Connection, bindparam, delete, insert, select

from ...schemas.wire.errors import InvalidParameterException
from ...schemas.wire.tags import MAX_TAGS
from .tables import resource_tags, resources

_ADDED = insert(resource_tags)
_PLACE = select(resources.c.kind, resources.c.sequence).where(resources.c.arn == bindparam("of"))
_OLD = delete(resource_tags).where(resource_tags.c.sequence == bindparam("of"))


def merged_tags(arn: str, before: Mapping[str, str], added: Mapping[str, str]) -> dict[str, str]:
    """Returns a resource's tags after some are added or get new values.

    Args:
        arn: ARN of the resource, for the error.
        before: Tags that the resource has.
        added: Tags to add; keys that the resource has get the new value.

    Raises:
        InvalidParameterException: The resource would have more than 50 tags.
    """
    after = {**before, **added}
    if len(after) > MAX_TAGS:
        raise InvalidParameterException(f"tags: {arn} would have {len(after)} tags; a resource has at most {MAX_TAGS}")
    return after


def insert_tags(connection: Connection, kind: str, sequence: int, tags: Mapping[str, str]) -> None:
    """Adds tags to a resource's database rows for tags, by which lists filter; existing ones stay."""
    rows = [{"kind": kind, "key": key, "value": value, "sequence": sequence} for key, value in tags.items()]
    if rows:
        connection.execute(_ADDED, rows)


def replace_tags(connection: Connection, arn: str, tags: Mapping[str, str]) -> None:
    """Replaces all tags of a resource, by which lists filter, in the database; does nothing if it does not exist."""
    place = connection.execute(_PLACE, {"of": arn}).one_or_none()
    if place is not None:
        connection.execute(_OLD, {"of": place.sequence})
        insert_tags(connection, place.kind, place.sequence, tags)
