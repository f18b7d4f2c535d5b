"""Database tables of the catalog, without those of optional parts, in SQL for both SQLite and PostgreSQL."""

from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    Dialect,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    UniqueConstraint,
)
from sqlalchemy.types import TypeDecorator

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)


class UtcTime(TypeDecorator[datetime]):
    """Database column type for a time, stored as microseconds since 1970."""

    impl = BigInteger
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> int | None:  # noqa: ARG002 - interface
        """Converts a time with a zone to microseconds since 1970, to store it; `None` stays `None`."""
        return None if value is None else (value - _EPOCH) // _MICROSECOND

    def process_result_value(self, value: Any | None, dialect: Dialect) -> datetime | None:  # noqa: ARG002 - interface
        """Converts stored microseconds since 1970 to a time in UTC; `None` stays `None`."""
        return None if value is None else _EPOCH + value * _MICROSECOND


metadata = MetaData()

SEQUENCE = BigInteger().with_variant(Integer, "sqlite")
"""Type of numbers that a table counts up; SQLite does so only in a column declared INTEGER."""

resources = Table(
    "resources",
    metadata,
    Column("sequence", SEQUENCE, primary_key=True, autoincrement=True, comment="order of creation; lists go by it"),
    Column("arn", String(1224), nullable=False, unique=True),
    Column("kind", String(64), nullable=False),
    Column("id", String(512), nullable=False),
    Column("name", String(255), nullable=False),
    Column("unique_name", String(255), comment="the name, where no other of the kind may have it"),
    Column("status", String(32), nullable=False),
    Column("parent", String(1224)),
    Column("created_at", UtcTime, nullable=False),
    Column("updated_at", UtcTime, nullable=False),
    Column("revision", Integer, nullable=False),
    Column("tags", JSON, nullable=False),
    Column("labels", JSON, comment="further values that lists filter by; also in resource_labels"),
    Column("document", JSON, nullable=False),
    Column("cancel_requested", Boolean, nullable=False, default=False),
    Column("lease_owner", String(255)),
    Column("lease_expires_at", UtcTime),
    Column("lost_workers", Integer, nullable=False, default=0, server_default="0"),
    Column(
        "last_owner", String(255), comment="the process that carries it out, or did last; releasing the lease leaves it"
    ),
    Column("owner_since", UtcTime),
    Column("lost_owner", String(255), comment="whose lease ran out, so that the last owner took it"),
    Column(
        "needed_environment", JSON, comment="of jobs that a process ordered for itself; absent where clients ordered"
    ),
    UniqueConstraint("kind", "unique_name"),
    Index("resources_by_kind", "kind", "sequence"),
    Index("resources_by_name", "kind", "name", "sequence"),
    Index("resources_by_status", "kind", "status", "sequence"),
    Index("resources_by_parent", "parent", "kind", "sequence"),
    # Ids of deleted rows must not come back: page tokens point between them.
    sqlite_autoincrement=True,
)

resource_labels = Table(
    "resource_labels",
    metadata,
    # In this order one look-up finds the resources of a label, in the order of their creation.
    Column("key", String(64), primary_key=True),
    Column("value", String(255), primary_key=True),
    Column[int]("sequence", ForeignKey("resources.sequence", ondelete="CASCADE"), primary_key=True, index=True),
)

resource_tags = Table(
    "resource_tags",
    metadata,
    # In this order one look-up finds the resources of a kind with a tag, in the order of their creation.
    Column("kind", String(64), primary_key=True),
    Column("key", String, primary_key=True),
    Column("value", String, primary_key=True),
    Column[int]("sequence", ForeignKey("resources.sequence", ondelete="CASCADE"), primary_key=True, index=True),
    sqlite_with_rowid=False,  # the key is the table
)

client_tokens = Table(
    "client_tokens",
    metadata,
    Column("operation", String(64), primary_key=True),
    Column("account", String(12), primary_key=True),
    Column("token", String(64), primary_key=True),
    Column("request_hash", String(64), nullable=False),
    Column[str]("arn", ForeignKey("resources.arn", ondelete="CASCADE"), nullable=False, index=True),
)

schema_version = Table(
    "schema_version",
    metadata,
    Column("version", Integer, primary_key=True, autoincrement=False, comment="number of migrations applied"),
)
