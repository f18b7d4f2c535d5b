"""Result of a challenge: which sabotages of the robot are caught by the requirements of which jobs."""

from typing import Literal

from pydantic import Field

from ..runs.axis_kinds.kind import Value
from ..wire.base import Model, optional

CellResult = Literal["caught", "missed", "no effect", "not applicable", "not tried"]
"""Results of a job with a sabotage, if the same job passes without it."""
ControlResult = Literal["passes", "fails", "breaks", "is not judged", "was not run"]
"""Results of a job of the control arm, whose robot is unchanged."""


class ChallengedJob(Model):
    """A job of a challenge, as it ended with the unchanged robot (in the control arm)."""

    name: str = Field(description="Name of the job in every run of the specification.")
    control: ControlResult = Field(
        description="Result in the control arm (unchanged robot); unless the job passes, it shows nothing."
    )
    reason: str = Field(default="", description="Reason why the job did not pass, as text.")

    @property
    def in_words(self) -> str:
        """Describes why the job cannot show whether sabotages (faults put into the robot) are noticed; empty if it can.

        An example: `drive: the robot fails here without a sabotage, so this job shows nothing`.
        """
        reason = f" ({self.reason})" if self.reason else ""
        match self.control:
            case "passes":
                return ""
            case "is not judged":
                return f"{self.name}: it has no requirements, so this job can catch nothing"
            case "was not run":
                return f"{self.name}: the real robot was not run here{reason}, so this job shows nothing"
            case _:
                return (
                    f"{self.name}: the robot {self.control} here without a sabotage{reason}, so this job shows nothing"
                )


class SabotageResult(Model):
    """Result of one sabotage (a fault put into the robot) in the jobs that pass without it."""

    name: str = Field(description="Name of the sabotage.")
    axes: dict[str, Value] = Field(description="Values of axes, by kind; texts by name of the environment variable.")
    caught: int = Field(default=0, description="Number of jobs that did not pass with the sabotage.")
    broke: int = Field(
        default=0,
        description="Those of the caught ones that broke with it before a requirement was missed; a run says so, "
        "whatever its requirements are.",
    )
    missed: int = Field(default=0, description="Number of jobs that passed although the sabotage had an effect.")
    no_effect: int = Field(
        default=0, description="Number of jobs with bit-identical states, so that the sabotage had no effect."
    )
    not_applicable: int = Field(default=0, description="Number of jobs to whose robot the sabotage cannot be applied.")
    not_tried: int = Field(default=0, description="Number of jobs that did not finish for a reason of the machine.")
    first: str = Field(default="", description="Requirement that caught it first, or `a crash`; empty: none did.")
    first_s: float | None = optional("Simulated time at which it was caught first; absent: at the end, or unknown.")
    reason: str = Field(default="", description="Reason why the sabotage is not applicable or was not tried, as text.")

    @property
    def applicable(self) -> int:
        """Number of jobs in which the sabotage was applied until the end."""
        return self.caught + self.missed + self.no_effect

    @property
    def is_only_broken(self) -> bool:
        """Whether the sabotage was noticed only because jobs crashed with it, and not by any requirement."""
        return 0 < self.caught == self.broke

    @property
    def is_open(self) -> bool:
        """Whether no job caught the sabotage; one that cannot be applied to the robot of any job does not count."""
        is_only_elsewhere = self.not_applicable > 0 and not self.applicable and not self.not_tried
        return not self.caught and not is_only_elsewhere

    @property
    def in_words(self) -> str:
        """Describes how often the sabotage was caught, and by which requirement first.

        An example: `caught by 3 of 4 jobs, first by upright at 2.1 s, missed by 1`.
        """
        if not self.applicable:
            return self._not_run_in_words()
        parts = [self._tried_in_words()]
        if self.not_applicable:
            parts.append(f"not applicable in {self.not_applicable}: {self.reason}")
        if self.not_tried:
            parts.append(f"not tried in {self.not_tried}")
        return "; ".join(parts)

    def _not_run_in_words(self) -> str:
        if self.not_tried:
            return f"was not tried: {self.reason or 'its jobs did not end'}"
        return f"not applicable: {self.reason}" if self.not_applicable else "shown by no job"

    def _tried_in_words(self) -> str:
        total = self.applicable
        if self.caught:
            when = "" if self.first_s is None else f" at {self.first_s:.1f} s"
            others = [f"missed by {self.missed}"] if self.missed else []
            others += [f"no effect in {self.no_effect}"] if self.no_effect else []
            if self.is_only_broken:
                by = f"broke {_jobs(self.caught, total)} by {self.first}"
                return ", ".join((by, *others)) + "; no requirement caught it"
            others = [f"broke {self.broke} of them", *others] if self.broke else others
            return ", ".join((f"caught by {_jobs(self.caught, total)}, first by {self.first}{when}", *others))
        if not self.missed:
            return f"had no effect in {_jobs(self.no_effect, total)}"
        missed = f"missed by {_jobs(self.missed, total)}"
        if self.no_effect:
            missed += f", no effect in {self.no_effect}"
        return f"{missed}; nothing here would notice it"


def _jobs(count: int, total: int) -> str:
    """Describes a number of jobs: `all 4 jobs`, `2 of 4 jobs`."""
    if count < total:
        return f"{count} of {total} jobs"
    return {1: "the only job", 2: "both jobs"}.get(total, f"all {total} jobs")


class Challenge(Model):
    """Table of a challenge: jobs with the unchanged robot, and how often each fault put into the robot was caught."""

    sabotages: list[SabotageResult] = Field(description="The sabotages, in order.")
    jobs: list[ChallengedJob] = Field(default=[], description="The jobs in the control arm, in order.")

    @property
    def showing(self) -> int:
        """Number of jobs that pass with the unchanged robot, so that they can show something."""
        return sum(job.control == "passes" for job in self.jobs)

    @property
    def is_passed(self) -> bool:
        """Whether each applicable sabotage was caught by a job, and some by a requirement."""
        some = any(each.caught and not each.is_only_broken for each in self.sabotages)
        return some and not any(each.is_open for each in self.sabotages)

    @property
    def is_broken(self) -> bool:
        """Whether jobs failed for other reasons, so that the table does not say how good the requirements are."""
        breaks = [job.control in ("breaks", "was not run") for job in self.jobs]
        return all(breaks) or any(each.not_tried and not each.caught for each in self.sabotages)

    @property
    def headline(self) -> str:
        """One line for people on how a challenge ended: `5 of 7 sabotages caught`, or why nothing could be caught."""
        if self.jobs and all(job.control == "is not judged" for job in self.jobs):
            return "No job has requirements, so that nothing could catch anything; give jobs `requirements`"
        if all(job.control == "was not run" for job in self.jobs):
            return "No job was run with the real robot, so that nothing shows whether sabotages would be noticed"
        if not self.showing:
            return "No job passes with the real robot, so that none shows whether sabotages would be noticed"
        counted = [each for each in self.sabotages if each.caught or each.is_open]
        noun = "sabotage" if len(counted) == 1 else "sabotages"
        caught = sum(each.caught > 0 for each in counted)
        left = len(self.sabotages) - len(counted)
        broken = sum(each.is_only_broken for each in self.sabotages)
        return "".join(
            (
                f"{caught} of {len(counted)} {noun} caught",
                f", {broken} of them only by what broke" if broken else "",
                f"; {left} not applicable" if left else "",
            )
        )
