"""Groups of a run's failures, and the causes that are claimed of each of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...schemas.reports.causes import Claim
from ...schemas.reports.live_comparison import FEWEST_WORLDS
from ..results.table import ResultTable
from .evidence import AxisColumn, Evidence
from .groups import Group, all_failures, compared, groups_of, is_compared_with_failures
from .sensitivity import varying
from .tested_causes import Hypothesis, claims_of, fewest_failures, hypotheses_of, lift_of_claim, tests_of_a_group

_SEED = 38
"""Seed of permutations: the same table has the same answer."""

Claims = list[tuple[Claim, Hypothesis]]


@dataclass(frozen=True)
class Findings:
    """Groups of the failures of a run, and the claims about them."""

    everything: Group | None
    """All failures together; None: they missed one requirement, whose group it is."""
    wholes: Sequence[Group]
    """Group of each requirement."""
    tested: Mapping[int, Group]
    """Group that is tested for each group, by its id: itself, or the whole one where nearly none passed."""
    axes: Sequence[AxisColumn]
    fewest: int
    """Failures that a claim takes."""
    tests: int
    """Number of tests of the run, at least those of one group."""
    can_tell: bool
    """Whether anything could be claimed: there are axes or enough worlds."""
    large: Sequence[Group]
    """Groups with enough failures to be tested."""
    hypotheses: Sequence[Hypothesis]
    claimed: Mapping[int, Claims]

    def tested_as(self, group: Group) -> Group:
        """Returns the group that is tested for a group."""
        return self.tested[id(group)]

    def claims(self, group: Group) -> Claims:
        """Returns the claims about a group, the strongest first."""
        return self.claimed.get(id(self.tested_as(group)), [])

    def chosen(self, whole: Group) -> Sequence[Group]:
        """Returns the group, or its parts if one of them has a stronger claim of a cause.

        Where nothing is claimed, parts would say one by one that they are too few.
        """
        strongest = max(map(self._strength, whole.parts), default=0.0)
        return whole.parts if strongest > self._strength(whole) else [whole]

    def _strength(self, group: Group) -> float:
        return max((each.strength for _, each in self.claims(group)), default=0.0)


def findings_of(results: ResultTable, evidence: Evidence, *, can_claim: bool) -> Findings:
    """Groups the failures and tests all axes, their pairs, worlds and kinds of worlds in each group.

    All failures together are tested as well: a cause may let trials fail in many ways, each of them seldom.

    Args:
        results: The table of results.
        evidence: Its trials, of which some failed.
        can_claim: Whether anything may be claimed of this run.
    """
    axes = list(varying(evidence))
    wholes = groups_of(evidence)
    everything = all_failures(evidence, wholes)
    tested = _tested(results, evidence, wholes)
    if everything is not None:
        tested[id(everything)] = everything
    fewest = fewest_failures(len(axes))
    can_tell = can_claim and bool(axes or evidence.world_count >= FEWEST_WORLDS)
    candidates = list({id(each): each for each in tested.values()}.values())
    large = [each for each in candidates if each.count >= fewest] if can_tell else []
    found = hypotheses_of(evidence, large, axes, np.random.default_rng(_SEED))
    claimed = {
        id(group): claims_of(evidence, group, [each for each in found if each.group == number])
        for number, group in enumerate(large)
    }
    if everything is not None and _is_of_one_group(evidence, everything, candidates, claimed):
        claimed.pop(id(everything), None)
    return Findings(
        everything=everything,
        wholes=wholes,
        tested=tested,
        axes=axes,
        fewest=fewest,
        tests=max(1, len(large)) * tests_of_a_group(evidence, len(axes)),
        can_tell=can_tell,
        large=large,
        hypotheses=found,
        claimed=claimed,
    )


def _is_of_one_group(
    evidence: Evidence, everything: Group, groups: Sequence[Group], claimed: Mapping[int, Claims]
) -> bool:
    """Whether the cause of all failures is that of one group, and failures of the others do not gather there.

    It is told of that group then, in which it is stronger.
    """
    if not (claims := claimed.get(id(everything))):
        return False
    own = claims[0][1]
    stronger = [each for each in groups if (told := claimed.get(id(each))) and told[0][1].strength > own.strength]
    for group in stronger:
        failed = everything.failed & ~group.failed
        others = replace(everything, failed=failed, at_risk=failed | ~everything.failed)
        lift = lift_of_claim(evidence, others, own)
        if lift is None or lift.low <= 1:
            return True
    return False


def _tested(results: ResultTable, evidence: Evidence, wholes: Sequence[Group]) -> dict[int, Group]:
    """Returns the group that is tested for each group, by its id: itself, or the whole one where nearly none passed.

    Failures of one room that are compared with those of others would make two causes of one that acts everywhere.
    """
    if not is_compared_with_failures(evidence):
        return {id(each): each for whole in wholes for each in (whole, *whole.parts)}
    found = [(whole, compared(results, evidence, whole)) for whole in wholes]
    return {id(each): group for whole, group in found for each in (whole, *whole.parts)}
