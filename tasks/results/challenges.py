"""The table of a challenge: each sabotaged job against the same job of the control arm. Pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from ...schemas.reports.challenge import CellResult, Challenge, ChallengedJob, ControlResult, SabotageResult
from ...schemas.runs.plan import Requirement, Verdict

CRASH_CODES = ("RobotApplicationCrash", "SimulationApplicationCrash")
"""Failure codes of jobs whose applications broke: a run says so, which is noticed."""
A_CRASH = "a crash"


@dataclass(frozen=True)
class Arm:
    """One simulation job of a challenge, as far as its result decides the table."""

    job: int
    """Number of the job in the challenge; arms with the same number are compared."""
    name: str
    """Name of the job for people."""
    sabotage: str | None = None
    """Name of its sabotage; None: it is of the control arm."""
    verdict: Verdict | None = None
    """None: its trial did not come to an end."""
    requirements: Sequence[Requirement] = field(default_factory=list[Requirement])
    failure_code: str | None = None
    reason: str = ""
    """Reason for not passing, in words."""
    not_applicable: str = ""
    """Reason why the sabotage cannot be applied, in words; empty: it was."""
    state_digest: str | None = None
    """Digest of all states; None: it has none."""

    @property
    def has_crashed(self) -> bool:
        """Whether one of its applications broke."""
        return self.failure_code in CRASH_CODES

    @property
    def missed(self) -> list[Requirement]:
        """The requirements that it missed, the earliest first."""
        missed = [each for each in self.requirements if each.counts and not each.satisfied and each.error is None]
        return sorted(missed, key=_time_of)


def table_of(challenge: Challenge, arms: Sequence[Arm]) -> Challenge:
    """Fills the table of a challenge.

    Only jobs that pass in the control arm count, as others would not pass with any robot.

    Args:
        challenge: The challenge with its sabotages.
        arms: Its jobs, in any order.

    Returns:
        The challenge with its jobs, and with how often each sabotage was caught.
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
    """Says how a job of the control arm ended; None: there is none."""
    if control is None or (control.verdict is None and not control.has_crashed):
        return "was not run"
    if control.has_crashed or control.verdict == "ERROR":
        return "breaks"
    return {"PASS": "passes", "FAIL": "fails"}.get(control.verdict or "", "is not judged")  # pyright: ignore[reportReturnType] - of a mapping of texts


def cell_result(control: Arm, arm: Arm | None) -> CellResult:
    """Says what a sabotage came to in a job that passes without it.

    Args:
        control: The job in the control arm.
        arm: The job with the sabotage; None: it never became one.
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
    """Whether an arm that was found out was so by what broke, not by a requirement."""
    return not arm.missed and (arm.has_crashed or arm.verdict == "ERROR")


def _catch(arm: Arm) -> tuple[float, str]:
    """Time at which an arm was found out, and by what."""
    if arm.missed:
        return _time_of(arm.missed[0]), arm.missed[0].name
    return math.inf, A_CRASH if arm.has_crashed else "an error" if arm.verdict == "ERROR" else "its verdict"


def _time_of(requirement: Requirement) -> float:
    return math.inf if requirement.first_violation_s is None else requirement.first_violation_s
