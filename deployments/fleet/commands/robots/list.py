"""List robots: status, installed version, when each polled last, and what is wrong with its application.

Newest first. A robot that has no token is not enrolled, and cannot poll.
"""

import argparse
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from ....cli.arguments import add_output
from ....cli.inputs.options import open_service
from ....cli.output.answers import in_columns, print_either

if TYPE_CHECKING:
    from .....schemas.fleet.documents import RobotDocument
    from .....tasks.service.service import Service

_PAGE = 500
_COLUMNS = ("robot", "kind", "status", "version", "last_seen", "fleet", "trouble")

Row = dict[str, str | bool | None]


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker robots list` to its parser."""
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker robots list`: prints the robots."""
    rows = list(_rows(open_service()))
    print_either(arguments.output, {"schema_version": 1, "robots": rows}, _lines(rows))
    return 0


def _rows(service: "Service") -> Iterator[Row]:
    from .....schemas.fleet.documents import RobotDocument
    from .....schemas.wire.arns import ResourceArn
    from .....tasks.fleet.fleet_records import FLEET, ROBOT

    after = None
    while True:
        page = service.catalog.list(ROBOT, limit=_PAGE, after=after)
        for robot in page.resources:
            document = RobotDocument.of(robot)
            seen_s = document.last_seen_s
            yield {
                "robot": robot.name,
                "kind": _kind(document),
                "status": robot.status,
                "version": document.installed,
                "last_seen": None if seen_s is None else datetime.fromtimestamp(int(seen_s), UTC).isoformat(),
                "enrolled": document.token_sha256 is not None,
                "fleet": document.fleet and ResourceArn.parse(document.fleet, FLEET).name,
                "trouble": document.trouble,
            }
        if (after := page.next_token) is None:
            return


def _kind(document: "RobotDocument") -> str | None:
    """Kind of updater on the robot: `agent` (ours) or `updater` (third-party); `None`: neither was enrolled."""
    if document.has_agent:
        return "agent"
    return None if document.token_sha256 is None else "updater"


def _lines(rows: list[Row]) -> list[str]:
    if not rows:
        return ["There are no robots; CreateRobot makes one."]
    columns = [name for name in _COLUMNS if name != "trouble" or any(row["trouble"] for row in rows)]
    titles = [name.replace("_", " ") for name in columns]
    return in_columns([titles, *([_cell(row, name) for name in columns] for row in rows)])


def _cell(row: Row, name: str) -> str:
    if name == "last_seen" and row["last_seen"] is None:
        return "never" if row["enrolled"] else "not enrolled"
    return str(row[name] or "-")
