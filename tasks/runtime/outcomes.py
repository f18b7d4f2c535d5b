"""How a run's end is judged: Completed, Failed with whose fault and why, or Canceled."""

import signal
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ...schemas.simulation_run import ApplicationRole, RunPlan
from .progress import Phase

MAX_REASON_CHARACTERS = 1024
_MAX_HEAD_CHARACTERS = 600
_MAX_TAIL_LINES = 12
_BATCH_TIMEOUT = "timed out (batch)"
_CRASH_CODES: dict[ApplicationRole | None, str] = {
    "robot": "RobotApplicationCrash",
    "simulation": "SimulationApplicationCrash",
    None: "InternalServiceError",
}


@dataclass(frozen=True)
class Exit:
    """How a run's process ended, as its supervisor saw it."""

    exit_code: int | None
    signal: int | None
    phase: Phase
    report: dict[str, Any]

    @property
    def ended_by(self) -> str | None:
        """What ended the loop of a run that finished its outputs; None for others."""
        return self.report.get("ended_by") if self.exit_code == 0 else None


@dataclass(frozen=True)
class Judgement:
    """The part of a `RunOutcome` that has to be decided."""

    status: Literal["Completed", "Failed", "Canceled"]
    failure_code: str | None = None
    failure_reason: str | None = None
    timed_out: bool = False


def judge(
    ended: Exit | None, stopped_for: str | None, plan: RunPlan, log: tuple[str, Sequence[str]] = ("", ())
) -> Judgement:
    """Decides how a run ended.

    Args:
        ended: The end of its process; None when its supervisor disappeared without a word.
        stopped_for: Why it was stopped: `duration limit`, or what the caller's `stop` said; None when it
            ended by itself.
        plan: The run.
        log: Name and last lines of its log.

    Returns:
        The judgement. A run that was told to stop but had already ended by itself is judged by that.
    """
    if ended is not None and ended.ended_by in ("environment", "agent", "requirements"):
        return Judgement("Completed")
    if stopped_for == "duration limit":
        return Judgement("Completed", timed_out=True)
    if stopped_for is not None:
        code = "BatchTimedOut" if stopped_for == _BATCH_TIMEOUT else None
        return Judgement("Canceled", code, f"The run was stopped: {stopped_for}.")
    if ended is None:
        reason = "The run's supervising process disappeared, perhaps killed for want of memory."
        return Judgement("Failed", "InternalServiceError", failure_reason(reason, *log))
    phase = Phase(ended.report.get("phase", ended.phase))
    reason = f"{_who(phase, plan)} failed in {phase.activity}: {_what(ended)}"
    # An application that refuses to run on purpose (`LaunchError`) says what kind of failure that is.
    code = ended.report.get("code", _CRASH_CODES[phase.role])
    return Judgement("Failed", code, failure_reason(reason, *log))


def failure_reason(head: str, log_name: str, lines: Sequence[str]) -> str:
    """Returns a reason of at most 1024 characters that ends with as many last log lines as fit."""
    if len(head) > _MAX_HEAD_CHARACTERS:
        head = head[: _MAX_HEAD_CHARACTERS - 1] + "…"
    if not lines:
        return head
    title = f"\nLast lines of {log_name}:"
    room = MAX_REASON_CHARACTERS - len(head) - len(title)
    kept: list[str] = []
    for line in reversed(lines[-_MAX_TAIL_LINES:]):
        if len(line) + 1 > room:
            if not kept:
                kept.append("…" + line[-(room - 2) :])
            break
        kept.append(line)
        room -= len(line) + 1
    return "\n".join([head + title, *reversed(kept)])


def _who(phase: Phase, plan: RunPlan) -> str:
    if phase.role is None:
        return "The runtime"
    if phase.role == "robot":
        name = plan.robot_application.name if plan.robot_application else "scout"
        return f"Robot application {name}"
    name = plan.simulation_application.name if plan.simulation_application else "indoor-navigation"
    return f"Simulation application {name}"


def _what(ended: Exit) -> str:
    if "error" in ended.report:
        return ended.report["error"]
    if ended.signal is not None:
        return f"killed by {_signal_name(ended.signal)}"
    return f"the process ended itself with exit code {ended.exit_code} before the run was over"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
