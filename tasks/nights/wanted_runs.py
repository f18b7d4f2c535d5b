"""A run that somebody wants: its specification, and everything that the caller asks of it besides."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...schemas.reports.challenge import Challenge
from ...schemas.reports.live_comparison import Against
from ...schemas.reports.run_record import RerunOf
from ...schemas.specs.specification import CheckedSpec

if TYPE_CHECKING:  # The command line makes these objects before it imports Prefect, which takes a second.
    from ..inspection.pipeline_parts import Cut, Permit
    from .open_runs import OpenRun


@dataclass(frozen=True)
class WantedRun:
    """A run to carry out, new or begun by another process."""

    checked: CheckedSpec
    """Specification of the run."""

    spec_path: str
    """Path of the specification's file, as the caller wrote it."""

    command: Sequence[str] = ()
    """Command line that repeats the run; empty: `robomaker run` with the file."""

    reuse: bool = False
    """Whether existing worlds and results of the same inputs are reused."""

    rerun_of: RerunOf | None = None
    """Run that is repeated; `None`: none."""

    cut: "Cut | None" = None
    """Function that changes requests, for a probe or a challenge; `None`: they are unchanged."""

    against: Against | None = None
    """Earlier run with which results are compared until the comparison is decided; `None`: all jobs run."""

    open_run: "OpenRun | None" = None
    """Run that is stored already; `None`: a new id and folder are created."""

    permit: "Permit | None" = None
    """Function that allows or refuses each request; `None`: all are allowed."""

    challenge: Challenge | None = None
    """Sabotages of a challenge, whose jobs `cut` makes; `None`: the run is no challenge."""

    @property
    def repeated_by(self) -> list[str]:
        """Command line that does the same run again."""
        return list(self.command) or ["robomaker", "run", self.spec_path]

    @property
    def is_probe(self) -> bool:
        """Whether only a part of the specification runs: history, comparisons and forecasts leave such a run out."""
        return self.cut is not None
