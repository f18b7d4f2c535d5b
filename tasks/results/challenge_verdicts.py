"""Result of a challenge: compares each sabotaged job with the same job without sabotage (control arm)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from ...schemas.reports.challenge import CellResult, Challenge, ChallengedJob, ControlResult, SabotageResult
from ...schemas.runs.plan import Requirement, Verdict

CRASH_CODES = ("RobotApplicationCrash", "SimulationApplicationCrash")
"""Failure codes of jobs whose applications crashed, which counts as noticing the sabotage."""
A_CRASH = "a crash"


@dataclass(frozen=True)
class Arm:
    """One simulation job of a challenge, with the unchanged robot or a fault put into it, and its result in parts."""

    job: int
    """Number of the job in the challenge; jobs with the same number are compared."""
    name: str
    """Name of the job for people."""
    sabotage: str | None = None
    """Name of the sabotage that was applied; None: the job is of the control arm."""
    verdict: Verdict | None = None
    """Verdict of the job; None: its trial did not finish."""
    requirements: Sequence[Requirement] = field(default_factory=list[Requirement])
    failure_code: str | None = None
    reason: str = ""
    """Reason for not passing, as text."""
    not_applicable: str = ""
    """Reason why the sabotage could not be applied, as text; empty: it was applied."""
    state_digest: str | None = None
    """Hash of all simulation states; None: there is none."""

    @property
    def has_crashed(self) -> bool:
        """Whether one of the job's applications crashed."""
        return self.failure_code in CRASH_CODES

    @property
    def missed(self) -> list[Requirement]:
        """Requirements that the job missed, the earliest first."""
        missed = [each for each in self.requirements if each.counts and not each.satisfied and each.error is None]
        return sorted(missed, key=_time_of)


def table_of(challenge: Challenge, arms: Sequence[Arm]) -> Challenge:
    """Fills the result table of a challenge: how often each sabotage (fault put into the robot) was noticed.

    Only jobs that pass without sabotage count, as the others would not pass with any robot.

    Args:
        challenge: The challenge with its sabotages.
        arms: Jobs of the challenge, in any order.

    Returns:
        The challenge with its jobs, and with how often each sabotage was noticed.
    """
    controls = {arm.job: arm for arm in arms if arm.sabotage is None}
    sabotaged = {(arm.job, arm.sabotage): arm for arm in arms if arm.sabotage is not None}
    numbers = sorted({arm.job for arm in arms})
    names = {arm.job: arm.name for arm in reversed(arms)} | {number: arm.name for number, arm in controls.items()}
    passing = [controls[number] for number in numbers if control_result(controls.get(number)) == "passes"]
    return Challenge(
        sabotages=[
            _result(each, [(control, sabotaged.get((control.job, each.name))) for control in passing])
            for each in challenge.sabotages
        ],
        jobs=[
            ChallengedJob(
                name=names[number],
                control=control_result(control := controls.get(number)),
                reason="" if control is None or control.verdict == "PASS" else control.reason,
            )
            for number in numbers
        ],
    )


def control_result(control: Arm | None) -> ControlResult:
    """Returns how a job with the unchanged robot ended, as text such as `passes`; `was not run` if there is no job."""
    if control is None or (control.verdict is None and not control.has_crashed):
        return "was not run"
    if control.has_crashed or control.verdict == "ERROR":
        return "breaks"
    return {"PASS": "passes", "FAIL": "fails"}.get(control.verdict or "", "is not judged")  # pyright: ignore[reportReturnType] - of a mapping of texts


def cell_result(control: Arm, arm: Arm | None) -> CellResult:
    """Returns how a job that passes with the unchanged robot ended with a fault put into it (a sabotage).

    It was `caught` by a requirement, crash or error, `missed`, without effect, not applicable, or not tried.

    Args:
        control: Job without sabotage.
        arm: Job with the sabotage; None: the job was never created.
    """
    if arm is None:
        return "not tried"
    if arm.not_applicable:
        return "not applicable"
    # An error without a code is a requirement that could not be judged, or physics that broke: the run says so.
    if arm.verdict == "FAIL" or arm.has_crashed or (arm.verdict == "ERROR" and arm.failure_code is None):
        return "caught"
    if arm.verdict != "PASS":
        return "not tried"
    is_same = control.state_digest is not None and control.state_digest == arm.state_digest
    return "no effect" if is_same else "missed"


def _result(sabotage: SabotageResult, pairs: Sequence[tuple[Arm, Arm | None]]) -> SabotageResult:
    cells = [cell_result(control, arm) for control, arm in pairs]
    told = [arm for (_, arm), cell in zip(pairs, cells, strict=True) if arm and cell in ("not applicable", "not tried")]
    caught = [arm for (_, arm), cell in zip(pairs, cells, strict=True) if arm and cell == "caught"]
    # A requirement comes before what broke, also if it was missed at the end.
    found = ((*_catch(arm), _is_broken(arm)) for arm in caught)
    first_s, first, _ = min(found, key=lambda each: (each[2], *each[:2]), default=(math.inf, "", False))
    return sabotage.model_copy(
        update={
            "caught": cells.count("caught"),
            "broke": sum(_is_broken(arm) for arm in caught),
            "missed": cells.count("missed"),
            "no_effect": cells.count("no effect"),
            "not_applicable": cells.count("not applicable"),
            "not_tried": cells.count("not tried"),
            "first": first,
            "first_s": first_s if math.isfinite(first_s) else None,
            "reason": next((arm.not_applicable or arm.reason for arm in told), ""),
        }
    )


def _is_broken(arm: Arm) -> bool:
    """Returns whether a sabotage was noticed by a crash or error, and not by a requirement."""
    return not arm.missed and (arm.has_crashed or arm.verdict == "ERROR")


def _catch(arm: Arm) -> tuple[float, str]:
    """Returns time (s) and name of the first requirement that noticed a sabotage.

    If none was missed, the time is infinite, and the name says that a crash, an error or the verdict noticed it.
    """
    if arm.missed:
        return _time_of(arm.missed[0]), arm.missed[0].name
    return math.inf, A_CRASH if arm.has_crashed else "an error" if arm.verdict == "ERROR" else "its verdict"


def _time_of(requirement: Requirement) -> float:
    return math.inf if requirement.first_violation_s is None else requirement.first_violation_s
