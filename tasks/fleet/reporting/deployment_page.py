"""Renders a deployment as one HTML file."""

from pathlib import Path

from ....schemas.fleet.rollouts.rollout import DeploymentReport
from ...reporting import render_page, write_page
from . import FOLDER, STYLES
from .deployment_view import view_rollout


def render_deployment(report: DeploymentReport) -> str:
    """Renders the report of a deployment as one self-contained HTML document.

    Args:
        report: The report to show.
    """
    return render_page("rollout.html.j2", [path.name for path in STYLES], view_rollout(report), FOLDER)


def write_deployment(report: DeploymentReport, path: Path) -> Path:
    """Writes the HTML report of a deployment to a file, atomically.

    Args:
        report: The report to show.
        path: The file; its folder is made if needed.

    Returns:
        The path.
    """
    return write_page(render_deployment(report), path)
