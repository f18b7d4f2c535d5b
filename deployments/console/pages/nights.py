"""Pages with the history of a specification night by night."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from starlette.responses import RedirectResponse, Response

from ....schemas.reports.run_record import RunRecord
from ....schemas.specs.specification import is_spec_name
from ....schemas.wire.errors import ResourceNotFoundException
from ....tasks.comparison.compared_runs import NightRun
from ....tasks.comparison.history import history_of
from ....tasks.inspection.run_records import find_records, names_of_specifications
from ....tasks.reporting import HistoryPage, view_history
from ..rendering import HOME
from ..run_records import sees_run
from ..runs import names_of_seen
from ..visit import Visit

_MOST_NIGHTS = 60
_MOST_NIGHTS_SEEN = 20
"""Limit of the nights shown for an access key with restricted resources, as each job of each night is looked up."""


def show_all(visit: Visit) -> Response:
    """Web page with the list of specifications that have runs, or the history of the only one."""
    names = names_of_specifications(_runs(visit)) if visit.sees_all else names_of_seen(visit)
    if len(names) == 1:
        return RedirectResponse(f"{HOME}/history/{names[0]}", 303)
    return visit.page("histories.html.j2", names=names)


def show(visit: Visit) -> Response:
    """Web page with the history of one specification's runs, as far as the visitor may see them.

    Raises ResourceNotFoundException if there is no such run.
    """
    name, runs = visit.request.path_params["name"], _runs(visit)
    known = sorted(runs.glob(f"{name}-*/run.json")) if is_spec_name(name) else []
    if not known:
        raise ResourceNotFoundException(f"there is no run of {name!r} in the data home of this server")
    if visit.sees_all:
        page = _history(name, runs, len(known), known[-1].stat().st_mtime_ns)
    else:  # not kept: what a key may see changes with the tags of resources
        seen = [record for record in find_records(runs, name, _MOST_NIGHTS_SEEN).records if sees_run(visit, record)]
        page = _view(name, runs, seen)
    if page is None:
        raise ResourceNotFoundException(f"there is no run of {name!r} in the data home of this server")
    nights = [replace(night, link=f"{HOME}/runs/{night.night.run_id}") for night in page.nights]
    return visit.page("history_page.html.j2", page=replace(page, nights=nights))


def _runs(visit: Visit) -> Path:
    return visit.service.settings.home / "runs"


@lru_cache(maxsize=8)
def _history(name: str, runs: Path, count: int, changed_at: int) -> HistoryPage | None:
    """Returns the history of a specification's runs; cached until the number of runs or the newest one changes.

    It is `None` if no run can be read.
    """
    del count, changed_at
    found = find_records(runs, name, _MOST_NIGHTS)
    return _view(name, runs, found.records, found.left_out)


def _view(name: str, runs: Path, records: Sequence[RunRecord], left_out: int = 0) -> HistoryPage | None:
    if not records:
        return None
    return view_history(history_of(name, [NightRun.of(each) for each in records], left_out), runs)


MENU = (5, "history", "History")
PAGES = {
    "/history": show_all,
    "/history/{name}": show,
}
