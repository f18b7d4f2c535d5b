"""Say what a deployment would do to which robot, in which wave; nothing is stored.

Takes the request of CreateDeploymentJob. A robot that is away, or not enrolled, would time out.
"""

import argparse
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from .....schemas.wire.common import counted
from ....cli.arguments import add_output
from ....cli.inputs.options import open_service
from ....cli.output.answers import in_columns, print_either

if TYPE_CHECKING:
    from .....tasks.fleet.control.dry_runs import DryRun, PlannedChange

_COLUMNS = ("wave", "robot", "has", "would get", "notes")


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet plan` to its parser."""
    parser.add_argument(
        "--input", metavar="INPUT", required=True, help="request: a file, JSON text, or - for standard input"
    )
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet plan`: prints what a deployment would do to each robot, without creating it."""
    from .....tasks.fleet.operations.deployment_jobs import plan_deployment
    from ....cli.inputs.specifications import read_request

    request = read_request(arguments.input, "CreateDeploymentJob")
    plan = plan_deployment(request, open_service())
    windows = [window.to_wire() for window in plan.windows]
    answer = {"schema_version": 1, **asdict(plan), "windows": windows, "opens": _moment(plan.opens_s)}
    del answer["opens_s"]
    print_either(arguments.output, answer, [*in_columns([_COLUMNS, *map(_row, plan.changes)]), *_remarks(plan)])
    return 0


def _row(change: "PlannedChange") -> tuple[str, ...]:
    notes = [*(["canary"] if change.is_canary else []), *change.notes]
    return (str(change.wave or "-"), change.robot, change.before or "-", change.after or "-", "; ".join(notes))


def _remarks(plan: "DryRun") -> list[str]:
    remarks = [f"{plan.at_once} of {counted(len(plan.changes), 'robot')} at the same time."]
    if plan.requires_approval:
        has_canaries = any(change.is_canary for change in plan.changes)
        remarks.append("Waits for approval " + ("after the canaries." if has_canaries else "before the first robot."))
    if plan.opens_s is not None:
        remarks.append(f"No maintenance window is open; the next opens at {_moment(plan.opens_s)}.")
    if plan.rolls_back:
        remarks.append("At the threshold, robots that have the new version go back to the one before.")
    if plan.blocked_by is not None:
        remarks.append(f"It would be refused now: the fleet has the deployment {plan.blocked_by}.")
    return remarks


def _moment(time_s: float | None) -> str | None:
    return None if time_s is None else datetime.fromtimestamp(time_s, UTC).isoformat(timespec="minutes")
