"""Results of running a run again: whether its states are the same, and what decides how it ends if they are not."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field

from ..exit_codes import BROKE, OK, VERDICT_FAILED
from ..wire.base import Model, optional
from ..wire.common import counted

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
    command: str | None = optional(
        "First command of the robot's program that differs, if that was before the states: step, time, both values."
    )


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
            return f"diverged at t={self.divergence.time_s:.3f} s {self.divergence.what}{how}{self._first_command}"
        return f"bit-identical: {self.looks} states over {self.until_s or 0.0:.3f} s{how}"

    @property
    def _first_command(self) -> str:
        command = self.divergence and self.divergence.command
        if not command:
            return ""
        job = self.job_arn.rpartition("/")[2]
        return f"; first difference in the command{command}; robomaker flaky RUN --job {job} finds the source of chance"


class ReproductionFolder(Model):
    """Folder with everything to repeat a run, which `robomaker repro` wrote."""

    trial: int | None = optional("Number of the trial that it repeats; absent: the run has no trials.")
    folder: Path = Field(description="Folder with everything that the run needs, and its first outputs.")
    test: Path = Field(description="Path of the test that repeats the run.")
    video: Path | None = optional("Video of the rerun.")
    ending: str = Field(description="Description of how the rerun ended.")
    same_ending: bool = Field(description="Whether the rerun ended like the run.")
    other_inputs: list[str] = Field(default=[], description="Inputs of the rerun that the run did not have.")
    robot: RobotRepeat = Field(
        default="factory", description="How the robot was repeated in the rerun; see `Verification`."
    )


Factor = Literal["seed", "time", "threads", "order", "files", "hash", "network"]
FACTORS: tuple[Factor, ...] = ("seed", "time", "threads", "order", "files", "hash", "network")
FACTOR_IN_WORDS: Mapping[Factor, str] = {
    "seed": "Randomness that no seed repeats",
    "time": "The clock of the programs",
    "threads": "The turns of threads",
    "order": "Another job at the same time",
    "files": "Files that earlier runs have left",
    "hash": "The order of hashes and addresses",
    "network": "The network",
}
"""Factors as subjects of a sentence."""
HELD_IN_WORDS: Mapping[Factor, str] = {
    "seed": "with the system's randomness seeded",
    "time": "with a clock that counts looks instead of time",
    "threads": "with one processor, and threads that take turns only when they wait",
    "order": "with no other job beside",
    "files": "with empty folders for temporary files",
    "hash": "with one PYTHONHASHSEED and fixed addresses",
    "network": "without a network",
}
"""Descriptions of how each factor is held in a rerun."""
FlakyAnswer = Literal["repeats", "decided", "not decided", "not rerun"]
Side = Literal["robot", "simulation", "one process", "unknown"]
SIDE_IN_WORDS: Mapping[Side, str] = {
    "robot": "It is robot code: the simulation repeats bit by bit under the same commands.",
    "simulation": "It is the simulation: under the same commands it goes another way.",
    "one process": "Robot and simulation are one process, so that no commands tell them apart.",
    "unknown": "Whether it is the robot or the simulation is not known.",
}
_RARE = 20
"""Runs of which one ends otherwise: of a job that flips so seldom, reruns that repeat say little."""
_SURE = 0.95
FLAKY_EXIT_CODES: Mapping[FlakyAnswer, int] = {
    "repeats": OK,
    "decided": VERDICT_FAILED,
    "not decided": VERDICT_FAILED,
    "not rerun": BROKE,
}
"""Exit codes of `robomaker flaky`, by answer; of several jobs the greatest."""


class TriedHold(Model):
    """Ends of all reruns of a job that held the same factors at the same values."""

    held: list[Factor] = Field(description="Factors that were held; empty: none.")
    values: dict[Factor, int] = Field(
        default={}, description="Numbers of the values at which seed, time and hash were held, where it is not 0."
    )
    ends: dict[str, int] = Field(description="Number of reruns by verdict, or by failure code.")
    ways: int = Field(ge=1, description="Number of different ways to the bit, of commands and states.")


class Flakiness(Model):
    """Result of running a job again and again: whether it repeats, which factor decides, and on which side."""

    job: str = Field(description="ARN of the job.")
    name: str = Field(description="Name of the job for people, or its id.")
    answer: FlakyAnswer = Field(description="Result of the reruns.")
    decides: Factor | None = optional("Factor that decides how the job ends.")
    probability: float | None = optional("Posterior probability of that factor.")
    side: Side = Field(default="unknown", description="Part of the job in which reruns first differ.")
    has_states: bool = Field(
        default=True, description="Whether reruns gave their states; if not, only commands and ends were compared."
    )
    verdict: str | None = optional("Verdict of the run itself, or its failure code.")
    reruns: int = Field(default=0, ge=0, description="Number of reruns, replays of commands among them.")
    tried: list[TriedHold] = Field(default=[], description="Reruns by what they held.")
    first_difference: str | None = optional("Simulated time and place of the first difference between two reruns.")
    why: str | None = optional("Reason why nothing was decided, or why the job was not run again.")
    notes: list[str] = Field(default=[], description="Remarks on the job, such as an application that has changed.")

    def __str__(self) -> str:
        return "\n".join([f"{self.name}: {self._finding()}", *(f"  {line}" for line in self._lines())])

    def _finding(self) -> str:
        free = self._with(())
        total = sum(free.ends.values()) if free else 0
        if self.answer == "not rerun" or free is None:
            return f"not run again: {self.why}"
        if self.answer == "repeats":
            how = "repeats bit by bit" if self.has_states else "ends alike, and its states are not known"
            return f"{how}: {total} of {total} end with {next(iter(free.ends))}"
        ends = Counter(free.ends)
        if self.verdict is not None and self.answer == "decided":
            ends[self.verdict] += 1
        if len(ends) > 1:
            with_run = " with the run itself" if ends.total() > total else ""
            return f"the verdict flips: {_counted(ends)} of {ends.total()}{with_run}"
        end = next(iter(free.ends))
        if free.ways == 1:
            return f"{total} of {total} reruns end with {end}, all alike, and the run ended with {self.verdict}"
        return f"the verdict stays {end} in {total}, which went {free.ways} different ways"

    def _lines(self) -> list[str]:
        lines: list[str] = self._of_repeats() if self.answer == "repeats" else []
        if self.answer == "decided" and self.decides is not None:
            held = [each for each in self.tried if self.decides in each.held]
            free = [each for each in self.tried if each.held and self.decides not in each.held]
            words = HELD_IN_WORDS[self.decides]
            lines.append(f"{FACTOR_IN_WORDS[self.decides]} decides ({self.probability:.0%}).")
            for value in sorted({each.values.get(self.decides, 0) for each in held}):
                at_it = [each for each in held if each.values.get(self.decides, 0) == value]
                how = f"{words[0].upper()}{words[1:]}" if value == 0 else f"At value {value} of it"
                lines.append(f"{how}: {_summed(at_it)}.")
            if free:
                lines.append(f"Without, while others were held: {_summed(free)}.")
        elif self.answer == "not decided":
            lines.append(f"Not decided: {self.why}.")
        if self.answer in ("decided", "not decided"):
            lines.append(SIDE_IN_WORDS[self.side])
        if self.first_difference:
            lines.append(f"First difference {self.first_difference}.")
        return [*lines, *self.notes]

    def _of_repeats(self) -> list[str]:
        """Says what was varied where all reruns were alike, and which rare failure they could have missed."""
        free = self._with(())
        if free is None:
            return []
        done = sum(free.ends.values())
        missed = (1 - 1 / _RARE) ** done
        return [
            f"{counted(done, 'rerun')} as the job was; nothing else was varied, because they all ended alike.",
            f"A job that ends otherwise in 1 of {_RARE} runs looks like this in {missed:.0%} of such examinations: "
            f"{_reruns_to_see(_RARE)} reruns would be needed to see it ({_SURE:.0%} sure).",
        ]

    def _with(self, held: tuple[Factor, ...]) -> TriedHold | None:
        return next((each for each in self.tried if tuple(each.held) == held), None)


def _reruns_to_see(runs: int) -> int:
    """Returns how many reruns show an end of one in so many runs at least once, as sure as `_SURE`.

    It is the rule of three, the other way round: none of n does so with the chance (1 - p)^n.
    """
    return math.ceil(math.log(1 - _SURE) / math.log(1 - 1 / runs))


def _counted(ends: Mapping[str, int]) -> str:
    return ", ".join(f"{end} in {count}" for end, count in sorted(ends.items()))


def _summed(tried: Sequence[TriedHold]) -> str:
    ends: Counter[str] = Counter()
    for each in tried:
        ends.update(each.ends)
    ways = max((each.ways for each in tried), default=0)
    return f"{_counted(ends)} of {ends.total()}{f', which went {ways} different ways' if ways > len(ends) else ''}"


class FlakyJobs(Model):
    """Flakiness of jobs of a run (`robomaker flaky -o json`)."""

    run_id: str = Field(description="Id of the run.")
    jobs: list[Flakiness] = Field(description="Jobs that were run again.")

    @property
    def exit_code(self) -> int:
        """Exit code of `robomaker flaky`: the highest of those of its jobs; success without jobs."""
        return max((FLAKY_EXIT_CODES[each.answer] for each in self.jobs), default=OK)
