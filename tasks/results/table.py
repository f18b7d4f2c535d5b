"""Table of a run's results, `results.parquet` in its folder: a row per trial; a job without trials has one row."""

import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from ...schemas.reports.run_record import JobRecord, case_outcome
from ...schemas.runs.axes import value_text
from ...schemas.runs.axis_kinds.kind import Value
from ...schemas.runs.plan import Requirement
from ...schemas.runs.trial_rows import TrialRow, trial_folder
from .columns import Names, columns_of, schema_of
from .exports import export_table

if TYPE_CHECKING:
    import pyarrow as pa

RESULTS_FILE = "results.parquet"

TrialsOf = Callable[[JobRecord], "pa.Table | None"]
"""Function that returns the table of a job's trials; None: it has no trials, or none of them ended."""

_OF_JOBS = ("step", "test", "job", "world", "world_name", "outcome", "output")
_NAME = "job_name"
"""Column of names for people; tables of early releases have none."""
_OUTCOMES = {"PASS": "passed", "FAIL": "failed", "ERROR": "broken", "NONE": "no verdict"}
_REQUIREMENTS = TypeAdapter(list[Requirement])


class ResultTable:
    """Table of a run's results, one row for each trial, in the order of its jobs.

    | column | content |
    | --- | --- |
    | `step`, `test`, `job` | the step, the job's name in every run of the specification, and its id |
    | `job_name` | its name for people, unique in the run: `scout in flat 3` |
    | `world`, `world_name` | the world by its content, and by its name in this run; empty: none |
    | `outcome` | `passed`, `failed`, `broken`, `canceled`, `unfinished` or `no verdict` |
    | `output` | address of its outputs; empty where a trial has none of its own |
    | all others | as in `trials.parquet`; `trial` is empty for a job without trials |
    """

    def __init__(self, names: Sequence[str], rows: int, column: "Callable[[str], pa.ChunkedArray]") -> None:
        self._all_names = list(names)
        self._rows = rows
        self._column = column

    @classmethod
    def of(cls, jobs: Sequence[JobRecord], trials: TrialsOf | None = None) -> "ResultTable":
        """Makes and returns the results table of some jobs, with a row for each trial.

        A job that failed between two trials has a row of its own for that, in addition to its trials' rows.

        Args:
            jobs: Records of the jobs.
            trials: Function that returns the tables of their trials; None: no job has any.
        """
        import pyarrow as pa

        tables: list[pa.Table] = []
        alone: list[JobRecord] = []

        def add_those_alone() -> None:
            if alone:
                tables.append(_rows_of(alone))
                alone.clear()

        for job in jobs:
            rows = trials(job) if trials else None
            if rows is not None and rows.num_rows:
                add_those_alone()
                tables.append(_of_trials(job, rows))
            if rows is None or not rows.num_rows or _broke_between(job, rows):
                alone.append(job)
        add_those_alone()
        if not tables:
            tables = [_rows_of([])]
        tables = _of_one_type(tables)
        table = pa.concat_tables(tables, promote_options="permissive").combine_chunks()
        return cls(table.column_names, table.num_rows, table.column)

    @classmethod
    def read(cls, path: Path) -> "ResultTable":
        """Opens a results table from a file, and reads each column once to find damage; later, columns are read anew.

        Raises:
            OSError: The file does not exist, or cannot be read.
            ValueError: The file is no table of results.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            there = set(pq.read_schema(path).names)  # tables of early releases have no names of jobs
            # few different ones, which are kept once they are read
            texts = [name for name in (*_columns(), "requirements") if name in there]
            file = pq.ParquetFile(path, read_dictionary=texts)
        except pa.ArrowException as error:
            raise ValueError(f"{path} is no table of results: {error}") from error
        if missing := {*_OF_JOBS, "trial", "seed", "requirements"} - set(file.schema_arrow.names):
            raise ValueError(f"{path} is no table of results: it has no column {min(missing)}")
        try:
            for name in file.schema_arrow.names:
                file.read(columns=[name])  # a damaged page is told now, not in the midst of a report
        except (pa.ArrowException, OSError) as error:
            raise ValueError(f"{path} is damaged: {error}") from error
        kept: dict[str, pa.ChunkedArray] = {}

        def column(name: str) -> pa.ChunkedArray:
            if name in kept:
                return kept[name]
            found = file.read(columns=[name])[name]
            if name in texts:
                kept[name] = found
            return found

        return cls(file.schema_arrow.names, file.metadata.num_rows, column)

    def write(self, path: Path) -> None:
        """Writes the results table to a Parquet file, atomically.

        Raises:
            OSError: The file cannot be written.
        """
        export_table(self.to_arrow(), path)

    def to_arrow(self) -> "pa.Table":
        """Returns the results as an Arrow table; text columns are plain, not dictionary-encoded."""
        import pyarrow as pa

        found = {name: self._column(name) for name in self._all_names}
        return pa.table(
            {
                name: column.cast(column.type.value_type) if pa.types.is_dictionary(column.type) else column
                for name, column in found.items()
            }
        )

    def __len__(self) -> int:
        return self._rows

    @property
    def axes(self) -> list[str]:
        """Names of the axes that some trial of the run has."""
        return list(self._names("axis."))

    @property
    def metrics(self) -> list[str]:
        """Names of the metrics that some trial of the run has."""
        return list(self._names("metric."))

    @property
    def requirements(self) -> list[str]:
        """Names of the requirements that some trial of the run has."""
        return list(self._names("requirement."))

    def values(self, axis: str) -> list[Value | None]:
        """Returns the values of an axis: texts or numbers; `None` where a trial has none."""
        return self._column(f"axis.{axis}").to_pylist()

    def texts(self, column: str) -> list[str | None]:
        """Returns a text column; `None` for empty cells or a missing column."""
        if column not in self._all_names:
            return [None] * len(self)
        return self._column(column).to_pylist()

    def job_names(self) -> list[str | None]:
        """Returns the names of the jobs for people; of a table of an early release, their ids."""
        return self.texts(_NAME if _NAME in self._all_names else "job")

    def codes(self, column: str) -> tuple[NDArray[np.int32], list[str]]:
        """Returns a text column as integer codes, and the list of distinct texts that the codes number.

        Returns:
            Codes of all rows, shape (rows,), -1 for empty cells; and the texts, in which code 0 is the first.
        """
        import pyarrow as pa

        found = self._column(column)
        if not pa.types.is_dictionary(found.type):
            found = found.dictionary_encode()
        encoded = found.unify_dictionaries().combine_chunks()
        whole = encoded.chunk(0) if isinstance(encoded, pa.ChunkedArray) else encoded
        codes = whole.indices.fill_null(-1).to_numpy(zero_copy_only=False).astype(np.int32)
        return codes, whole.dictionary.to_pylist()

    def numbers(self, column: str) -> NDArray[np.float64]:
        """Returns a numeric column; NaN for empty cells or a missing column."""
        if column not in self._all_names:
            return np.full(len(self), np.nan)
        return self._column(column).to_numpy().astype(np.float64)

    def met(self, requirement: str) -> NDArray[np.int8]:
        """Returns for each row whether a requirement was met: 1 met, 0 missed, -1 not judged."""
        import pyarrow as pa

        if f"requirement.{requirement}" not in self._all_names:
            return np.full(len(self), -1, dtype=np.int8)
        found = self._column(f"requirement.{requirement}").cast(pa.int8()).fill_null(-1)
        return found.to_numpy().astype(np.int8)

    def rows_of(self, job: JobRecord) -> range:
        """Returns the numbers of a job's rows, one for each trial; an empty range if the table has none of the job."""
        rows = self._jobs.get((job.step or "", job.label), slice(0, 0))
        return range(rows.start, rows.stop)

    def without(self, jobs: Collection[JobRecord]) -> "ResultTable":
        """Returns the table without the rows of some jobs."""
        if not jobs:
            return self
        import pyarrow as pa

        is_kept = np.ones(len(self), dtype=bool)
        for job in jobs:
            rows = self.rows_of(job)
            is_kept[rows.start : rows.stop] = False
        places = pa.array(np.flatnonzero(is_kept))
        return ResultTable(self._all_names, len(places), cache(lambda name: self._column(name).take(places)))

    def states_of(self, jobs: Iterable[JobRecord], digests: Mapping[str, str]) -> list[str | None]:
        """Returns the digest of all states of each row; `None` if it is in neither the table nor `digests`.

        Args:
            jobs: The jobs of the table.
            digests: Digests of all states of jobs without trials, by label.
        """
        states = self.texts("state_digest")
        for job in jobs:
            for row in self.rows_of(job):
                states[row] = states[row] or digests.get(job.label)
        return states

    @property
    def first_rows(self) -> list[int]:
        """Row number of each job's first trial."""
        return [rows.start for rows in self._jobs.values()]

    @cached_property
    def _jobs(self) -> dict[tuple[str, str], slice]:
        """Rows of each job, by step and job id; requests without a job are numbered within their step."""
        codes, labels = self.codes("job")
        in_steps, steps = self.codes("step")
        is_first = np.diff(codes, prepend=-1).astype(bool) | np.diff(in_steps, prepend=-1).astype(bool)
        starts = np.flatnonzero(is_first).tolist()
        ends = [*starts[1:], len(codes)] if starts else []
        return {
            (steps[in_steps[start]], labels[codes[start]]): slice(start, end)
            for start, end in zip(starts, ends, strict=True)
        }

    def rows_with_errors(self) -> list[int]:
        """Returns the rows of trials in which some requirement could not be judged."""
        return [row for row, text in enumerate(self.texts("requirements")) if '"error":' in (text or "")]

    def requirements_at(self, row: int) -> list[Requirement]:
        """Returns all requirements of one trial, with their limits and units."""
        return _REQUIREMENTS.validate_json(self._column("requirements")[row].as_py() or "[]")

    def axes_at(self, row: int) -> dict[str, Value]:
        """Returns the values of the axes of one trial by name; axes that it does not have are left out."""
        values = ((name, self._column(f"axis.{name}")[row].as_py()) for name in self.axes)
        return {name: value for name, value in values if value is not None}

    def _names(self, prefix: str) -> Iterator[str]:
        return (name.removeprefix(prefix) for name in self._all_names if name.startswith(prefix))


_UNKNOWN_OF_JOBS = dict.fromkeys(("trial", "model_sha256", "digest_looks", "digest_until_s", "recorded"))
"""Columns that a job's record does not contain; they are empty, as a 0 would look like a value."""


def _rows_of(jobs: Sequence[JobRecord]) -> "pa.Table":
    """Returns a table with a row for each of some jobs without trials; columns that jobs do not know are empty."""
    import pyarrow as pa

    axes = {
        name: all(isinstance(job.axes.get(name, 0.0), float | int) for job in jobs)
        for name in dict.fromkeys(name for job in jobs for name in job.axes)
    }
    rows = [
        TrialRow(
            trial=0,
            seed=(job.inputs and job.inputs.seed) or 0,
            verdict=job.verdict or "NONE",
            axes={name: value if axes[name] else value_text(value) for name, value in job.axes.items()},
            reason=job.verdict_reason or job.failure_reason or "",
            failure_code=job.failure_code,
            ended_by=job.ended_by,
            state_digest=job.state_digest,
            wall_time_s=job.duration_s or 0.0,
            requirements=job.requirements,
            metrics=job.metrics,
        )
        for job in jobs
    ]
    names = Names.of(rows, most=sys.maxsize)
    of_jobs = [pa.field(name, pa.string()) for name in _columns()]
    seed_known = [job.inputs is not None and job.inputs.seed is not None for job in jobs]
    columns = [
        {
            **columns_of(row, names),
            **_place(job),
            **_UNKNOWN_OF_JOBS,
            "sim_time_s": job.metrics.get("sim_time_s"),
            "steps": None if (steps := job.metrics.get("steps")) is None else int(steps),
            "seed": row.seed if known else None,
            "outcome": case_outcome(job.status, job.verdict, job.failure_code),
            "output": job.output_uri,
        }
        for job, row, known in zip(jobs, rows, seed_known, strict=True)
    ]
    return pa.Table.from_pylist(columns, pa.schema([*of_jobs, *schema_of(axes, names)]))


def _of_trials(job: JobRecord, trials: "pa.Table") -> "pa.Table":
    """Returns the table of a job's trials, with columns for the job, its axes, and each trial's outcome and folder.

    If the job was cancelled or has not ended, no trial was judged: all get that outcome.
    """
    import pyarrow as pa

    count = trials.num_rows
    of_the_job = case_outcome(job.status, job.verdict, job.failure_code)
    stopped = of_the_job if of_the_job in ("canceled", "unfinished") else None  # then nothing was judged
    outcomes = [stopped or _OUTCOMES.get(verdict or "", "no verdict") for verdict in trials["verdict"].to_pylist()]
    recorded = zip(trials["trial"].to_pylist(), trials["recorded"].to_pylist(), strict=True)
    outputs = [
        f"{job.output_uri}/{trial_folder(number)}" if kept and job.output_uri else None for number, kept in recorded
    ]
    of_job: dict[str, Any] = {
        name: pa.repeat(pa.scalar(value, pa.string()), count) for name, value in _place(job).items()
    }
    of_job |= {"outcome": pa.array(outcomes, pa.string()), "output": pa.array(outputs, pa.string())}
    # Its own axes come first: what a trial itself says of one of that name is nearer to it.
    of_step = {f"axis.{name}": pa.repeat(pa.scalar(value), count) for name, value in job.axes.items()}
    columns = {name: of_job[name] for name in _columns()} | of_step
    columns |= {name: trials[name] for name in trials.column_names}
    return pa.table(columns)


def _of_one_type(tables: Sequence["pa.Table"]) -> list["pa.Table"]:
    """Returns tables in which axes of the same name have one type: text, where some have numbers and some texts."""
    import pyarrow as pa

    types: dict[str, set[Any]] = {}
    for table in tables:
        for field in table.schema:
            if field.name.startswith("axis."):
                types.setdefault(field.name, set()).add(field.type)
    mixed = {name for name, found in types.items() if len(found) > 1}

    def as_text(table: pa.Table) -> pa.Table:
        for name in mixed.intersection(table.column_names):
            texts = [None if value is None else value_text(value) for value in table[name].to_pylist()]
            table = table.set_column(table.column_names.index(name), name, pa.array(texts, pa.string()))
        return table

    return [as_text(table) for table in tables]


def _columns() -> list[str]:
    """Returns the names of the columns about jobs, in their order: the name stands behind the id."""
    after = _OF_JOBS.index("job") + 1
    return [*_OF_JOBS[:after], _NAME, *_OF_JOBS[after:]]


def _place(job: JobRecord) -> dict[str, str | None]:
    return {
        "step": job.step or "",
        "test": job.test or job.label,
        "job": job.label,
        "world": job.inputs.world if job.inputs else None,
        "world_name": job.world_title,
        _NAME: job.title,
    }


def _broke_between(job: JobRecord, trials: "pa.Table") -> bool:
    """Returns whether a job ended with an error, but none of its trials did: its program or machine failed."""
    if case_outcome(job.status, job.verdict, job.failure_code) != "broken":
        return False
    return "ERROR" not in trials["verdict"].to_pylist()
