"""Typed rows of a run's table of results."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Never, TypeVar

from pydantic import TypeAdapter

from ...schemas.reports.run_record import CaseOutcome
from ...schemas.runs.axis_kinds.kind import Value
from ...schemas.runs.plan import Requirement, Verdict
from ...schemas.wire.errors import UnknownNameError
from ...schemas.wire.request_problems import first_words, nearest
from ...tasks.results.columns import named

if TYPE_CHECKING:
    import pyarrow as pa

_Value = TypeVar("_Value")


class NamedValues(dict[str, _Value]):
    """Dictionary of results by name, whose error about a name that it lacks has the names that it has."""

    def __init__(self, noun: str, values: Mapping[str, _Value]) -> None:
        super().__init__(values)
        self._noun = noun

    def __missing__(self, name: str) -> Never:
        """Raises an error about a name without a value.

        Raises:
            UnknownNameError: Always.
        """
        there = f"there are {first_words(sorted(self))}" if self else "there are none"
        raise UnknownNameError(f"there is no {self._noun} {name!r}{nearest(str(name), self)}; {there}")


_REQUIREMENTS = TypeAdapter(list[Requirement])


@dataclass(frozen=True, slots=True)
class ResultRow:
    """Row of the table of results: a trial, a job without trials, or a request that has no job."""

    step: str
    """Name of the step that ordered the job of a result row; empty: unknown."""
    test: str
    """Name of a simulation job, the same in every run of the specification."""
    job: str
    """Id of the job, or `request 3` if the request has no job."""
    job_name: str
    """Name of the job for people, unique in the run: `scout in flat 3`."""
    outcome: CaseOutcome
    """Outcome of a trial or job; only `passed` means that it was judged and met all its requirements."""
    verdict: Verdict
    """Verdict on a trial or job; `NONE` when nothing was judged."""
    reason: str
    """Reason why a trial's verdict is not PASS, or of its error; empty: unknown."""
    failure_code: str | None
    """Failure code of a job; `None`: it did not fail."""
    world: str | None
    """Content hash of the world, the same for the same world in every run; `None`: it has none."""
    world_name: str | None
    """Name of the job's world in this run; `None`: it has none."""
    trial: int | None
    """Number of the trial, from 0; None: the job has no trials."""
    seed: int | None
    """Random seed of the trial; `None`: it never began."""
    ended_by: str
    """Cause of a trial's end, such as `environment` or `duration limit`; empty: unknown."""
    sim_time_s: float | None
    """Simulated time at the end of a trial, in seconds; `None`: unknown."""
    wall_time_s: float
    """Duration of a trial or job, in seconds."""
    output: str | None
    """Address of a trial's outputs, `file:///…` or `s3://…`; `None`: it has none of its own."""
    axes: Mapping[str, Value]
    """Values of a trial's varied parameters (axes), by name."""
    metrics: Mapping[str, float]
    """Metrics of a trial: numbers by name with unit, such as `distance_m`."""
    requirements: list[Requirement]
    """Requirements that a trial was judged by, with limits, values and margins."""


def rows_of(table: "pa.Table") -> list[ResultRow]:
    """Returns the rows of a table of results, in its order."""
    return [_row_of(found) for found in table.to_pylist()]


def _row_of(found: Mapping[str, Any]) -> ResultRow:
    metrics = NamedValues("metric", named(found, "metric."))
    return ResultRow(
        step=found["step"] or "",
        test=found["test"] or "",
        job=found["job"] or "",
        job_name=found.get("job_name") or found["test"] or "",  # tables of early releases have no names for people
        outcome=found["outcome"],
        verdict=found["verdict"] or "NONE",
        reason=found["reason"] or "",
        failure_code=found["failure_code"],
        world=found["world"],
        world_name=found["world_name"],
        trial=found["trial"],
        seed=found["seed"],
        ended_by=found["ended_by"] or "",
        # Of a job without trials its metrics alone say it.
        sim_time_s=metrics.get("sim_time_s") if found["trial"] is None else found["sim_time_s"],
        wall_time_s=found["wall_time_s"] or 0.0,
        output=found["output"],
        axes=NamedValues("axis", named(found, "axis.")),
        metrics=metrics,
        requirements=_REQUIREMENTS.validate_json(found["requirements"] or "[]"),
    )
