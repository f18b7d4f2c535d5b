"""Results of a run: findings of observers, and `result.json` with the verdict."""

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from pydantic import Field, ValidationError
from pydantic_core import PydanticSerializationError

from ....schemas.runs.plan import ENVIRONMENT_VERDICT, Collision, Requirement, RoomVisit, RunResult, Verdict
from ....schemas.runs.programs import RunStop
from ....schemas.runs.requirement_kinds.kind import NOT_READ
from ....schemas.runs.requirement_kinds.off import NOT_THERE
from ....schemas.wire.base import Model
from ....schemas.wire.common import counted
from ....schemas.wire.request_problems import nearest
from ...files.untrusted_files import write_anew
from .verdicts import Parts, decide_verdict

OWN_VERDICT = "verdict_without_topics"
"""Name in `RunResult.extra` of the verdict without topics, until the recording is judged."""
RESULT_FILE = "result.json"
MAX_RESULT_BYTES = 16 * 1024 * 1024
"""Size limit of `result.json` in bytes; a longer file is not read."""
MAX_COLLISIONS = 200
MAX_PATH_POINTS = 600
_FEW_STEPS = 10
"""Number of steps below which a run that its robot ended counts as hardly begun."""
_ENDERS = {
    "agent": "the robot application",
    "environment": "the simulation application",
    "requirements": "a goal that is reached where the robot starts",
}


class EnvironmentReport(Model):
    """Report of an environment about its run: verdict, requirements and metrics."""

    verdict: Verdict = Field(default="NONE", description="PASS, FAIL, or NONE when nothing is judged.")
    summary: str = Field(default="", description="One sentence for a person.")
    notes: list[str] = Field(default=[], description="Lines beside the verdict: what a person should know of it.")
    requirements: list[Requirement] = Field(default=[], description="Requirements that the verdict depends on.")
    metrics: dict[str, float] = Field(default={}, description="Numbers by name with unit.")
    rooms: list[RoomVisit] = Field(default=[], description="Rooms, in the world's order.")
    collisions: list[Collision] = Field(default=[], description="At most 200, in order.")
    path: list[tuple[float, float, float]] = Field(
        default=[], description="(simulated time in s, x, y) of the robot, at most 600 points."
    )
    extra: dict[str, Any] = Field(default={}, description="Anything else worth keeping, as plain JSON values.")


@runtime_checkable
class ReportingEnvironment(Protocol):
    """Interface of an environment that judges its run by `run_result`."""

    def run_result(self) -> EnvironmentReport | dict[str, Any]:
        """Returns the environment's report (verdict, requirements, metrics); it is called once, after the last step."""
        ...


@runtime_checkable
class NotingAgent(Protocol):
    """Interface of an agent that tells by `run_notes` what a person should know of its run."""

    def run_notes(self) -> list[str]:
        """Returns notes to show beside the verdict, one line each; it is called once, after the last step."""
        ...


@dataclass(frozen=True)
class Findings:
    """Results that an observer of the run contributes to `result.json`."""

    extra: dict[str, Any] = field(default_factory=dict)
    """Additional entries of the result by name, as plain JSON values."""

    metrics: dict[str, float] = field(default_factory=dict)
    """Metrics of the run by name, each with its unit in the name."""

    requirements: list[Requirement] = field(default_factory=list)
    """Judged requirements; an unsatisfied one makes the verdict FAIL, one with an error makes it ERROR."""

    defects: list[Requirement] = field(default_factory=list)
    """Defects of the run itself, as missed requirements; they count if the run is judged at all."""

    notes: list[str] = field(default_factory=list)
    """Notes shown with the verdict, one line each."""

    state_digest: str | None = None
    """Hash of the run's simulation states."""


class Observer:
    """Base class of observers, which read the physics during a run and report findings at the end.

    It must not change the run: with and without it, the same seed gives the same states.
    """

    next_time_s: float = 0.0
    """Simulated time of the next call of `watch`, in seconds."""

    def watch(self, environment: Any, time_s: float) -> None:
        """Reads the physics, and sets `next_time_s` to the time of its next call.

        Raises:
            RunEnded: The run is to end now.
        """

    def hear(self, state: bytes, time_s: float) -> None:
        """Reads a state that an environment without physics gives, at the beginning and after each step.

        Args:
            state: What its `state()` returned.
            time_s: Simulated time of the state, in seconds.

        Raises:
            RunEnded: The run is to end now.
        """

    def close(self, ended_by: str | None) -> Findings:  # noqa: ARG002 - for those who need it
        """Finishes the observer's files and returns its findings; called once, also when the run failed.

        Args:
            ended_by: Cause of the run's end; None if it failed.
        """
        return Findings()

    def state(self) -> Any:
        """Returns the observer's state for a checkpoint."""
        return self.next_time_s

    def restore(self, state: Any, environment: Any) -> None:  # noqa: ARG002 - for those who need it
        """Restores the observer's state from a checkpoint, in a new process."""
        self.next_time_s = state


@dataclass(frozen=True)
class Episode:
    """Outcome of a run's simulation loop: number of steps, times, and cause of the end."""

    ended_by: str
    """Cause of the end: `environment`, `agent`, `requirements`, or one of `progress.STOP_REASONS`."""

    report: EnvironmentReport
    """Report of the environment; empty if it has none."""

    steps: int
    """Number of calls of `environment.step`."""

    sim_time_s: float
    """Simulated time at the end, in seconds."""

    wall_time_s: float
    """Wall-clock time from the first reset to the last step, in seconds."""

    judges: bool = False
    """Whether the environment has a report method; a missing verdict is then no verdict "NONE"."""

    unanswered: str = ""
    """Description of the program that did not answer at the duration limit and was interrupted; empty if there was
    none.
    """

    notes: Sequence[str] = ()
    """Notes of the agent, shown with the verdict."""

    records_itself: bool = False
    """Whether the environment records its clock and joints itself, so that the runtime does not."""


def read_report(environment: object) -> EnvironmentReport:
    """Asks an environment for its report on the run, checks it, and returns it.

    Returns an empty report for an environment that makes none.

    Raises:
        ValueError: The report does not fit `EnvironmentReport`, or JSON; the text names what.
    """
    if not isinstance(environment, ReportingEnvironment):
        return EnvironmentReport()
    report = environment.run_result()
    try:
        if not isinstance(report, EnvironmentReport):
            # Numbers of numpy and tuples for lists are welcome from an application's own code.
            report = EnvironmentReport.model_validate(report, strict=False)
        report.model_dump_json()
    except PydanticSerializationError as error:
        raise ValueError(f"environment.run_result() returned what cannot be written as JSON: {error}") from error
    except ValidationError as error:
        problems = "; ".join(f"{'.'.join(map(str, item['loc'])) or 'report'}: {item['msg']}" for item in error.errors())
        raise ValueError(
            f"environment.run_result() returned something that is no EnvironmentReport: {problems}"
        ) from error
    return report


def read_notes(agent: NotingAgent) -> list[str]:
    """Asks an agent for its notes on the run, checks them, and returns them.

    Raises:
        TypeError: They are no list of text.
    """
    notes: object = agent.run_notes()
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise TypeError(f"agent.run_notes() returned {repr(notes)[:80]}; it has to return a list of text")
    return [" ".join(note.split()) for note in notes]


def make_result(episode: Episode, seed: int, findings: Sequence[Findings] = ()) -> RunResult:
    """Makes the content of `result.json` from the environment's report and all measurements.

    Args:
        episode: Outcome of the simulation loop.
        seed: Seed of the run.
        findings: Results of observers; their extra entries and metrics replace those of the environment with the same
            names.

    Returns:
        The content of `result.json`; numbers that are not finite are moved from the metrics to `extra`
        as text, because JSON has none. A run that was cancelled has no verdict.
    """
    report = episode.report
    metrics = dict(report.metrics)
    remarks = dict(report.extra)
    added = _switched_off([item for finding in findings for item in finding.requirements], report)
    notes = [*report.notes, *episode.notes, *(note for finding in findings for note in finding.notes)]
    told = [item for item in added if item.error != NOT_READ]  # the others are judged when the recording is read
    reached = _ended_at_its_goals(episode, [item for item in told if item.kind != "off"])
    off = {item.name for item in added if item.kind == "off"}
    judged, own = _without(report, {item.name for item in added}, off)
    own = [item.model_copy(update={"counts": not reached and item.counts}) for item in own]
    if reached and judged != "ERROR":
        judged = "NONE"
    if episode.ended_by == "agent" and 0 < episode.steps < _FEW_STEPS:
        steps = counted(episode.steps, "step")
        notes.append(f"the robot application ended the run after {steps}, at {episode.sim_time_s:.2f} s simulated")
    is_judged = judged != "NONE" or bool(own or added)
    cut = "the job's duration limit ended the run at"  # requirements with a time of their own may say more of it
    is_told = any(note.startswith(cut) for note in notes)
    if is_judged and episode.ended_by == "duration limit" and not episode.unanswered and not is_told:
        notes.append(f"{cut} {episode.sim_time_s:.2f} s simulated")
    defects: list[Requirement] = []
    for defect in (*_defects_of(episode), *(defect for finding in findings for defect in finding.defects)):
        if is_judged or (episode.judges and (episode.unanswered or not episode.steps)):
            defects.append(defect)
        else:
            notes.append(defect.detail)
    is_canceled = episode.ended_by == RunStop.CANCELED
    parts = Parts(own=judged, requirements=[*own, *added], defects=defects, is_canceled=is_canceled)
    if judged == "FAIL" and all(item.satisfied or not item.counts for item in own):
        remarks[ENVIRONMENT_VERDICT] = judged
    if len(told) < len(added):
        remarks[OWN_VERDICT] = decide_verdict(replace(parts, requirements=[*own, *told]))
    for finding in findings:
        metrics |= finding.metrics
        remarks |= finding.extra
    finite = {name: value for name, value in metrics.items() if math.isfinite(value)}
    if len(finite) < len(metrics):
        remarks["not_finite"] = {name: str(metrics[name]) for name in metrics.keys() - finite.keys()}
    result = RunResult(
        verdict=decide_verdict(parts),
        summary=_summary(report, [*told, *defects], reached, episode.sim_time_s),
        requirements=[*own, *added, *defects],
        notes=notes,
        metrics={"steps": float(episode.steps), **finite},
        rooms=report.rooms,
        collisions=report.collisions[:MAX_COLLISIONS],
        path=thin_out(report.path, MAX_PATH_POINTS),
        sim_time_s=episode.sim_time_s,
        wall_time_s=episode.wall_time_s,
        real_time_factor=episode.sim_time_s / episode.wall_time_s if episode.wall_time_s > 0 else 0.0,
        ended_by=episode.ended_by,
        seed=seed,
        versions=versions(),
        state_digest=next((finding.state_digest for finding in findings if finding.state_digest), None),
        extra=remarks,
    )
    return result.unjudged() if episode.ended_by == RunStop.CANCELED else result


def _ended_at_its_goals(episode: Episode, added: Sequence[Requirement]) -> bool:
    """Returns whether the job's goals ended the run, so that the environment judged an unfinished run."""
    return episode.ended_by == "requirements" and bool(added) and all(requirement.satisfied for requirement in added)


def _switched_off(added: Sequence[Requirement], report: EnvironmentReport) -> list[Requirement]:
    """Returns the job's requirements, in which switching off a requirement of the environment is no error.

    Such an entry gets the environment's finding and does not count; one whose name the environment does not have stays
    an error, with a hint at similar names.
    """
    own = {item.name: item for item in report.requirements}
    there = f"; it has {', '.join(own)}" if own else ""
    found: list[Requirement] = []
    for item in added:
        if item.error != NOT_THERE:
            found.append(item)
        elif item.name in own:
            detail = f"switched off by the job: {own[item.name].detail}"
            met = own[item.name].satisfied
            found.append(Requirement(name=item.name, kind=item.kind, satisfied=met, detail=detail, counts=False))
        else:
            more = nearest(item.name, own) + there
            found.append(item.model_copy(update={"error": NOT_THERE + more, "detail": item.detail + more}))
    return found


def _without(report: EnvironmentReport, replaced: Set[str], off: Set[str]) -> tuple[Verdict, list[Requirement]]:
    """Returns the environment's verdict and requirements, without those that the job replaces or switches off.

    A failure that only replaced requirements caused becomes PASS; PASS becomes NONE if all requirements are off.

    Args:
        report: Result of the environment.
        replaced: Names of requirements that the job replaces or switches off.
        off: Names of those that it switches off.
    """
    kept = [item for item in report.requirements if item.name not in replaced]
    missed = [item for item in report.requirements if not item.satisfied]
    if report.verdict == "FAIL" and missed and all(item.name in replaced for item in missed):
        verdict: Verdict = "PASS"
    else:
        verdict = report.verdict
    # Where all that it asked for is off, it has judged nothing that counts.
    is_off = report.requirements and all(item.name in off for item in report.requirements)
    return ("NONE" if is_off and verdict == "PASS" else verdict), kept


def _summary(report: EnvironmentReport, added: Sequence[Requirement], reached: bool, sim_time_s: float) -> str:
    """Makes the run's summary: the job's requirements that are not met, and the environment's sentence."""
    if reached:
        return f"Ended at {sim_time_s:.1f} s with all goals reached."
    missed = {item.name for item in report.requirements if not item.satisfied}
    broken = [f"{item.name}: {item.detail}" for item in added if item.counts and not item.satisfied]
    off = [item.name for item in added if not item.counts and item.name in missed]
    instead = [item.name for item in added if item.counts and item.satisfied and item.name in missed]
    parts = (
        f"Not met: {'; '.join(broken)}." if broken else "",
        report.summary,
        f"The job has switched {', '.join(off)} off." if off else "",
        f"The job's own {', '.join(instead)} counts instead." if instead else "",
    )
    return " ".join(part for part in parts if part)


def _defects_of(episode: Episode) -> list[Requirement]:
    """Lists defects of an episode: that nothing was simulated, or that a program did not answer; empty without any."""
    if episode.unanswered:
        return [never_answered(episode.unanswered)]
    if episode.steps:
        return []
    who = _ENDERS.get(episode.ended_by, episode.ended_by)
    text = f"nothing was simulated: {who} ended the run before its first step"
    return [Requirement(name="simulated", kind="health", satisfied=False, detail=text, error=text)]


def never_answered(text: str) -> Requirement:
    """Returns the defect, as a missed requirement, of a run in which a program did not answer until the time limit."""
    return Requirement(name="answered", kind="health", satisfied=False, detail=text, error=text)


def write_result(result: RunResult, output_dir: Path) -> Path:
    """Writes a run's `result.json` into its output folder, atomically, and returns the file's path.

    Raises:
        TypeError: `extra` holds something that is no JSON value.
        OSError: The folder cannot be written.
    """
    try:
        text = result.model_dump_json(indent=2)
    except PydanticSerializationError as error:
        raise TypeError(f"the result cannot be written as JSON: {error}") from error
    path = output_dir / RESULT_FILE
    write_anew(path, text.encode() + b"\n")
    return path


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Returns the versions of the packages that influence a run's numbers."""
    names = {"mujoco": "mujoco", "dm_control": "dm-control", "prefect_robomaker": "prefect-robomaker"}
    return {name: metadata.version(distribution) for name, distribution in names.items()}


def thin_out(path: list[tuple[float, float, float]], limit: int) -> list[tuple[float, float, float]]:
    """Returns at most `limit` evenly chosen points of a path (time s, x m, y m), including both ends."""
    if len(path) <= limit:
        return path
    return [path[round(i * (len(path) - 1) / (limit - 1))] for i in range(limit)]
