"""`trials.parquet`: a row for each trial, in groups of rows, which are all that is in memory at a time."""

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter

from ....schemas.runs.plan import Requirement
from ....schemas.runs.trial_rows import TrialRow
from ....schemas.runs.trials import Trials
from .journal import read_journal

if TYPE_CHECKING:
    import pyarrow as pa

ROWS_IN_GROUP = 2000
MAX_COLUMNS = 200
"""How many metrics, and how many requirements, get columns of their own; those that came first."""

_COMPRESSION = "zstd"
_REQUIREMENTS = TypeAdapter(list[Requirement])


def write_table(journal: Path, path: Path, trials: Trials, recorded: set[int]) -> int:
    """Makes the table from a journal; it is either whole or not there.

    | column | what |
    | --- | --- |
    | `trial`, `seed` | its numbers |
    | `verdict`, `reason`, `failure_code`, `ended_by` | as in `TrialRow` |
    | `sim_time_s`, `wall_time_s`, `steps` | as in `TrialRow` |
    | `parameter.NAME` | a column for each parameter |
    | `metric.NAME` | a column for each metric; empty where a trial has none of that name |
    | `requirement.NAME`, `margin.NAME` | whether the requirement was met, and by how much |
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

    names = _Names.of(journal)
    schema = _schema(pa, list(trials.parameters or ()), names)
    unfinished = path.with_name(f".{path.name}.unfinished")
    unfinished.unlink(missing_ok=True)
    count, rows = 0, read_journal(journal)
    with unfinished.open("xb") as file, pq.ParquetWriter(file, schema, compression=_COMPRESSION) as writer:
        while group := list(islice(rows, ROWS_IN_GROUP)):
            columns = [_plain(row, names, recorded) for row in group]
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
                    return _row(found)
                before += rows
    except (pa.ArrowException, KeyError, TypeError) as error:
        raise ValueError(f"{path} is no table of trials: {error}") from error
    return None


class _Names:
    """The names that columns are made for."""

    def __init__(self) -> None:
        self.metrics: dict[str, None] = {}
        self.requirements: dict[str, None] = {}

    @classmethod
    def of(cls, journal: Path) -> "_Names":
        names = cls()
        for row in read_journal(journal):
            _add(names.metrics, row.metrics)
            _add(names.requirements, (each.name for each in row.requirements))
        return names


def _add(names: dict[str, None], more: Any) -> None:
    for name in more:
        if name not in names and len(names) < MAX_COLUMNS:
            names[name] = None


def _schema(pa: Any, parameters: list[str], names: _Names) -> "pa.Schema":
    text, number, whole = pa.string(), pa.float64(), pa.int64()
    return pa.schema(
        [
            *(("trial", whole), ("seed", whole)),
            *((f"parameter.{name}", text) for name in parameters),
            *(("verdict", text), ("reason", text), ("failure_code", text), ("ended_by", text)),
            *(("sim_time_s", number), ("wall_time_s", number), ("steps", whole)),
            *((f"metric.{name}", number) for name in names.metrics),
            *(
                column
                for name in names.requirements
                for column in ((f"requirement.{name}", pa.bool_()), (f"margin.{name}", number))
            ),
            *(
                ("requirements", text),
                ("state_digest", text),
                ("model_sha256", text),
                ("digest_looks", whole),
                ("digest_until_s", number),
            ),
            ("recorded", pa.bool_()),
        ]
    )


def _plain(row: TrialRow, names: _Names, recorded: set[int]) -> dict[str, Any]:
    requirements = [each for each in row.requirements if each.name in names.requirements]
    return {
        "trial": row.trial,
        "seed": row.seed,
        **{f"parameter.{name}": value for name, value in row.parameters.items()},
        "verdict": row.verdict,
        "reason": row.reason,
        "failure_code": row.failure_code,
        "ended_by": row.ended_by,
        "sim_time_s": row.sim_time_s,
        "wall_time_s": row.wall_time_s,
        "steps": row.steps,
        **{f"metric.{name}": value for name, value in row.metrics.items() if name in names.metrics},
        **{f"requirement.{each.name}": each.satisfied for each in requirements},
        **{f"margin.{each.name}": each.margin for each in requirements},
        "requirements": _REQUIREMENTS.dump_json(row.requirements, exclude_defaults=True).decode(),
        "state_digest": row.state_digest,
        "model_sha256": row.model_sha256,
        "digest_looks": row.looks,
        "digest_until_s": row.digest_until_s,
        "recorded": row.trial in recorded,
    }


def _row(found: dict[str, Any]) -> TrialRow:
    def named(prefix: str) -> Iterator[tuple[str, Any]]:
        return (
            (name.removeprefix(prefix), value)
            for name, value in found.items()
            if name.startswith(prefix) and value is not None
        )

    return TrialRow(
        trial=found["trial"],
        seed=found["seed"],
        parameters=dict(named("parameter.")),
        verdict=found["verdict"],
        reason=found["reason"],
        failure_code=found["failure_code"],
        ended_by=found["ended_by"],
        sim_time_s=found["sim_time_s"],
        wall_time_s=found["wall_time_s"],
        steps=found["steps"],
        requirements=_REQUIREMENTS.validate_python(json.loads(found["requirements"])),
        metrics=dict(named("metric.")),
        state_digest=found["state_digest"],
        model_sha256=found["model_sha256"],
        looks=found["digest_looks"],
        digest_until_s=found["digest_until_s"],
    )
