"""Comparison of a run with an earlier run while it runs (`run --against`): the question, and its answer."""

from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional
from ..wire.common import counted

Answer = Literal["better", "not worse", "worse", "no difference shown", "not comparable"]


FEWEST_WORLDS = 6
"""Number of worlds from which whole worlds are compared. Flipping the signs of fewer shows nothing at 5 %: five of five
that got worse have p = 2 / 2**5 = 0.0625.
"""

MOST_NAMED = 8
"""Maximum number of steps named in the line; a step of many batches would fill pages."""


class Against(Model):
    """Question with which a run is compared with an earlier run while it runs: `robomaker run --against`."""

    run_id: str = Field(description="Id of the earlier run.")
    alpha: float = Field(description="Error probability of all answers together.")
    margin: float | None = optional("Fall of the pass rate that would matter, a share from 0 to 1; absent: any.")


class AgainstAnswer(Against):
    """Answer of a run that was compared with an earlier run while it ran."""

    answer: Answer = Field(description="Answer: whether the run is better or worse than the earlier one, by verdicts.")
    why: str = Field(description="Reason of the answer, as text.")
    pairs: int = Field(description="Pairs of trials that the answer rests on, in an order that the requests fix.")
    planned: int = Field(description="Number of trial pairs that the whole run would have.")
    saved: int = Field(
        default=0, description="Trials of those pairs that were not run, or cancelled, once it was clear."
    )
    unpaired: int = Field(
        default=0, description="Jobs without a pair that were not run, or cancelled, once it was clear."
    )
    skipped: list[str] = Field(default=[], description="Steps that were not run once it was clear, in their order.")
    stopped_early: bool = Field(
        default=False, description="Whether simulations were cancelled or left out because it was clear."
    )
    e_values: dict[str, float] = Field(
        default={},
        description="Largest e-value by answer, the evidence for it: the answer is given where it is at least "
        "2 / alpha.",
    )


def in_words(found: AgainstAnswer) -> str:
    """Describes the answer in a line: the result, its reason, and what was not run because of it.

    An example, with `...` for the reason: `worse than nightly-1: ...; 120 trials saved; not run since it was decided:
    long-drives`.
    """
    heads: dict[Answer, str] = {
        "better": f"better than {found.run_id}",
        "not worse": f"not worse than {found.run_id}",
        "worse": f"worse than {found.run_id}",
        "no difference shown": f"no difference from {found.run_id} shown",
        "not comparable": f"not comparable with {found.run_id}",
    }
    return "; ".join([f"{heads[found.answer]}: {found.why}", *_not_run(found)])


def _not_run(found: AgainstAnswer) -> list[str]:
    told = [f"{counted(found.saved, 'trial')} saved"] if found.saved else []
    if found.unpaired:
        told.append(
            f"{counted(found.unpaired, 'job')} without a pair {'was' if found.unpaired == 1 else 'were'} not run"
        )
    if found.skipped:
        is_decided = found.answer in ("better", "not worse", "worse")
        since = "it was decided" if is_decided else "it could not be decided any more"
        more = f" and {len(found.skipped) - MOST_NAMED} more" if len(found.skipped) > MOST_NAMED else ""
        told.append(f"not run since {since}: {', '.join(found.skipped[:MOST_NAMED])}{more}")
    return told
