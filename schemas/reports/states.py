"""How runs and jobs end, in the words of reports."""

from typing import Literal

RunState = Literal["succeeded", "failed", "broken", "canceled", "timed out"]
"""How a run of a specification ended as a whole."""

CaseOutcome = Literal["broken", "failed", "canceled", "unfinished", "no verdict", "passed"]
"""The outcome of one job."""
