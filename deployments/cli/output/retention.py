"""Formats the result of `robomaker gc`: a table of items to delete, reasons for keeping others, totals."""

from collections import Counter
from collections.abc import Sequence

from rich.filesize import decimal

from ....schemas.reports.retention import GcItem, GcReport
from .answers import in_columns

_TITLES = ("", "what", "ended", "state", "objects", "size", "")
_RIGHT = (4, 5)
_LOSES = "its report loses its recordings, videos and logs, and says so"


def report_lines(report: GcReport) -> list[str]:
    """Formats the result of `robomaker gc` as text lines."""
    gone = report.removed
    rows = [_row(item) for item in gone]
    lines = in_columns([_TITLES, *rows], _RIGHT) if rows else []
    lines += [f"! {problem}" for problem in report.problems]
    lines += [f"kept {count}: {reason}" for reason, count in _kept(report.items)]
    lines += [note for note in (*report.notes, report.flow_runs.note, _database(report)) if note]
    return [*lines, _total(report, gone)]


def _row(item: GcItem) -> Sequence[str]:
    ended = f"{item.ended_at.astimezone():%Y-%m-%d %H:%M}" if item.ended_at else ""
    loses = [_LOSES] if item.action == "thin" and item.kind == "run" else []
    remark = "; ".join([*loses, *([item.reason] if item.reason else [])])
    return item.action, _name(item), ended, item.state, str(item.objects), decimal(item.size_bytes), remark


def _name(item: GcItem) -> str:
    """Returns the short name of an item to delete: a run's id, or the distinctive part of an ARN."""
    return item.id if item.kind == "run" else item.id.split(":", 5)[-1]


def _kept(items: Sequence[GcItem]) -> list[tuple[str, int]]:
    """Counts the reasons why `robomaker gc` keeps items, the most frequent first."""
    return Counter(item.reason for item in items if item.action == "keep").most_common()


def _database(report: GcReport) -> str:
    """Describes the size of Prefect's database and the space in it that is or would be freed; empty if unknown."""
    told = report.flow_runs
    if told.database_bytes is None:
        return ""
    size, freed = decimal(told.database_bytes), decimal(told.freed_bytes)
    if report.dry_run:
        takes = ", and what the flow runs take" if told.count else ""
        return f"the database of the local Prefect server has {size}, of which {freed} are given back{takes}"
    return f"the database of the local Prefect server has {size}, {freed} less than before"


def _total(report: GcReport, gone: Sequence[GcItem]) -> str:
    counts = Counter(item.kind for item in gone)
    words = {"run": ("run", "runs"), "jobs": ("order of an SDK", "orders of SDKs"), "world": ("world", "worlds")}
    words |= {"recording": ("recording", "recordings")}
    words |= {"robot-files": ("folder of files for robots", ""), "copies": ("cache", "caches")}
    parts = [f"{counts[kind]} {words[kind][counts[kind] != 1]}" for kind in words if counts[kind]]
    if flow_runs := report.flow_runs.count:
        parts.append(f"{flow_runs} flow {'run' if flow_runs == 1 else 'runs'} of Prefect")
    if report.flow_runs.freed_bytes:
        parts.append("free space of Prefect's database")
    if not parts:
        return "Nothing to remove."
    size = decimal(sum(item.size_bytes for item in gone) + report.flow_runs.freed_bytes)
    done = "Would free" if report.dry_run else "Freed, but for what is told above," if report.problems else "Freed"
    return f"{done} {size} in {sum(item.objects for item in gone)} objects: {', '.join(parts)}."
