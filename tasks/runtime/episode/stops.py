"""Stop signals of a run, from outside and from inside."""

from typing import Protocol

from .progress import Phase


class RunStopped(BaseException):
    """Raised in application code that does not return after the run was told to stop.

    Args:
        phase: What was interrupted; None: nothing, the code noticed the stop by itself.
    """

    def __init__(self, phase: Phase | None = None) -> None:
        super().__init__(phase)
        self.phase = phase


class RunEnded(Exception):
    """Raised by an observer that has seen enough; the run ends as one that came to its end by itself."""

    def __init__(self, ended_by: str = "requirements") -> None:
        super().__init__(ended_by)
        self.ended_by = ended_by


class Stop(Protocol):
    """Whether the run was told to stop."""

    @property
    def reason(self) -> str:
        """Why (one of `progress.STOP_REASONS`); empty while it may go on."""
        ...
