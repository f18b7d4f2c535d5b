"""Renders a report as one HTML file."""

import base64
import hashlib
import os
from functools import cache
from pathlib import Path

import jinja2
from markupsafe import Markup

from ...schemas.reports.report import Report
from . import wording
from .view import view_report

_FOLDER = Path(__file__).parent


def render_report(report: Report) -> str:
    """Renders a report as one HTML document that loads nothing from anywhere.

    Reads the `world.json` files the report names; a world that cannot be read is shown as such.
    The same report and files give the same text.

    Args:
        report: what to show.

    Returns:
        The document.
    """
    style, script = _asset("report.css"), _asset("report.js")
    # Only the page's own style sheet and script may run, and nothing may be fetched.
    policy = (
        f"default-src 'none'; img-src data:; style-src '{_digest(style)}'; script-src '{_digest(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )
    return (
        _environment()
        .get_template("report.html.j2")
        .render(page=view_report(report), policy=policy, style=Markup(style), script=Markup(script))  # noqa: S704
    )


def write_report(report: Report, path: Path) -> Path:
    """Renders a report into a file, which appears only when it is whole.

    Args:
        report: what to show.
        path: the file; its folder is made if needed.

    Returns:
        The path.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        # Logs may hold bytes that are no text; those become question marks.
        partial.write_text(render_report(report), encoding="utf-8", errors="replace")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return path


@cache
def _asset(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        duration=wording.duration,
        number=wording.number,
        plain=wording.plain,
        compact=wording.compact,
        moment=wording.moment,
    )
    return environment
