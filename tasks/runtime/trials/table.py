"""`trials.parquet`: a row for each trial, in groups of rows, which are all that is in memory at a time."""

from itertools import islice
from pathlib import Path

from ....schemas.runs.trial_rows import TrialRow
from ....schemas.runs.trials import Trials
from ...results.columns import Names, columns_of, row_of, schema_of
from .journal import read_journal

ROWS_IN_GROUP = 2000

_COMPRESSION = "zstd"


def write_table(journal: Path, path: Path, trials: Trials, recorded: set[int]) -> int:
    """Makes the table from a journal; it is either whole or not there.

    | column | what |
    | --- | --- |
    | `trial`, `seed` | its numbers |
    | `verdict`, `reason`, `failure_code`, `ended_by` | as in `TrialRow` |
    | `sim_time_s`, `wall_time_s`, `steps` | as in `TrialRow` |
    | `parameter.NAME` | a column for each parameter |
    | `metric.NAME` | a column for each metric; empty where a trial has none of that name |
    | `requirement.NAME`, `margin.NAME` | whether it was met, and by how much; empty: it did not count, or broke |
    | `requirements` | all of them, as JSON |
    | `state_digest`, `model_sha256`, `digest_looks`, `digest_until_s` | what `robomaker verify` compares |
    | `recorded` | whether it has a folder of outputs |

    Args:
        journal: The rows.
        path: The file to write.
        trials: The job's trials.
        recorded: Numbers of trials that have a folder.

    Returns:
        How many rows it has.

    Raises:
        OSError: The journal cannot be read or the table cannot be written.
    """
    # Takes a tenth of a second and 40 MB, which only jobs with trials should pay.
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = Names.of(read_journal(journal))
    schema = schema_of(list(trials.parameters or ()), names)
    unfinished = path.with_name(f".{path.name}.unfinished")
    unfinished.unlink(missing_ok=True)
    count, rows = 0, read_journal(journal)
    with unfinished.open("xb") as file, pq.ParquetWriter(file, schema, compression=_COMPRESSION) as writer:
        while group := list(islice(rows, ROWS_IN_GROUP)):
            columns = [columns_of(row, names, recorded=row.trial in recorded) for row in group]
            writer.write_table(pa.Table.from_pylist(columns, schema), row_group_size=ROWS_IN_GROUP)
            count += len(group)
    unfinished.replace(path)
    return count


def read_row(path: Path, number: int) -> TrialRow | None:
    """Reads the row of one trial; `None`: the table has none of that number.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is no table of trials.
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
