"""Causes of losses between two runs, as far as jobs and trials tell: fewer seeds, worlds, or values of an axis."""

import re
from collections.abc import Iterator
from typing import Any

from ...schemas.reports.run_record import JobRecord
from ...schemas.runs.axes import AS_BUILT, value_text
from ...schemas.runs.axis_kinds.kind import Value
from ...schemas.specs.batch_splitting import step_of
from .compared_runs import TRIALS, NightRun

_MOST_VALUES = 3
_STOPPED = re.compile(r"stopped in trial \d+ of \d+")
"""Part of the detail of a job's trials that says that the job did not run all of them."""


def causes_of_missing(job: JobRecord, before: NightRun, after: NightRun) -> list[str]:
    """Returns what the step of a missing job has less of in the second run: `2 seeds instead of 20 (parameter seeds)`.

    Args:
        job: The missing job, as the first run has it.
        before: The first run.
        after: The second run.

    Returns:
        A text for each property of the job that no job of its step has in the second run; empty if each is there.
    """
    ours, theirs = (
        [each for each in run.jobs if step_of(each.step or "") == step_of(job.step or "")] for run in (before, after)
    )
    if not theirs:
        return ["no jobs"]
    axes = [name for name, value in job.axes.items() if not job.inputs or value != job.inputs.world]
    kinds = [("seed", "seeds"), ("world", "worlds"), *((name, f"values of axis {name}") for name in axes)]
    causes = []
    for kind, noun in kinds:
        had, has = ({_value(each, kind) for each in jobs} - {None} for jobs in (ours, theirs))
        if _value(job, kind) in had - has and has:
            fewer = len(has) < len(had)
            causes.append(_instead(noun, len(had), len(has), before, after) if fewer else f"other {noun}")
    return causes


def causes_of_fewer_trials(before: tuple[NightRun, JobRecord], after: tuple[NightRun, JobRecord]) -> list[str]:
    """Returns what a job's trials have less of in the second run: `3 cells instead of 6 (parameter cells)`.

    Args:
        before: The first run, and the job as that run has it.
        after: The second run, and the job as that run has it.

    Returns:
        Texts; empty if the tables of results do not tell.
    """
    detail = next((item.detail for item in after[1].requirements if item.name == TRIALS), "")
    if stopped := _STOPPED.search(detail):
        return [f"a job that {stopped[0]}"]
    cells = [_cells(*each) for each in (before, after)]
    if not all(cells):
        return []
    (had, had_seeds), (has, has_seeds) = ((len(each), max(each.values())) for each in cells)
    found = (
        ("cells of the axes", had, has),
        ("seeds" if had == has == 1 else "seeds in each cell", had_seeds, has_seeds),
    )
    return [_instead(noun, old, new, before[0], after[0]) for noun, old, new in found if new < old]


def why_no_trials(before: NightRun, after: NightRun) -> str:
    """Returns why no trial of one run has the seed and the axes of one of the other: the axes that share no value."""
    tables = before.results, after.results
    apart = []
    for name in dict.fromkeys((*tables[0].axes, *tables[1].axes)):
        had, has = (set(table.values(name)) if name in table.axes else {None} for table in tables)
        if not had & has:
            first, second = (", ".join(sorted(map(_named, values))[:_MOST_VALUES]) for values in (had, has))
            apart.append(f"axis {name} is {first} in the first run and {second} in the second run")
    if not apart:
        return "no trial of one run has the seed and the axes of one of the other run"
    return (
        f"no trials are pairs: {'; '.join(apart)}. Trials are compared where their axes have the same values; change "
        "the robot, such as its launch configuration, and keep the axes"
    )


def _named(value: Value | None) -> str:
    return AS_BUILT if value is None else value_text(value)


def _value(job: JobRecord, kind: str) -> Any:
    """Returns the seed that a job's request gives, its world, or its value of an axis; `None` if it has none."""
    if kind not in ("seed", "world"):
        return job.axes.get(kind)
    if job.inputs is None or (kind == "seed" and not job.inputs.seed_given):
        return None
    return job.inputs.seed if kind == "seed" else job.inputs.world


def _cells(run: NightRun, job: JobRecord) -> dict[tuple[Any, ...], int]:
    """Counts the trials of a job by the values of their axes; empty if the table of results has none."""
    table, rows = run.results, run.results.rows_of(job)
    numbers = table.numbers("trial")
    columns = [table.values(name) for name in table.axes]
    found: dict[tuple[Any, ...], int] = {}
    for row in rows:
        if numbers[row] == numbers[row]:  # NaN: the job broke between two trials
            cell = tuple(column[row] for column in columns)
            found[cell] = found.get(cell, 0) + 1
    return found


def _instead(noun: str, before: int, after: int, old: NightRun, new: NightRun) -> str:
    """Returns `2 seeds instead of 20`, with the parameters of the specification that changed in the same way."""
    names = list(_parameters(before, after, old, new))
    first, space, rest = noun.partition(" ")
    said = noun if after != 1 else f"{first.removesuffix('s')}{space}{rest}"
    by = f" ({'parameter' if len(names) == 1 else 'parameters'} {', '.join(names)})" if names else ""
    return f"{after} {said} instead of {before}{by}"


def _parameters(before: int, after: int, old: NightRun, new: NightRun) -> Iterator[str]:
    for name, value in old.parameters.items():
        if (_size(value), _size(new.parameters.get(name))) == (before, after):
            yield name


def _size(value: Any) -> int | None:
    """Returns the number that a parameter may stand for: itself, or the length of a list; else `None`."""
    if isinstance(value, list):
        return len(value)
    return value if isinstance(value, int) and not isinstance(value, bool) else None
