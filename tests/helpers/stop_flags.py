"""Whether a run was told to stop, for tests that drive parts of the runtime themselves."""

from dataclasses import dataclass


@dataclass
class StopFlag:
    """A `Stop` of the runtime that a test sets."""

    reason: str = ""
