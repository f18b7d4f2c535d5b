"""Outcomes of runs: status, failure code and reason, decided from how the processes ended."""

import os
import signal
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from ....schemas.runs.plan import ApplicationRole, RunPlan
from ....schemas.runs.programs import RunStop, ToolEnds
from ....schemas.wire.common import without_escapes
from ...files.untrusted_files import files_below
from ..episode.progress import Phase
from ..limits.disk_use import disk_meter

MAX_REASON_CHARACTERS = 1024
_MAX_HEAD_CHARACTERS = 600
_LINE_END = 300
"""Number of characters that are kept from the end of a too long last log line."""
_MAX_TAIL_LINES = 12
OFTEN = 3
"""Number of ends from which a failure's reason names a tool."""
ENDS_BY_THEMSELVES = ("environment", "agent", "requirements", "application")
"""Causes for which a run ends without being stopped from outside, as in `RunResult.ended_by`."""
_CRASH_CODES: dict[ApplicationRole | None, str] = {
    "robot": "RobotApplicationCrash",
    "simulation": "SimulationApplicationCrash",
    None: "InternalServiceError",
}


@dataclass(frozen=True)
class Crash:
    """Crash of a run's program: its role, and how it ended unexpectedly or which limit it exceeded."""

    role: ApplicationRole
    """Role of the application that crashed or that the program belongs to."""

    what: str
    """Description of the process's end: `exited with code 3`."""

    program: str | None = None
    """Name of the program; None: the run's process."""

    is_tool: bool = False


@dataclass(frozen=True)
class Exit:
    """End of a run, as its supervisor observed it."""

    exit_code: int | None
    """Exit code of the run's process; 0 if the run has no such process and ended by itself."""

    signal: int | None
    phase: Phase
    report: dict[str, Any]
    crash: Crash | None = None
    """Crash of another program, which takes precedence over the run's process."""

    tools: Sequence[ToolEnds] = ()
    """Tools that ended and were restarted."""

    trial: int | None = None
    """Number of the trial that the run's process was in; None: there are no trials, or all have finished."""

    cpu_time_s: float | None = None
    """CPU time of all processes of the run in seconds; None: not known yet."""

    steps: int = 0
    """Number of finished steps of the episode."""

    sim_time_s: float = 0.0
    """Last simulated time of the run's process, in seconds."""

    judges: bool = False
    """Whether the environment judges its run, or has requirements."""

    logged_bytes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """Sizes of programs' logs of output and errors, by program, when these were told to end: the rest is about that."""

    @property
    def ended_by(self) -> str | None:
        """Cause of the simulation loop's end if the run completed its outputs, else `None`."""
        return self.report.get("ended_by") if self.exit_code == 0 else None

    def to_message(self) -> dict[str, Any]:
        """Returns the object as plain values, to be sent to the launcher."""
        return {**asdict(replace(self, tools=())), "tools": [tool.model_dump() for tool in self.tools]}

    @classmethod
    def from_message(cls, message: dict[str, Any]) -> "Exit":
        """Returns the object of the plain values that `to_message` made."""
        read = {
            "phase": Phase(message["phase"]),
            "crash": Crash(**message["crash"]) if message["crash"] else None,
            "tools": [ToolEnds.model_validate(tool) for tool in message["tools"]],
        }
        return cls(**{**message, **read})


@dataclass(frozen=True)
class Outcome:
    """Decided outcome of a run: status, failure code and reason."""

    status: Literal["Completed", "Failed", "Canceled"]
    failure_code: str | None = None
    failure_reason: str | None = None
    timed_out: bool = False


def decide_outcome(
    ended: Exit | None,
    stopped_for: RunStop | None,
    plan: RunPlan,
    log: tuple[str, Sequence[str]] = ("", ()),
    advice: str = "",
) -> Outcome:
    """Returns the outcome of a run (status, failure code and reason), decided from its end.

    Args:
        ended: Observed end of the run; None if its supervisor disappeared without a message.
        stopped_for: Reason for which the run was stopped; None if it ended by itself.
        plan: Plan of the run.
        log: Name and last lines of its log.
        advice: End of the sentence on a failure: what would help.

    Returns:
        The outcome. When a run was told to stop but had already ended by itself or crashed, that end counts.
    """
    if ended is not None and ended.crash is not None:
        where = _in_trial(ended) if ended.crash.program is None else ""
        told = f"{where}{_when(ended)}{advice}{_about_tools(ended, plan)}"
        head = f"{_subject(ended.crash, plan)} {ended.crash.what}{told}"
        return Outcome("Failed", _CRASH_CODES[ended.crash.role], failure_reason(head, *log))
    if ended is not None and (ended.ended_by in ENDS_BY_THEMSELVES or (ended.ended_by and plan.is_rerun)):
        return Outcome("Completed")  # a rerun ends by itself where the run was stopped
    if stopped_for == RunStop.DURATION_LIMIT and not (ended is not None and never_connected(ended)):
        return Outcome("Completed", timed_out=True)
    if stopped_for not in (None, RunStop.DURATION_LIMIT):
        return Outcome("Canceled", failure_reason=f"The run was stopped: {stopped_for}.")
    if ended is None:
        reason = "The run's supervising process disappeared, perhaps killed for want of memory."
        return Outcome("Failed", "InternalServiceError", failure_reason(reason, *log))
    phase = Phase(ended.report.get("phase", ended.phase))
    # An application that refuses to run on purpose (`LaunchError`) says what kind of failure that is.
    code = ended.report.get("code", _CRASH_CODES[phase.role])
    if code == "InvalidBundleRobotApplication":
        # The environment finds it when it puts the application's robot into the world.
        reason = f"{_application('robot', plan)} has no robot that can be used: {_what(ended)}"
    elif code == "InvalidInput" and phase.role is None:
        reason = _what(ended)  # the request's fault, not the runtime's
    else:
        when = _when(ended) if phase in (Phase.AGENT, Phase.STEP) else ""
        told = f"{when}: {_what(ended)}{advice}{_about_tools(ended, plan)}"
        reason = f"{_who(phase, plan)} failed in {phase.activity}{told}"
    if "code" in ended.report:
        name, lines = log
        log = (name, [line for line in lines if line.strip() not in reason])  # the log has the same sentence
    return Outcome("Failed", code, failure_reason(reason, *log))


def never_connected(ended: Exit) -> bool:
    """Whether the robot program never connected to the simulation."""
    return ended.report.get("code") == "RobotApplicationHealthCheckFailure"


def was_killed(ended: Exit | None, stopped_for: RunStop | None) -> bool:
    """Whether a run was killed from outside, for example for lack of memory.

    Args:
        ended: Observed end of the run; None if its supervisor disappeared without a message.
        stopped_for: Reason for which the run was stopped; None if it ended by itself.
    """
    if stopped_for is not None:
        return False
    return ended is None or (ended.crash is None and ended.signal == signal.SIGKILL and "error" not in ended.report)


def failure_reason(head: str, log_name: str, lines: Sequence[str]) -> str:
    """Returns a failure reason of at most 1024 characters that ends with the last log lines.

    Args:
        head: Sentence that says what failed; shortened if it is long.
        log_name: Name of the log.
        lines: Last lines of the log; empty: only the sentence is returned.
    """
    head = without_escapes(head)
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
                # Its beginning names the exception, where it is the last line of a traceback.
                kept.append(f"{line[: max(0, room - _LINE_END - 2)]}…{line[-min(_LINE_END, room - 2) :]}")
            break
        kept.append(line)
        room -= len(line) + 1
    return "\n".join([head + title, *reversed(kept)])


def how_it_ended(status: int) -> str:
    """Describes a process's wait status: `exited with code 3`, `was killed by SIGSEGV`."""
    if os.WIFSIGNALED(status):
        return f"was killed by {signal_name(os.WTERMSIG(status))}"
    return f"exited with code {os.WEXITSTATUS(status)}"


def _subject(crash: Crash, plan: RunPlan) -> str:
    application = _application(crash.role, plan)
    if crash.program is None:
        return application
    if crash.is_tool:
        return _tool(crash.program.removeprefix(f"{crash.role}-"), crash.role, plan)
    return f"{application} (program {crash.program})"


def tool_in_words(tool: ToolEnds, plan: RunPlan) -> str:
    """Describes a tool that ended: `Tool rviz of robot application a ended 14 times, and last exited with code 1`."""
    return f"{_tool(tool.name, tool.role, plan)} {tool}"


def _about_tools(ended: Exit, plan: RunPlan) -> str:
    """Returns the end of a failure reason: tools that were restarted repeatedly, as these may have caused it."""
    return "".join(f". {tool_in_words(tool, plan)}" for tool in ended.tools if tool.ends >= OFTEN)


def _tool(name: str, role: ApplicationRole, plan: RunPlan) -> str:
    application = _application(role, plan)
    return f"Tool {name} of {application[0].lower()}{application[1:]}"


def _who(phase: Phase, plan: RunPlan) -> str:
    return "The runtime" if phase.role is None else _application(phase.role, plan)


def _application(role: ApplicationRole, plan: RunPlan) -> str:
    if role == "robot":
        name = plan.robot_application.name if plan.robot_application else "scout"
        return f"Robot application {name}"
    name = plan.simulation_application.name if plan.simulation_application else "indoor-navigation"
    return f"Simulation application {name}"


def _what(ended: Exit) -> str:
    if "error" in ended.report:
        return ended.report["error"]
    if ended.signal is not None:
        return f"killed by {signal_name(ended.signal)}{_in_trial(ended)}"
    return f"the process ended itself with exit code {ended.exit_code} before the run was over{_in_trial(ended)}"


def _when(ended: Exit) -> str:
    """Returns the simulated time of a run's end, for a failure reason; empty if nothing was simulated, or in trials."""
    if ended.sim_time_s <= 0 or ended.trial is not None:
        return ""
    digits = 1 if ended.sim_time_s >= 1 else 2  # steps of 0.05 s
    return f" after {ended.sim_time_s:.{digits}f} s simulated"


def _in_trial(ended: Exit) -> str:
    return "" if ended.trial is None else f" in trial {ended.trial}"


def signal_name(number: int) -> str:
    """Returns the name of a signal, such as `SIGSEGV`; `signal 99` if it has none."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def attribute_disk_use(ended: Exit, plan: RunPlan) -> Exit:
    """Measures the disk use of a run's containers after their end, and adds a crash if it exceeds the limit.

    During the run, folders of the containers' root user may be unreadable.

    Args:
        ended: Observed end of a run that ended by itself.
        plan: Plan of the run.

    Returns:
        The same end, or with a crash of the container that has most files, if the run wrote too much.
    """
    containers = [program for program in plan.programs if program.cleanup_argv is not None]
    if not containers or ended.crash is not None or (said := disk_meter(plan).last_look()) is None:
        return ended
    held = [sum(file.size_bytes for file in files_below([each.folder]) if file is not None) for each in containers]
    most = containers[held.index(max(held))]
    return replace(ended, crash=Crash(most.role, f"used too much: {said}", most.name))
