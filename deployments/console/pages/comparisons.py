"""Pages of two runs, or of two cells of an axis of one run, side by side: paths, videos, requirements."""

from functools import lru_cache
from pathlib import Path
from urllib.parse import quote, urlencode

from starlette.responses import Response

from ....schemas.reports.report import ReportedFile
from ....schemas.reports.run_record import JobRecord
from ....schemas.wire.errors import InvalidParameterException, ResourceNotFoundException
from ....tasks.comparison.side_by_side import axes_of
from ....tasks.inspection.run_records import RECORD_NAME, read_record
from ...compared_pages import Sides, compared_page
from ..job_states import JOB
from ..rendering import HOME, address
from ..run_records import is_known
from ..visit import Visit

_PAGE_LENGTH = 10
"""Number of pairs on a page: each takes two results, a plan with two paths, and up to two videos."""


def compare_runs(visit: Visit) -> Response:
    """Web page that compares two runs job by job.

    Raises ResourceNotFoundException if the visitor may not see a run, or if both names are of one run.
    """
    names = [visit.parameter(which) for which in ("before", "after")]
    before, after = (_record_path(name, visit) for name in names)
    if before == after:
        raise ResourceNotFoundException(f"both runs are {names[0]}; name two")
    sides = _runs_beside(before, before.stat().st_mtime_ns, after, after.stat().st_mtime_ns)
    return _page(visit, sides, {"before": names[0], "after": names[1]})


def compare_cells(visit: Visit) -> Response:
    """Web page that compares two values of an axis of a run, job by job.

    Raises ResourceNotFoundException if there is no such run or axis, or if both values are the same; raises
    InvalidParameterException if the number of a value is out of range.
    """
    run, step, name = (visit.parameter(which) for which in ("run", "step", "axis"))
    record = read_record(_record_path(run, visit))
    axis = next((each for each in axes_of(record.jobs) if (each.step, each.name) == (step, name)), None)
    if axis is None:
        raise ResourceNotFoundException(f"step {step!r} of {run} has no axis {name!r} of two values or more")
    first, other = (_number(visit, which, len(axis.values) - 1) for which in ("first", "other"))
    if first == other:
        raise ResourceNotFoundException(f"both values are {axis.titles[first]}; name two")
    sides = Sides.of_cells(record, axis, first, other)
    return _page(visit, sides, {"run": run, "step": step, "axis": name, "first": str(first), "other": str(other)})


def _page(visit: Visit, sides: Sides, query: dict[str, str]) -> Response:
    """Shows some of the compared pairs of jobs, from the number that the address has as `from`, else the first ones.

    Raises InvalidParameterException if that number is none from 1 to the number of pairs.
    """
    first = _number(visit, "from", max(len(sides.pairs), 1), least=1) if visit.parameter("from") else 1
    seen = {job.arn for job in _seen(visit, sides, first)}

    def trial_link(pair: int, trial: int) -> str:
        chosen = {**query, "from": first, "pair": pair, "trial": trial}
        return f"{visit.request.url.path}?{urlencode(chosen)}#pair-{pair}"

    def link(start: int) -> str:
        return f"{visit.request.url.path}?{urlencode({**query, 'from': start})}#beside"

    page = compared_page(
        sides,
        visit.service,
        _video_link,
        first=first,
        most=_PAGE_LENGTH,
        is_seen=lambda job: job.arn in seen,
        chosen=_chosen(visit, first),
        trial_link=trial_link,
        job_link=_job_link,
        run_link=lambda run_id: f"{HOME}/runs/{quote(run_id)}",
        earlier=link(max(1, first - _PAGE_LENGTH)) if first > 1 else "",
        later=link(first + _PAGE_LENGTH) if first + _PAGE_LENGTH <= len(sides.pairs) else "",
    )
    return visit.page("comparison.html.j2", page=page)


def _chosen(visit: Visit, first: int) -> dict[int, int]:
    """Returns the trial that the address names, by the pairs that show it: its `pair`, else all of the page."""
    trial, pair = visit.parameter("trial"), visit.parameter("pair")
    if not _is_number(trial):
        return {}
    pairs = [int(pair)] if _is_number(pair) else range(first, first + _PAGE_LENGTH)
    return dict.fromkeys(pairs, int(trial))


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) < 9  # no job has more trials


def _seen(visit: Visit, sides: Sides, first: int) -> list[JobRecord]:
    """Returns the jobs of the pairs on the page that the visitor may see."""
    shown = sides.pairs[first - 1 : first - 1 + _PAGE_LENGTH]
    jobs = [job for pair in shown for job in (pair.before, pair.after)]
    if visit.sees_all:
        return jobs
    found = visit.service.catalog.get_many((job.arn for job in jobs if job.arn), ())
    seen = {resource.arn for resource in visit.seen(found.values())}
    return [job for job in jobs if job.arn in seen]


def _job_link(label: str) -> str:
    return "" if " " in label else address(JOB, label)  # no job came of `request 3`


def _video_link(job: JobRecord, file: ReportedFile) -> str:
    return f"{address(JOB, job.label)}/files/{quote(file.name)}"


def _record_path(name: str, visit: Visit) -> Path:
    if not is_known(name, visit):
        raise ResourceNotFoundException(f"there is no run {name!r} in the data home of this server")
    return visit.service.settings.home / "runs" / name / RECORD_NAME


def _number(visit: Visit, name: str, most: int, *, least: int = 0) -> int:
    given = visit.parameter(name)
    if not (_is_number(given) and least <= int(given) <= most):
        raise InvalidParameterException(f"{name} is {given!r}; a whole number from {least} to {most} would be right")
    return int(given)


@lru_cache(maxsize=4)
def _runs_beside(before: Path, before_changed_at: int, after: Path, after_changed_at: int) -> Sides:
    """Compares two runs; kept until a record changes, since a comparison is looked at page by page."""
    del before_changed_at, after_changed_at
    return Sides.of_runs(read_record(before), read_record(after))


PAGES = {
    "/compare": compare_runs,
    "/compare/cells": compare_cells,
}
