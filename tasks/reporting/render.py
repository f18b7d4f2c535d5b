"""Renders a run's report, a specification's history, or another page, as one HTML file."""

import base64
import hashlib
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from importlib.util import cache_from_source
from pathlib import Path

import jinja2
from jinja2.bccache import Bucket
from markupsafe import Markup, escape

from ...schemas.reports.history import History
from ...schemas.reports.report import Report
from ...schemas.specs.parameter_values import value_in_words, values_in_words
from ...schemas.wings import parts_of_wings
from ...schemas.wire.common import counted
from ..files.whole_files import write_whole
from ..results.table import ResultTable
from . import outcomes
from .nights.changes import (
    cause_in_words,
    change_in_words,
    fallen_in_words,
    fell_most_in_words,
    judged_otherwise_in_words,
    largest_fall_in_words,
    loss_in_words,
    place_in_words,
    requirement_in_words,
    shared_since,
    since_in_words,
    trend_in_words,
)
from .nights.comparison_view import ComparisonPage
from .nights.history_view import view_history
from .report_view import view_report
from .worlds import axes_in_words

_FOLDER = Path(__file__).parent
_DIGEST_BYTES = hashlib.sha256().digest_size


def render_report(report: Report, results: ResultTable | None = None) -> str:
    """Renders a run's report as one self-contained HTML document.

    Reads the `world.json` files the report names; a world that cannot be read is shown as such.
    The same report and files give the same text.

    Args:
        report: Report to show.
        results: Table of results of the report's trials; None: each job is one trial.

    Returns:
        The document.
    """
    return render_page("report.html.j2", (), view_report(report, results))


def render_history(history: History, folder: Path) -> str:
    """Renders a specification's history as one self-contained HTML document.

    Args:
        history: History of at least one run.
        folder: Folder that will contain the page, to which links to reports are relative.
    """
    return render_page("history.html.j2", ("history.css",), view_history(history, folder))


def write_comparison(page: ComparisonPage, path: Path) -> Path:
    """Writes two runs side by side to an HTML file, atomically.

    Args:
        page: Values of the page.
        path: Path of the file; its folder is created if needed.

    Returns:
        The path.
    """
    styles, scripts = ("history.css", "comparison.css"), ("beside.js",)
    return write_page(
        render_page("comparison.html.j2", styles, page, scripts=scripts, media="data: file: 'self'"), path
    )


def render_page(
    template: str,
    styles: Sequence[str],
    page: object,
    *folders: Path,
    scripts: Sequence[str] = (),
    media: str = "",
) -> str:
    """Renders a template as one self-contained HTML document.

    Args:
        template: File name of the template.
        styles: File names of style sheets, which follow the style sheet of reports.
        page: Object with the values for the template.
        folders: Further folders of templates and style sheets, searched before those of reports.
        scripts: File names of scripts, which follow the script of reports.
        media: Origins of videos, as in a content security policy; empty: there are none.
    """
    style = "".join(_asset(name, *folders) for name in ("report.css", *styles))
    script = "".join(map(_asset, ("report.js", *scripts)))
    # Only the page's own style sheet and script may run, and nothing may be fetched.
    policy = (
        f"default-src 'none'; img-src data:; style-src '{_digest(style)}'; script-src '{_digest(script)}'; "
        f"{f'media-src {media}; ' if media else ''}base-uri 'none'; form-action 'none'"
    )
    filled = _environment(*folders).get_template(template)
    return filled.render(page=page, policy=policy, style=Markup(style), script=Markup(script))  # noqa: S704


def write_report(report: Report, path: Path, results: ResultTable | None = None) -> Path:
    """Writes a run's HTML report to a file, atomically.

    Args:
        report: Report to show.
        path: Path of the file; its folder is created if needed.
        results: Table of results of the report's trials; None: each job is one trial.

    Returns:
        The path.
    """
    return write_page(render_report(report, results), path)


def write_history(history: History, path: Path) -> Path:
    """Writes a specification's HTML history to a file, atomically.

    Args:
        history: History of at least one run.
        path: Path of the file; its folder is created if needed.

    Returns:
        The path.
    """
    return write_page(render_history(history, path.absolute().parent), path)


def write_page(page: str, path: Path) -> Path:
    """Writes an HTML page to a file, which is replaced as a whole; creates its folder, and returns its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # Logs may hold bytes that are no text; those become question marks.
    return write_whole(path, page.encode(errors="replace"))


@cache
def _asset(name: str, *folders: Path) -> str:
    found = next(folder / name for folder in (*folders, _FOLDER) if (folder / name).is_file())
    return found.read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def page_styles() -> str:
    """Returns the CSS of reports, for other pages that look like them."""
    own = [path.read_text(encoding="utf-8") for part in parts_of_wings("tasks", "reporting") for path in part.STYLES]
    return "".join([*map(_asset, ("report.css", "history.css", "comparison.css")), *own])


def page_script() -> str:
    """Returns the JavaScript of reports, for other pages: it sorts tables, and plays two videos in step."""
    return "".join(map(_asset, ("report.js", "beside.js")))


@cache
def _environment(*folders: Path) -> jinja2.Environment:
    return page_environment(*folders)


class _CompiledTemplates(jinja2.BytecodeCache):
    """Keeps compiled templates among Python's compiled modules; where these may not be written, none are kept.

    Compiling the templates of a report takes 0.2 s of CPU time.

    Args:
        folder: Path of the folder; it is created if needed.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def load_bytecode(self, bucket: Bucket) -> None:
        """Reads a compiled template from its file, if there is one of the same source.

        A damaged file is left alone, as Python may crash with one: the template is compiled again.
        """
        with suppress(OSError):
            kept = self._path(bucket).read_bytes()
            digest, code = kept[:_DIGEST_BYTES], kept[_DIGEST_BYTES:]
            if digest == hashlib.sha256(code).digest():
                bucket.bytecode_from_string(code)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Writes a compiled template to its file, atomically."""
        if sys.dont_write_bytecode:
            return
        code, path = bucket.bytecode_to_string(), self._path(bucket)
        with suppress(OSError):  # somebody else's folder, a read-only or full disk
            self._folder.mkdir(parents=True, exist_ok=True)
            write_whole(path, hashlib.sha256(code).digest() + code)

    def _path(self, bucket: Bucket) -> Path:
        # Another release of Jinja, and other options, may compile the same template otherwise.
        by = bucket.environment
        options = (by.autoescape, by.trim_blocks, by.lstrip_blocks, by.keep_trailing_newline, sorted(by.extensions))
        made_by = hashlib.sha256(repr((version("jinja2"), options)).encode()).hexdigest()[:12]
        return self._folder / f"jinja2-{made_by}-{bucket.key}.cache"


def _coded(text: str) -> Markup:
    """Escapes a text for HTML, with what stands between backticks as code."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))  # noqa: S704 - it is escaped


def page_environment(*folders: Path) -> jinja2.Environment:
    """Makes a Jinja environment with autoescaping and the templates and filters of reports.

    Args:
        folders: Further template folders, searched before those of reports.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([*folders, _FOLDER]),
        bytecode_cache=_CompiledTemplates(Path(cache_from_source(__file__)).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        duration=outcomes.duration,
        counted=counted,
        number=outcomes.number,
        plain=outcomes.plain,
        compact=outcomes.compact,
        name_and_unit=outcomes.name_and_unit,
        coded=_coded,
        axes=axes_in_words,
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
        trend=trend_in_words,
        cause=cause_in_words,
        fallen=fallen_in_words,
        fell_most=fell_most_in_words,
        fell=largest_fall_in_words,
        parameters=values_in_words,
        value=value_in_words,
    )
    return environment
