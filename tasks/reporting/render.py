"""Renders a report, a specification's history, or a deployment, as one HTML file."""

import base64
import hashlib
import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import jinja2
from markupsafe import Markup

from ...schemas.reports.history import History
from ...schemas.reports.report import Report
from ...schemas.rollouts.rollout import DeploymentReport
from ..results.table import ResultTable
from . import outcomes
from .nights.changes import (
    change_in_words,
    judged_otherwise_in_words,
    loss_in_words,
    place_in_words,
    requirement_in_words,
    shared_since,
    since_in_words,
)
from .nights.view import view_history
from .rollouts.view import view_rollout
from .view import view_report

_FOLDER = Path(__file__).parent


def render_report(report: Report, results: ResultTable | None = None) -> str:
    """Renders a report as one HTML document that loads nothing from anywhere.

    Reads the `world.json` files the report names; a world that cannot be read is shown as such.
    The same report and files give the same text.

    Args:
        report: what to show.
        results: the results of its trials; None: each job is one trial.

    Returns:
        The document.
    """
    return _page("report.html.j2", ("report.css",), view_report(report, results))


def render_history(history: History, folder: Path) -> str:
    """Renders a history as one HTML document that loads nothing from anywhere.

    Args:
        history: what to show; of at least one run.
        folder: the folder the page will be in, which its links to reports start from.
    """
    return _page("history.html.j2", ("report.css", "history.css"), view_history(history, folder))


def render_deployment(report: DeploymentReport) -> str:
    """Renders the report of a deployment as one HTML document that loads nothing from anywhere.

    Args:
        report: what to show.
    """
    return _page("rollout.html.j2", ("report.css", "rollout.css"), view_rollout(report))


def _page(template: str, styles: Sequence[str], page: object) -> str:
    style, script = "".join(map(_asset, styles)), _asset("report.js")
    # Only the page's own style sheet and script may run, and nothing may be fetched.
    policy = (
        f"default-src 'none'; img-src data:; style-src '{_digest(style)}'; script-src '{_digest(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )
    filled = _environment().get_template(template)
    return filled.render(page=page, policy=policy, style=Markup(style), script=Markup(script))  # noqa: S704


def write_report(report: Report, path: Path, results: ResultTable | None = None) -> Path:
    """Renders a report into a file, which appears only when it is whole.

    Args:
        report: what to show.
        path: the file; its folder is made if needed.
        results: the results of its trials; None: each job is one trial.

    Returns:
        The path.
    """
    return _write(render_report(report, results), path)


def write_history(history: History, path: Path) -> Path:
    """Renders a history into a file, which appears only when it is whole.

    Args:
        history: what to show; of at least one run.
        path: the file; its folder is made if needed.

    Returns:
        The path.
    """
    return _write(render_history(history, path.absolute().parent), path)


def write_deployment(report: DeploymentReport, path: Path) -> Path:
    """Renders the report of a deployment into a file, which appears only when it is whole.

    Args:
        report: what to show.
        path: the file; its folder is made if needed.

    Returns:
        The path.
    """
    return _write(render_deployment(report), path)


def _write(page: str, path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        # Logs may hold bytes that are no text; those become question marks.
        partial.write_text(page, encoding="utf-8", errors="replace")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return path


@cache
def _asset(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def page_styles() -> str:
    """The style sheets of reports, histories and deployments, for other pages that look like them."""
    return "".join(map(_asset, ("report.css", "history.css", "rollout.css")))


def report_script() -> str:
    """The script of reports: sorts tables, copies commands, tells the reader's own time."""
    return _asset("report.js")


@cache
def _environment() -> jinja2.Environment:
    return page_environment()


def page_environment(*folders: Path) -> jinja2.Environment:
    """Makes an environment that escapes everything, with the templates and filters of reports.

    Args:
        folders: further templates, which go before those of reports.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([*folders, _FOLDER]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        duration=outcomes.duration,
        number=outcomes.number,
        plain=outcomes.plain,
        compact=outcomes.compact,
        moment=outcomes.moment,
        minute=outcomes.minute,
        day=outcomes.day,
        change=change_in_words,
        since=since_in_words,
        shared_since=shared_since,
        judged_otherwise=judged_otherwise_in_words,
        loss=loss_in_words,
        place=place_in_words,
        requirement=requirement_in_words,
    )
    return environment
