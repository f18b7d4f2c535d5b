"""Run of a specification, ended or not, with its jobs, worlds and table of results."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from ...schemas.extras import how_to_add
from ...schemas.reports.causes import Why
from ...schemas.reports.names import short_name, unique_world_names
from ...schemas.reports.run_record import CaseOutcome, JobRecord, RunRecord
from ...schemas.reports.run_states import counts_in_words, meaning_of
from ...schemas.specs.parameter_values import values_in_words
from ...tasks.causes.stored import read_why
from ...tasks.nights.run_standings import RunOutcome, StandingRun, table_of
from ...tasks.service.references import names_of_worlds
from ...tasks.service.service import Service
from .html import badge, card, line, table
from .jobs import Job
from .rows import ResultRow, rows_of
from .worlds import World

if TYPE_CHECKING:
    import pandas as pd  # pyright: ignore[reportMissingImports] - only who calls `to_pandas` needs it
    import pyarrow as pa


_MOST_SHOWN = 40
"""Limit of the jobs in a notebook's table, as in the summary on a terminal."""
_MOST_OF_REASON = 240
"""Limit of the characters of a reason in that table; the job's own card has all of it."""

_RANKS = {outcome: rank for rank, outcome in enumerate(get_args(CaseOutcome))}


@dataclass(frozen=True)
class Run:
    """A run of a specification.

    `passed` says whether all of it is well; a run is neither true nor false by itself.
    """

    _standing: StandingRun = field(repr=False)
    _service: Service = field(repr=False, compare=False)

    @property
    def id(self) -> str:
        """Id of the specification's run."""
        return self._standing.run_id

    @property
    def name(self) -> str:
        """Name of the specification."""
        return self._standing.name

    @property
    def outcome(self) -> RunOutcome:
        """Outcome of the whole run; or `running`, or `broken off` if its process died before it had ended."""
        return self._standing.outcome

    @property
    def has_ended(self) -> bool:
        """Whether the run had ended, with any outcome, when this object was made; a run whose process died has not.

        Call `results` again for its current state.
        """
        return self._standing.has_ended

    @property
    def passed(self) -> bool:
        """Whether the run succeeded and has jobs, each of which was judged and passed."""
        return self._standing.passed

    @property
    def exit_code(self) -> int | None:
        """Exit code that `robomaker run` would return for the run; `None`: it has not ended."""
        return self.record.exit_code if self.record else None

    @property
    def meaning(self) -> str:
        """Meaning of the exit code in words: what went wrong, or the result of `--against`, or of a challenge.

        A run that has not ended says so.
        """
        if self.record is not None:
            return meaning_of(self.record)
        return "it has not ended" if self.outcome == "running" else "its process died before it had ended"

    @property
    def record(self) -> RunRecord | None:
        """Record of the run: steps, versions, commit, times and more; `None`: it has not ended."""
        return self._standing.record

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Values of the specification's parameters."""
        told = self.record or self._standing.order
        return dict(told.parameters) if told else {}

    @property
    def started_at(self) -> datetime | None:
        """Start time of the run in UTC; `None`: not known yet."""
        told = self.record or self._standing.order
        return told.started_at if told else None

    @property
    def folder(self) -> Path:
        """Folder of the run with its record, specification, report and table of results."""
        return self._standing.folder

    @property
    def report(self) -> Path | None:
        """Path of the run's HTML report; `None`: there is none, or none yet."""
        path = self.folder / "report.html"
        return path if path.is_file() else None

    @property
    def why(self) -> Why | None:
        """Groups of its failures with what they go with; None: no trial failed, or it has not ended."""
        return read_why(self.folder)

    @property
    def known_notes(self) -> list[str]:
        """Known failures that did not occur or whose day is over, and jobs that are red all the same, in words."""
        return list(self.record.known_notes) if self.record else []

    @property
    def problems(self) -> dict[str, str]:
        """Reasons why steps of the run failed, by step."""
        return {step.name: step.error for step in self._standing.steps if step.error}

    @cached_property
    def jobs(self) -> list[Job]:
        """Simulation jobs of the run, and requests without a job, in the order of the requests."""
        return [Job(job, self._world_of(job), self._service) for job in self._standing.jobs]

    @cached_property
    def worlds(self) -> list[World]:
        """Worlds that the run made or used, each once."""
        made = [
            arn
            for step in self._standing.steps
            if step.operation == "CreateWorldGenerationJob"
            for arn in step.output.get("finishedWorldsSummary", {}).get("succeededWorlds", [])
        ]
        driven = {job.world.arn: job.world for job in self.jobs if job.world}
        names = unique_world_names(self._names_of_worlds(made) | {arn: world.name for arn, world in driven.items()})
        return [World(arn, names[arn], self._service) for arn in dict.fromkeys([*made, *driven])]

    def _names_of_worlds(self, arns: Sequence[str]) -> dict[str, str]:
        """Returns the names of worlds for people by ARN; those that are deleted have their ids."""
        return {arn: short_name(arn) for arn in arns} | names_of_worlds(arns, self._service)

    @cached_property
    def rows(self) -> list[ResultRow]:
        """Rows of the table of results: one for each trial, and for each job without trials.

        Jobs that broke, were canceled or never came of their requests have rows, too.
        """
        return rows_of(self.to_arrow())

    def to_arrow(self) -> "pa.Table":
        """Returns the table of results as an Arrow table; docs/notebooks.md has its columns."""
        return self._table

    def to_pandas(self) -> "pd.DataFrame":
        """Returns the table of results as a data frame of pandas.

        Raises:
            ImportError: Pandas is not installed, or cannot be loaded.
        """
        try:
            import pandas  # noqa: F401 # pyright: ignore[reportMissingImports, reportUnusedImport]
        except ImportError as error:
            add = f"`{how_to_add('pandas')}`, or use to_arrow()"
            is_absent = isinstance(error, ModuleNotFoundError) and error.name == "pandas"
            why = f"which is not installed: {add}" if is_absent else f"which cannot be loaded: {error}; use to_arrow()"
            raise ImportError(f"to_pandas() needs pandas, {why}", name="pandas") from error
        return self._table.to_pandas()

    @cached_property
    def _table(self) -> "pa.Table":
        return table_of(self._standing, self._service).to_arrow()

    def _world_of(self, job: JobRecord) -> World | None:
        if job.world is None:
            return None
        arn = job.world if job.world.startswith("arn:") else self._service.arn("world", job.world)
        return World(arn, job.world_name or short_name(arn), self._service)

    def __bool__(self) -> bool:
        """Raises an error if a run is used as a truth value, as a failed run would be true.

        Raises:
            TypeError: Always.
        """
        raise TypeError(f"{self.id} is neither true nor false; ask whether it .passed, or for its .outcome")

    def __repr__(self) -> str:
        """Describes the run's state in one line."""
        return f"<Run {self.id}: {self._standing.in_words()}>"

    def _repr_html_(self) -> str:
        worst_first = sorted(self.jobs, key=lambda job: _RANKS[job.outcome])
        rows = [(job.title, badge(job.outcome), job.id, _in_a_line(job.reason)) for job in worst_first[:_MOST_SHOWN]]
        more = f"and {len(worst_first) - len(rows)} more; .jobs has all" if len(worst_first) > len(rows) else ""
        return str(
            card(
                self.id,
                self._standing.shown_state,
                line(f"{counts_in_words(self._standing.jobs) or 'no simulation jobs'}; {self.meaning}"),
                line(f"with {values_in_words(self.parameters)}" if self.parameters else ""),
                line(f"why: {self.why.headline}" if self.why and self.why.headline else ""),
                table((), list(self.problems.items())),
                table(("job", "outcome", "id", "reason"), rows, more),
            )
        )


def _in_a_line(reason: str) -> str:
    """Returns the first line of a reason; its other lines may be the end of a log."""
    first = next(iter(reason.strip().splitlines()), "")
    return first if len(first) <= _MOST_OF_REASON else f"{first[: _MOST_OF_REASON - 1]}…"
