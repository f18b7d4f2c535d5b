"""Renders the console's templates, style and script, which extend those of reports, so that all pages look alike."""

import hashlib
import re
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

import jinja2
from markupsafe import Markup, escape

from ...schemas.reports.changes import SinceLastRun
from ...schemas.reports.run_states import shown_state
from ...schemas.wings import parts_of_wings
from ...tasks.reporting import outcomes, page_environment, page_script, page_styles

_FOLDER = Path(__file__).parent
HOME = "/console"
"""URL path prefix of all pages of the web console."""


def render(template: str, /, **values: Any) -> str:
    """Renders an HTML template of the web console; all values are escaped."""
    found = _environment().from_string if template.startswith("{%") else _environment().get_template
    return found(template).render(values)


@cache
def asset(name: str) -> str:
    """Returns the content of the console's style sheet or of a script.

    Raises:
        KeyError: The name is that of none.
    """
    before: dict[str, Callable[[], str]] = {"console.css": page_styles, "console.js": page_script, "timeline.js": str}
    return before[name]() + "\n" + (_FOLDER / "assets" / name).read_text(encoding="utf-8")


@cache
def asset_address(name: str) -> str:
    """Returns the URL path of a style sheet or script, with a content hash for caching."""
    return f"{HOME}/assets/{hashlib.sha256(asset(name).encode()).hexdigest()[:12]}/{name}"


def address(kind: str, resource_id: str) -> str:
    """Returns the URL path of a resource's web page; empty for kinds that have none."""
    if kind == "world-template":
        return f"{HOME}/worlds?template={quote(resource_id)}"
    folder = FOLDERS.get(kind)
    return f"{HOME}/{folder}/{quote(resource_id)}" if folder else ""


@cache
def icon(key: str) -> str:
    """Returns the HTML of the icon for a state, such as passed or failed."""
    return f'<svg class="icon" viewBox="0 0 16 16" aria-hidden="true"><use href="#icon-{key}"/></svg>'


_OF_WINGS = parts_of_wings("deployments", "console.kinds")

FOLDERS: dict[str, str] = {
    "simulation-job": "jobs",
    "simulation-job-batch": "batches",
    "world": "worlds",
    "world-generation-job": "generations",
}
"""First URL part of the pages of each kind of resource; the modules in `pages` add theirs."""

MENU = [(1, "runs", "Runs"), (2, "batches", "Batches"), (3, "jobs", "Jobs"), (4, "worlds", "Worlds")]
"""Entries of the menu (position, folder, title); the modules in `pages` add theirs."""


def ago(moment: datetime) -> str:
    """Formats how long ago a time was: `3 min ago`; from a day on, the date and time in full."""
    seconds = (datetime.now(UTC) - moment).total_seconds()
    if seconds >= 86_400:
        return outcomes.minute(moment)
    if seconds < 60:
        return "just now"
    minutes = int(seconds // 60)
    return f"{minutes} min ago" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min ago"


def since_briefly(since: SinceLastRun) -> str:
    """Says in one line what changed since the run before: `1 newly failing, 2 newly passing`."""
    failing = [change for change in (*since.newly_failing, *since.first_failing) if not change.known]
    lost = [*since.gone, *since.no_longer_judged, *since.asked_less, *since.fewer_trials]
    counts = {
        "newly failing": len(failing),
        "newly passing": len(since.newly_passing),
        "still failing": sum(not change.known for change in since.still_failing),
        "known to fail": sum(
            bool(change.known) for change in (*since.newly_failing, *since.still_failing, *since.first_failing)
        ),
        "checked less than before": len({each.job for each in lost}),
        "judged by other requirements": since.other_requirements,
        "without a result": since.without_result,
    }
    if not since.paired and not since.has_losses and not any(counts.values()):
        return "no job could be compared"
    told = [f"{count} {'job' if count == 1 else 'jobs'} {words}" for words, count in counts.items() if count]
    missed = sum(change.newly_missed > 0 for change in since.requirements)
    told += [f"{missed} {'requirement' if missed == 1 else 'requirements'} newly missed in trials"] if missed else []
    shrinking = len(since.shrinking)
    told += [f"{shrinking} {'margin shrinks' if shrinking == 1 else 'margins shrink'}"] if shrinking else []
    return ", ".join(told) or "no verdict changed"


def breakable(text: str) -> Markup:
    """Returns a text as HTML in which a long word, such as a failure code, may break before its capitals."""
    broken = _LONG_WORD.sub(lambda word: _INNER_CAPITAL.sub("<wbr>", word[0]), str(escape(text)))
    return Markup(broken)  # noqa: S704 - it is escaped


_LONG_WORD, _INNER_CAPITAL = re.compile("[A-Za-z]{16,}"), re.compile("(?<=[a-z])(?=[A-Z])")


@cache
def _environment() -> jinja2.Environment:
    folders = (folder for part in _OF_WINGS for folder in part.TEMPLATES)
    environment = page_environment(_FOLDER / "templates", *folders)
    environment.auto_reload = False  # or each part of a page is looked for on the disk, each time
    environment.filters.update(ago=ago, size=outcomes.size, since_briefly=since_briefly, shown_state=shown_state)
    environment.filters.update(breakable=breakable)
    environment.globals.update(HOME=HOME, MENU=MENU, address=address, asset_address=asset_address)
    return environment
