"""Columns that the tables of a job's trials and of a run's results share."""

import json
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter

from ...schemas.runs.plan import Requirement
from ...schemas.runs.trial_rows import TrialRow

if TYPE_CHECKING:
    import pyarrow as pa

MAX_COLUMNS = 200
"""Maximum number of metrics, and of requirements, that get columns of their own; the first ones do."""

_REQUIREMENTS = TypeAdapter(list[Requirement])


class Names:
    """Names of the metrics and requirements that get columns in a results table."""

    def __init__(self, most: int = MAX_COLUMNS) -> None:
        self._most = most
        self.metrics: dict[str, None] = {}
        self.requirements: dict[str, None] = {}

    @classmethod
    def of(cls, rows: Iterable[TrialRow], most: int = MAX_COLUMNS) -> "Names":
        """Collects the names of metrics and requirements from trials, at most `most` of each, the first that occur."""
        names = cls(most)
        for row in rows:
            names._add(names.metrics, row.metrics)
            names._add(names.requirements, (each.name for each in row.requirements))
        return names

    def _add(self, names: dict[str, None], more: Iterable[str]) -> None:
        for name in more:
            if name not in names and len(names) < self._most:
                names[name] = None


def schema_of(axes: Mapping[str, bool], names: Names) -> "pa.Schema":
    """Returns the Arrow schema of a trials table.

    Args:
        axes: Names of the axes, and whether their values are numbers.
        names: Names of metrics and requirements.
    """
    # Takes a tenth of a second and 40 MB, which only what reads tables should pay.
    import pyarrow as pa

    text, number, whole = pa.string(), pa.float64(), pa.int64()
    return pa.schema(
        [
            *(("trial", whole), ("seed", whole)),
            *((f"axis.{name}", number if is_number else text) for name, is_number in axes.items()),
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


def columns_of(row: TrialRow, names: Names, *, recorded: bool = False) -> dict[str, Any]:
    """Converts a trial to the values of a table row, by column name.

    Args:
        row: The trial.
        names: Metrics and requirements that get columns of their own; others have none.
        recorded: Whether a recording of the trial was kept.
    """
    # Of several of one name, which an environment may report, the one that was missed by most.
    requirements = [each for each in reversed(_worst_first(row.requirements)) if each.name in names.requirements]
    return {
        "trial": row.trial,
        "seed": row.seed,
        **{f"axis.{name}": value for name, value in row.axes.items()},
        "verdict": row.verdict,
        "reason": row.reason,
        "failure_code": row.failure_code,
        "ended_by": row.ended_by,
        "sim_time_s": row.sim_time_s,
        "wall_time_s": row.wall_time_s,
        "steps": row.steps,
        **{f"metric.{name}": value for name, value in row.metrics.items() if name in names.metrics},
        **{f"requirement.{each.name}": _met(each) for each in requirements},
        **{f"margin.{each.name}": each.margin for each in requirements},
        "requirements": _REQUIREMENTS.dump_json(row.requirements, exclude_defaults=True).decode(),
        "state_digest": row.state_digest,
        "model_sha256": row.model_sha256,
        "digest_looks": row.looks,
        "digest_until_s": row.digest_until_s,
        "recorded": recorded,
    }


def read_trials(content: bytes) -> "pa.Table":
    """Reads a table of trials from the bytes of `trials.parquet`.

    Raises:
        ValueError: The bytes are no such table.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return pq.read_table(pa.BufferReader(content))
    except pa.ArrowException as error:
        raise ValueError(f"{len(content)} bytes are no table of trials: {error}") from error


def _worst_first(requirements: Iterable[Requirement]) -> list[Requirement]:
    return sorted(
        requirements,
        key=lambda each: (each.satisfied or not each.counts, each.margin if each.margin is not None else 0.0),
    )


def _met(requirement: Requirement) -> bool | None:
    return requirement.satisfied if requirement.counts and requirement.error is None else None


def named(found: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Returns the values of a table row whose columns begin with a prefix, by the rest of the columns' names."""
    return {
        name.removeprefix(prefix): value
        for name, value in found.items()
        if name.startswith(prefix) and value is not None
    }


def row_of(found: dict[str, Any]) -> TrialRow:
    """Converts the values of a table row back to a trial; the opposite of `columns_of`."""
    return TrialRow(
        trial=found["trial"],
        seed=found["seed"],
        axes=named(found, "axis."),
        verdict=found["verdict"],
        reason=found["reason"],
        failure_code=found["failure_code"],
        ended_by=found["ended_by"],
        sim_time_s=found["sim_time_s"],
        wall_time_s=found["wall_time_s"],
        steps=found["steps"],
        requirements=_REQUIREMENTS.validate_python(json.loads(found["requirements"])),
        metrics=named(found, "metric."),
        state_digest=found["state_digest"],
        model_sha256=found["model_sha256"],
        looks=found["digest_looks"],
        digest_until_s=found["digest_until_s"],
    )
