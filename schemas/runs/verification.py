"""Result of repeating a run and comparing its states (`robomaker verify`)."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from ..exit_codes import BROKE, OK, VERDICT_FAILED
from ..wire.base import Model, optional

Answer = Literal["bit-identical", "diverged", "not comparable"]

RobotRepeat = Literal["factory", "recorded actions", "program"]
ROBOT_IN_WORDS: dict[RobotRepeat, str] = {
    "factory": "",
    "recorded actions": "; with the recorded actions, the robot's program was not run",
    "program": "; the robot's program was run again",
}
"""Descriptions of how the robot was repeated in a rerun, for the end of a sentence."""

EXIT_CODES: dict[Answer, int] = {
    "bit-identical": OK,
    "diverged": VERDICT_FAILED,
    "not comparable": BROKE,
}
"""Exit codes of `robomaker verify`, by answer."""


class Divergence(Model):
    """The first step at which the simulation states of two runs differ."""

    time_s: float = Field(description="Simulated time of the first state that differs, in seconds.")
    equal_until_s: float | None = optional("Simulated time of the last equal state before; absent: there is none.")
    what: str = Field(description="Description of the difference: a joint with its values, the model, or the end.")
    joint: str | None = optional("Joint that differs most; absent: unknown.")
    quantity: Literal["qpos", "qvel"] | None = optional("Kind of number that differs: a position or a velocity.")
    value: float | None = optional("Value in the run.")
    value_again: float | None = optional("Value in the rerun.")
    value_time_s: float | None = optional("Simulated time of both values.")


class Verification(Model):
    """Result of a verification: whether a rerun reproduced the same simulation states as the original run."""

    run: str = Field(description="Reference to the run, as it was given.")
    job_arn: str = Field(description="ARN of the run's job.")
    run_id: str = Field(description="Id of the run.")
    trial: int | None = optional("Number of the trial, if the run has trials.")
    answer: Answer = Field(description="Result of the comparison.")
    reasons: list[str] = Field(default=[], description="Reasons why the runs cannot be compared.")
    divergence: Divergence | None = optional("First difference between the states.")
    looks: int = Field(default=0, description="Number of compared states.")
    until_s: float | None = optional("Simulated time of the last compared state.")
    digest: str | None = optional("Hash of the run's states.")
    digest_again: str | None = optional("Hash of the rerun's states.")
    robot: RobotRepeat = Field(
        default="factory",
        description="How the robot was repeated in the rerun: by its factory; where it is a program, by its recorded "
        "actions, or by the program itself.",
    )

    def __str__(self) -> str:
        if self.answer == "not comparable":
            return f"not comparable: {'; '.join(self.reasons)}"
        how = ROBOT_IN_WORDS[self.robot]
        if self.divergence is not None:
            return f"diverged at t={self.divergence.time_s:.3f} s {self.divergence.what}{how}"
        return f"bit-identical: {self.looks} states over {self.until_s or 0.0:.3f} s{how}"


class ReproductionFolder(Model):
    """Folder with everything to repeat a run, which `robomaker repro` wrote."""

    folder: Path = Field(description="Folder with everything that the run needs, and its first outputs.")
    test: Path = Field(description="Path of the test that repeats the run.")
    video: Path | None = optional("Video of the rerun.")
    ending: str = Field(description="Description of how the rerun ended.")
    same_ending: bool = Field(description="Whether the rerun ended like the run.")
    other_inputs: list[str] = Field(default=[], description="Inputs of the rerun that the run did not have.")
    robot: RobotRepeat = Field(
        default="factory", description="How the robot was repeated in the rerun; see `Verification`."
    )
