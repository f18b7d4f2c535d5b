"""Progress of a run, shared with its supervisor: phase, steps, driven path, and the reason to stop."""

import json
import math
import mmap
import struct
from enum import IntEnum
from typing import Any, Protocol

from ....schemas.runs.plan import ApplicationRole, RunPlan
from ....schemas.runs.programs import ProgramPlan
from ....schemas.runs.trials import TrialRecordings

_SIZE = 64 * 1024
_PHASE, _STOP, _JUDGES, _TRIALS, _LENGTH, _WHERE, _RECORDINGS, _REPORT = 0, 1, 2, 4, 8, 16, 32, 48
_UINT = struct.Struct("<I")
_STEPS_AND_TIME = struct.Struct("<Qd")
_THREE_AND_FLAG = struct.Struct("<III?")

AGENT_GONE = "agent"
"""Reason to stop a run: its robot program has exited with code 0."""
STOP_REASONS = ("", "duration limit", "canceled", AGENT_GONE)
"""Reasons to stop a run, as written to `RunResult.ended_by`."""


class Phase(IntEnum):
    """Phase of a simulation process; it decides which application is blamed for a crash."""

    STARTING = 0
    MAKE_ENVIRONMENT = 1
    MAKE_AGENT = 2
    RESET = 3
    AGENT = 4
    STEP = 5
    REPORT = 6
    FINISHING = 7
    JUDGING = 8

    @property
    def role(self) -> ApplicationRole | None:
        """Role of the application whose code runs in this phase; `None` for the runtime's own code."""
        return _ROLES.get(self)

    @property
    def activity(self) -> str:
        """Phase of a run as text that follows "failed in", for error messages."""
        return _ACTIVITIES[self]


_ROLES: dict[Phase, ApplicationRole] = {
    Phase.MAKE_ENVIRONMENT: "simulation",
    Phase.MAKE_AGENT: "robot",
    Phase.RESET: "simulation",
    Phase.AGENT: "robot",
    Phase.STEP: "simulation",
    Phase.REPORT: "simulation",
}
_OF_A_STEP = (Phase.AGENT, Phase.STEP)
_ACTIVITIES = {
    Phase.STARTING: "starting the run",
    Phase.MAKE_ENVIRONMENT: "making the environment",
    Phase.MAKE_AGENT: "making the agent",
    Phase.RESET: "environment.reset()",
    Phase.AGENT: "the agent",
    Phase.STEP: "environment.step()",
    Phase.REPORT: "environment.run_result()",
    Phase.FINISHING: "writing the outputs",
    Phase.JUDGING: "judging the run",
}


def unanswered(phase: Phase, steps: int, time_s: float) -> str:
    """Returns text that says which program did not answer when a run was stopped at its time limit.

    An example: `stopped at the duration limit: the robot application did not answer in step 3, at 0.02 s simulated`.

    Args:
        phase: Phase in which the process was stopped.
        steps: Number of finished steps.
        time_s: Simulated time in s.
    """
    if phase.role is None:
        return f"stopped at the duration limit: the runtime had not finished {phase.activity}"
    where = f"in step {steps + 1}, at {time_s:.2f} s simulated" if phase in _OF_A_STEP else f"in {phase.activity}"
    return f"stopped at the duration limit: the {phase.role} application did not answer {where}"


class Progress:
    """Memory page that a simulation process shares with its supervisor: phase, steps, time, report.

    Setting a phase is a single write to memory, cheap enough for every step. The supervisor can read the page even
    after the process was killed.
    """

    def __init__(self) -> None:
        self._page = mmap.mmap(-1, _SIZE)

    def mark(self, phase: int) -> None:
        """Writes to the memory shared with the supervisor which phase of the run begins now."""
        self._page[_PHASE] = phase

    @property
    def phase(self) -> Phase:
        """Current phase of the run."""
        return Phase(self._page[_PHASE])

    def count_step(self, steps: int, time_s: float) -> None:
        """Writes the number of steps done and the simulated time in seconds to memory shared with the supervisor."""
        _STEPS_AND_TIME.pack_into(self._page, _WHERE, steps, time_s)

    @property
    def where(self) -> tuple[int, float]:
        """Number of finished steps, and the simulated time in seconds."""
        return _STEPS_AND_TIME.unpack_from(self._page, _WHERE)

    def begin_to_judge(self) -> None:
        """Notes in the memory shared with the supervisor that the run has requirements or judges itself."""
        self._page[_JUDGES] = 1

    @property
    def judges(self) -> bool:
        """Whether the run has requirements or judges itself."""
        return bool(self._page[_JUDGES])

    def request_stop(self, reason: str) -> None:
        """Asks the simulation process to stop, by writing the reason into the shared memory page.

        The process reads the page itself; this sends no signal.

        Args:
            reason: One of `STOP_REASONS`.
        """
        self._page[_STOP] = STOP_REASONS.index(reason)

    @property
    def stop_reason(self) -> str:
        """Reason for which the run was told to stop; empty if it was not."""
        return STOP_REASONS[self._page[_STOP]]

    def finish_trials(self, count: int) -> None:
        """Writes the number of finished trials to the memory shared with the supervisor."""
        _UINT.pack_into(self._page, _TRIALS, count)

    @property
    def trials(self) -> int:
        """Number of finished trials; 0 for a run without trials."""
        return _UINT.unpack_from(self._page, _TRIALS)[0]

    def record_trial(self, recordings: TrialRecordings) -> None:
        """Writes which trial is recorded now, and how many are, to the memory shared with the supervisor."""
        told = recordings
        _THREE_AND_FLAG.pack_into(self._page, _RECORDINGS, told.finished, told.total, told.trial, told.filmed)

    @property
    def recordings(self) -> TrialRecordings | None:
        """Progress of recording trials; `None` as long as none is to be recorded."""
        finished, total, trial, filmed = _THREE_AND_FLAG.unpack_from(self._page, _RECORDINGS)
        return TrialRecordings(finished=finished, total=total, trial=trial, filmed=filmed) if total else None

    def write_report(self, report: dict[str, Any]) -> None:
        """Stores the run's final report in shared memory; its length is written last, so it is complete or absent.

        Raises `ValueError` if the report is too long.
        """
        data = json.dumps(report).encode()
        if len(data) > _SIZE - _REPORT:
            raise ValueError(f"a report of {len(data)} bytes does not fit into {_SIZE - _REPORT}")
        self._page[_REPORT : _REPORT + len(data)] = data
        _UINT.pack_into(self._page, _LENGTH, len(data))

    def read_report(self) -> dict[str, Any]:
        """Returns the run's final report from the shared memory; empty if there is none, or it is damaged."""
        (length,) = _UINT.unpack_from(self._page, _LENGTH)
        try:
            return json.loads(self._page[_REPORT : _REPORT + length]) if length else {}
        except ValueError:  # overwritten by a stray write of the application
            return {}


class RunStopped(BaseException):
    """Raised inside application code that does not return after the run was told to stop.

    Args:
        phase: Phase that was interrupted; None if the code noticed the stop by itself.
    """

    def __init__(self, phase: Phase | None = None) -> None:
        super().__init__(phase)
        self.phase = phase


class RunEnded(Exception):
    """Raised by an observer to end the run normally before its time, such as when all goals are reached."""

    def __init__(self, ended_by: str = "requirements") -> None:
        super().__init__(ended_by)
        self.ended_by = ended_by


class Stop(Protocol):
    """Interface of objects that tell whether the run has to stop."""

    @property
    def reason(self) -> str:
        """Reason to stop (one of `progress.STOP_REASONS`); empty while the run may continue."""
        ...


def program_in_words(program: ProgramPlan, plan: RunPlan) -> str:
    """Describes a program of a run for messages: `tool watch of simulation application arena`."""
    application = plan.robot_application if program.role == "robot" else plan.simulation_application
    named = f"{program.role} application {application.name}" if application else f"the {program.role} application"
    return f"tool {program.name.removeprefix(f'{program.role}-')} of {named}" if program.kind == "tool" else named


PATH_FILE = "driven-path.csv"
"""Name of the file with the robot's path, in the run's work folder."""

PathPoint = tuple[float, float, float]


def line_of(point: PathPoint) -> str:
    """Formats a point of the robot's path as a line of the live path file: time, x and y, `1.200,0.500,-0.250`."""
    time_s, x, y = point
    return f"{time_s:.3f},{x:.3f},{y:.3f}\n"


def points_of(text: str) -> list[PathPoint]:
    """Parses the live path file; unreadable lines are skipped.

    Args:
        text: Content of the file, which application code may have changed.
    """
    points: list[PathPoint] = []
    for line in text.splitlines(keepends=True):
        try:
            time_s, x, y = map(float, line.split(","))
        except ValueError:
            continue
        if not line.endswith("\n") or not all(map(math.isfinite, (time_s, x, y))):
            continue
        while points and points[-1][0] >= time_s:
            points.pop()
        points.append((time_s, x, y))
    return points
