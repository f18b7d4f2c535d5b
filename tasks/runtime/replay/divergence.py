"""Finds the first step at which a run and its rerun differ, from the states that both stored."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ....schemas.runs.plan import Requirement, RunResult
from ....schemas.runs.provenance import JointPlace
from ....schemas.runs.verification import Divergence
from ..states.digest import StateTimeline
from .replay import RunOutputs


@dataclass(frozen=True)
class JointNames:
    """Names of the joints that the numbers of a state belong to."""

    joints: Sequence[JointPlace]
    positions: int
    """How many positions there are; velocities follow."""

    def of(self, index: int) -> tuple[str, Literal["qpos", "qvel"]]:
        """Joint and kind of the number at an index into positions and velocities."""
        quantity: Literal["qpos", "qvel"] = "qpos" if index < self.positions else "qvel"
        place = index if quantity == "qpos" else index - self.positions
        owners = [joint for joint in self.joints if getattr(joint, quantity) <= place]
        return (max(owners, key=lambda joint: getattr(joint, quantity)).name if owners else "unknown"), quantity


def first_difference(one: RunOutputs, other: RunOutputs) -> Divergence | None:
    """Finds where two runs part.

    Args:
        one: The run; one that was killed is compared as far as it got.
        other: The rerun.

    Returns:
        The first difference; None when all states are equal.
    """
    here, there = one.provenance, other.provenance
    if here.model_sha256 != there.model_sha256:
        return Divergence(time_s=0.0, what="in the model itself: its environment built another one")
    if one.timeline is None and here.plan.trial is not None:
        return _other_digest(one, other)
    if one.timeline is None or other.timeline is None:
        return None
    names = JointNames(here.joints, here.positions)
    return compare_timelines(one.timeline, other.timeline, names, whole=here.digest is not None)


def compare_timelines(
    one: StateTimeline, other: StateTimeline, names: JointNames, *, whole: bool = True
) -> Divergence | None:
    """Finds where two runs of one model part.

    Args:
        one: States of the run.
        other: States of the rerun.
        names: Names of the model's joints.
        whole: Whether the run came to its end, so that the rerun has to end there too.
    """
    both = min(len(one.links), len(other.links))
    at = next((i for i in range(both) if one.links[i] != other.links[i]), None)
    if at is None:
        if len(other.links) < len(one.links) or (whole and len(other.links) > len(one.links)):
            return _other_end(one, other)
        return None
    time_s = float(min(one.times_s[at], other.times_s[at]))
    until_s = float(one.times_s[at - 1]) if at else None
    named = _name_joint(one.states, other.states, names, time_s)
    if named is None:
        what = "in no position or velocity that was kept: in controls, forces or solver state"
        return Divergence(time_s=time_s, equal_until_s=until_s, what=what)
    return named.model_copy(update={"time_s": time_s, "equal_until_s": until_s})


def _other_digest(one: RunOutputs, other: RunOutputs) -> Divergence | None:
    """Whether a trial, of which only the digest of its states is kept, has parted from its rerun."""
    digest, again = one.provenance.digest, other.provenance.digest
    if digest is None or again is None or digest == again:
        return None
    what = "or before: of a trial only the digest of all its states is kept"
    return Divergence(time_s=min(digest.until_s, again.until_s), what=what)


def _other_end(one: StateTimeline, other: StateTimeline) -> Divergence:
    ends = [float(each.times_s[-1]) if len(each.times_s) else 0.0 for each in (one, other)]
    what = f"in its end: the run ended at {ends[0]:.3f} s, the rerun at {ends[1]:.3f} s"
    return Divergence(time_s=min(ends), equal_until_s=min(ends), what=what)


def _name_joint(
    one: Sequence[NDArray[np.float64]],
    other: Sequence[NDArray[np.float64]],
    names: JointNames,
    from_s: float,
) -> Divergence | None:
    """The joint that differs most in the first kept state that differs."""
    for state, again in zip(one, other, strict=False):
        if state[0] < from_s or len(state) != len(again) or state[0] != again[0]:
            continue
        different = np.flatnonzero((state != again) & ~(np.isnan(state) & np.isnan(again)))
        if different.size:
            return _difference(state, again, different, names)
    return None


def _difference(
    state: NDArray[np.float64], again: NDArray[np.float64], different: NDArray[np.intp], names: JointNames
) -> Divergence:
    # Positions say more than velocities; where only velocities differ, they have to do.
    positions = different[different <= names.positions]
    candidates = positions if positions.size else different
    index = int(candidates[np.argmax(np.abs(state[candidates] - again[candidates]))])
    joint, quantity = names.of(index - 1)
    value, value_again, time_s = float(state[index]), float(again[index]), float(state[0])
    return Divergence(
        time_s=time_s,
        what=f"in joint {joint} ({quantity} {value!r} vs {value_again!r} at {time_s:.3f} s)",
        joint=joint,
        quantity=quantity,
        value=value,
        value_again=value_again,
        value_time_s=time_s,
    )


def result_difference(first: RunResult | None, again: RunResult | None) -> str | None:
    """Says how the results of two runs with the same states differ: by verdict, by a requirement; None: not at all.

    The same states have the same results, unless a file was changed afterwards or something is judged that is no state.

    Args:
        first: The run's result; None: it has none, such as one that failed.
        again: The rerun's.
    """
    if first is None or again is None or again.ended_by == "canceled" or first.ended_by == "canceled":
        return None
    if first.verdict != again.verdict:
        return f"in its result: the verdict was {first.verdict} and is {again.verdict}"
    there, here = ({item.name: item for item in result.requirements} for result in (first, again))
    for name in [*there, *(name for name in here if name not in there)]:
        if (one := _judged(there.get(name))) != (other := _judged(here.get(name))):
            return f"in its result: {name} was {one} and is {other}"
    return None


def _judged(requirement: Requirement | None) -> str:
    """Describes how a requirement was judged, with its margin and without words about wall-clock time."""
    if requirement is None:
        return "absent"
    judged = "met" if requirement.satisfied else "broken" if requirement.error is not None else "missed"
    return judged if requirement.margin is None else f"{judged} by {requirement.margin:g}"
