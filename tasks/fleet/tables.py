"""Database tables of rollouts in the catalog, in SQL that both SQLite and PostgreSQL accept."""

from sqlalchemy import JSON, Boolean, Column, Float, ForeignKey, Integer, Table

from ..catalog.tables import SEQUENCE, metadata

rollouts = Table(
    "rollouts",
    metadata,
    Column[str]("job", ForeignKey("resources.arn", ondelete="CASCADE"), primary_key=True),
    Column("revision", Integer, nullable=False),
    Column("is_open", Boolean, nullable=False, index=True, comment="whether robots may have orders of it"),
    Column("delivery", JSON, nullable=False, comment="what robots get; it does not change"),
    Column("rollout", JSON, nullable=False, comment="how it stands"),
)

robot_orders = Table(
    "robot_orders",
    metadata,
    # PostgreSQL counts a plain integer up to 2147483647, the largest number that robots understand.
    Column("number", Integer, primary_key=True, autoincrement=True),
    Column[str]("job", ForeignKey("resources.arn", ondelete="CASCADE"), nullable=False, index=True),
    # Numbers of deleted rows must not come back: a robot would take another's order for its own.
    sqlite_autoincrement=True,
)

rollout_events = Table(
    "rollout_events",
    metadata,
    Column("sequence", SEQUENCE, primary_key=True, autoincrement=True),
    Column[str]("job", ForeignKey("resources.arn", ondelete="CASCADE"), nullable=False, index=True),
    Column[float]("at_s", Float, nullable=False, comment="when it happened, in seconds since 1970"),
    Column("event", JSON, nullable=False),
)

TABLES = (rollouts, robot_orders, rollout_events)
"""All tables of rollouts, in the order in which they are created."""
