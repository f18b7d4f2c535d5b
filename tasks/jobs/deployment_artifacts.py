"""Prefect artifacts of a deployment and of its report: tables of robots, and the report's place.

They only inform: a deployment ends the same without.
"""

import logging
from collections.abc import Sequence

from ...schemas.rollouts.report import DeploymentReport
from ...schemas.rollouts.rollout import Rollout
from ...schemas.wire.arns import ResourceArn
from ..catalog import Resource
from ..execution.task_runs import directly, step_runner
from ..fleet.rollout.counts import counts_of
from ..fleet.views.reports import report_of, report_path
from ..fleet.views.tables import MOST_ROWS, robot_rows
from ..reporting import write_deployment
from ..service.service import Service

_logger = logging.getLogger(__name__)


def show_wave(job: Resource, rollout: Rollout, number: int, robots: Sequence[str]) -> None:
    """Shows the robots of a wave as a table of its task run; does nothing outside a flow run."""
    if step_runner() is directly:
        return
    from ..execution.artifacts import artifact_key, show_table

    more = f", the first {MOST_ROWS} of {len(robots)}" if len(robots) > MOST_ROWS else ""
    show_table(artifact_key(job.id, f"wave-{number}"), robot_rows(rollout, robots), f"Robots of wave {number}{more}")


def report_end(job: Resource, service: Service) -> None:
    """Writes the report of a deployment that has ended, and shows in Prefect where it is."""
    try:
        report = report_of(job, service)
        path = write_deployment(report, report_path(job, service))
    except Exception:  # the deployment has ended whatever is wrong with its report
        _logger.exception("the report of %s could not be written", job.arn)
        return
    if step_runner() is not directly:
        _show_end(job, report, str(path))


def _show_end(job: Resource, report: DeploymentReport, path: str) -> None:
    from ..execution.artifacts import artifact_key, show_summary, show_table

    lines = [f"# {report.application} {report.version} to {report.fleet}: {report.status}", ""]
    lines += [f"{report.failure_code}: {report.failure_reason or ''}".rstrip(": "), ""] if report.failure_code else []
    rollout = report.rollout
    if rollout is not None:
        counts = ", ".join(f"{count} {word}" for word, count in counts_of(rollout).items())
        lines += [f"{len(rollout.robots)} robots: {counts}.", ""]
        bad = [robot for robot, state in rollout.robots.items() if state.outcome == "failed"]
        lines += [f"- **{ResourceArn.parse(robot).name}** {rollout.robots[robot].failure_code}" for robot in bad[:20]]
        show_table(artifact_key(job.id, "robots"), robot_rows(rollout, [*bad, *_others(rollout, bad)]), "Robots")
    lines += ["", f"Report: [{path}](file://{path})"]
    show_summary(artifact_key(job.id, "summary"), "\n".join(lines))


def _others(rollout: Rollout, bad: Sequence[str]) -> list[str]:
    left_out = frozenset(bad)
    return [robot for robot in rollout.plan.order if robot not in left_out]
