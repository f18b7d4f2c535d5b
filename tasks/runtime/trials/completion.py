"""Results of trials: a journal while they run, a table and `result.json` at the end."""

from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from pydantic import ValidationError

from ....schemas.runs.plan import RunPlan, RunResult
from ....schemas.runs.trial_rows import TRIALS_FILE, TRIALS_FOLDER, TrialRow
from ....schemas.runs.trials import Trials
from ...files.untrusted_files import open_left, written_anew
from ...results.columns import Names, columns_of, row_of, schema_of
from ..episode.run_results import RESULT_FILE, versions, write_result
from .tally import Tally

JOURNAL_FILE = "trials.jsonl"
_MAX_LINE_BYTES = 1024 * 1024

TakeRow = Callable[[TrialRow], None]
"""Function that receives one trial's results."""


def journal_path(plan: RunPlan) -> Path:
    """Returns the path of the journal in which a run's finished trials are stored."""
    return (plan.checkpoint_dir or plan.work_dir) / JOURNAL_FILE


def read_journal(path: Path) -> Iterator[TrialRow]:
    """Yields the finished trials from a journal, up to the first damaged row.

    Raises:
        OSError: The file cannot be read, or is a link or not a regular file.
    """
    for row, _ in _rows(path):
        yield row


class TrialJournal:
    """Journal file to which each finished trial is appended; its rows survive a killed process."""

    def __init__(self, path: Path, take: TakeRow) -> None:
        """Opens a journal, to append after its last complete row.

        Args:
            path: Path of the file; it is created with its folder if missing.
            take: Called with each row that the journal already has.

        Raises:
            OSError: The journal cannot be read or written.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        self.rows, size_bytes = 0, 0
        """Number of trials in the journal."""
        for row, end in _rows(path):
            take(row)
            self.rows, size_bytes = self.rows + 1, end
        self._file = path.open("ab", buffering=0)
        self._file.truncate(size_bytes)

    def append(self, row: TrialRow) -> None:
        """Appends a finished trial's row to the journal file.

        Raises:
            OSError: The row cannot be written, such as on a full disk.
        """
        line = row.model_dump_json(exclude_defaults=True).encode() + b"\n"
        if self._file.write(line) != len(line):
            raise OSError(f"{self._file.name} cannot be written to its end; the disk may be full")
        self.rows += 1

    def close(self) -> None:
        """Closes the journal file."""
        self._file.close()


def _rows(path: Path) -> Iterator[tuple[TrialRow, int]]:
    """Yields the rows of a trials journal, each with the byte offset of its end, up to the first damaged line.

    Yields none if there is no journal.
    """
    try:
        file = open_left(path)
    except FileNotFoundError:
        return
    place = 0
    with file:
        for number, line in enumerate(iter(lambda: file.readline(_MAX_LINE_BYTES), b"")):
            try:
                row = TrialRow.model_validate_json(line)
            except ValidationError:  # cut off by a kill, or an application wrote to it
                return
            if row.trial != number or not line.endswith(b"\n"):
                return
            place += len(line)
            yield row, place


ROWS_IN_GROUP = 2000

_COMPRESSION = "zstd"


def write_table(journal: Path, path: Path, trials: Trials, recorded: set[int]) -> int:
    """Makes the trials table (Parquet) from a journal, atomically.

    | column | what |
    | --- | --- |
    | `trial`, `seed` | its numbers |
    | `verdict`, `reason`, `failure_code`, `ended_by` | as in `TrialRow` |
    | `sim_time_s`, `wall_time_s`, `steps` | as in `TrialRow` |
    | `axis.NAME` | its value of each axis: text of a variable, else a number; empty: it is as built |
    | `metric.NAME` | a column for each metric; empty where a trial has none of that name |
    | `requirement.NAME`, `margin.NAME` | whether it was met, and by how much; empty: it did not count, or broke |
    | `requirements` | all of them, as JSON |
    | `state_digest`, `model_sha256`, `digest_looks`, `digest_until_s` | what `robomaker verify` compares |
    | `recorded` | whether it has a folder of outputs |

    Args:
        journal: Path of the journal.
        path: Path of the table.
        trials: The job's trials.
        recorded: Numbers of the trials that have an output folder.

    Returns:
        Number of rows in the table.

    Raises:
        OSError: The journal cannot be read or the table cannot be written.
    """
    # Takes a tenth of a second and 40 MB, which only jobs with trials should pay.
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = Names.of(read_journal(journal))
    schema = schema_of({name: axis.is_number for name, axis in (trials.axes or {}).items()}, names)
    count, rows = 0, read_journal(journal)
    with written_anew(path) as file, pq.ParquetWriter(file, schema, compression=_COMPRESSION) as writer:
        while group := list(islice(rows, ROWS_IN_GROUP)):
            columns = [columns_of(row, names, recorded=row.trial in recorded) for row in group]
            writer.write_table(pa.Table.from_pylist(columns, schema), row_group_size=ROWS_IN_GROUP)
            count += len(group)
    return count


def read_row(path: Path, number: int) -> TrialRow | None:
    """Reads one trial from a trials table; `None` if there is no such trial.

    Raises:
        FileNotFoundError: The file does not exist.
        ValueError: The file is no table of trials.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as table:
            before = 0
            for group in range(table.num_row_groups):
                rows = table.metadata.row_group(group).num_rows
                if before <= number < before + rows:
                    [found] = table.read_row_group(group).slice(number - before, 1).to_pylist()
                    return row_of(found)
                before += rows
    except (pa.ArrowException, KeyError, TypeError) as error:
        raise ValueError(f"{path} is no table of trials: {error}") from error
    return None


ALL_RAN = "environment"
"""Cause of the end of a job whose trials all ran, as in `RunResult.ended_by`."""


def complete_trials(plan: RunPlan, ended_by: str, tally: Tally | None = None) -> RunResult:
    """Writes the trials table and `result.json` of a job from its finished trials.

    Args:
        plan: Plan of the job's run, which has trials.
        ended_by: Cause of the run's end; ignored if all trials ran.
        tally: Counts of the journal's rows; absent: they are read.

    Returns:
        The result.

    Raises:
        OSError: The journal cannot be read, or the outputs cannot be written.
    """
    assert plan.trials is not None
    if tally is None:
        tally = Tally(plan.trials)
        for row in read_journal(journal_path(plan)):
            tally.take(row)
    recorded = recorded_trials(plan.output_dir)
    write_table(journal_path(plan), plan.output_dir / TRIALS_FILE, plan.trials, set(recorded))
    result = tally.result(ALL_RAN if tally.is_whole else ended_by, plan.seed, versions(), recorded)
    write_result(result, plan.output_dir)
    return result


def complete_after_all(plan: RunPlan, *, ended_by: str | None) -> None:
    """Writes the trials table and result if the run's process died before it could.

    Args:
        plan: Plan of the job's run, which has trials; its processes have all ended.
        ended_by: Cause of the run's end; None: it failed, and gets no result.

    Raises:
        OSError: The table or the result cannot be written.
    """
    assert plan.trials is not None
    table, result = plan.output_dir / TRIALS_FILE, plan.output_dir / RESULT_FILE
    if ended_by is not None and not result.exists():
        complete_trials(plan, ended_by)
    elif not table.exists():
        write_table(journal_path(plan), table, plan.trials, set(recorded_trials(plan.output_dir)))


def recorded_trials(output_dir: Path) -> list[int]:
    """Returns the numbers of the trials that have an output folder of their own, in order."""
    folder = output_dir / TRIALS_FOLDER
    if not folder.is_dir():
        return []
    return sorted(int(path.name) for path in folder.iterdir() if path.name.isdigit())
