"""Kinds of worlds as causes: worlds of one kind, such as `dense flat 1` and `dense flat 2`, fail more than others.

A world is called by its template, so its name without the number is its kind. No trial can be compared within a world
then: worlds are the observations.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.live_comparison import FEWEST_WORLDS
from ...schemas.reports.names import world_kind
from .evidence import Evidence
from .groups import Group
from .lift import Lift, lift_of, logits_of_worlds

_FEWEST_OF_KIND = 2
"""Worlds of a kind from which on it is one; a world alone is tested as an outlier."""


def kind_codes(evidence: Evidence) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Returns the number of each world's kind, and the names of the kinds with two worlds or more; -1: no kind.

    There is nothing to test, and no name, where all worlds are of one kind or too few to be a sample.
    """
    kinds = [world_kind(name) for name in evidence.world_names]
    counts = Counter(kinds)
    names = tuple(sorted(kind for kind, count in counts.items() if kind and count >= _FEWEST_OF_KIND))
    if evidence.world_count < FEWEST_WORLDS or len(counts) < 2:
        names = ()
    places = {name: place for place, name in enumerate(names)}
    return np.array([places.get(kind, -1) for kind in kinds], dtype=np.int64), names


def hardest_kind(evidence: Evidence, group: Group) -> tuple[str, NDArray[np.bool_], float] | None:
    """Tests whether worlds of some kind fail more often than those of others; None: there are no kinds to compare.

    It is a one-sided t test of the worlds' logits, whose spread within kinds is taken for no less than that of chance.

    Args:
        evidence: The trials.
        group: The failures that are asked about.

    Returns:
        Name of the kind, its trials, and the p-value, with Bonferroni's factor for the number of kinds.
    """
    from scipy.special import stdtr

    codes, names = kind_codes(evidence)
    found: list[tuple[float, int]] = []
    counts, logits, of_chance = logits_of_worlds(evidence, group)
    usable = counts > 0
    for place in range(len(names)):
        inside, outside = (logits[usable & side] for side in (codes == place, codes != place))
        free = len(inside) + len(outside) - 2
        if min(len(inside), len(outside)) < _FEWEST_OF_KIND or free + 2 < FEWEST_WORLDS:
            continue
        squares = len(inside) * float(inside.var()) + len(outside) * float(outside.var())
        spread = math.sqrt(max(squares / free, of_chance))
        t = (inside.mean() - outside.mean()) / (spread * math.sqrt(1 / len(inside) + 1 / len(outside)))
        found.append((min(1.0, len(names) * float(stdtr(free, -t))), place))
    if not found:
        return None
    p_value, best = min(found)
    return names[best], codes[evidence.worlds] == best, p_value


def lift_of_kind(evidence: Evidence, group: Group, mask: NDArray[np.bool_]) -> Lift | None:
    """Computes how many times as often trials fail in worlds of a kind; its interval is that between worlds."""
    every = np.arange(len(evidence))
    together = np.zeros(len(evidence), dtype=np.int64)
    return lift_of(replace(evidence, jobs=together, seeds=every, cells=every), group, mask)


def steps_like(steps: NDArray[np.int64], names: Sequence[str], mask: NDArray[np.bool_]) -> list[str]:
    """Names the step whose trials are all of a kind of world, and all trials of it: it may be the cause as well."""
    return [f"step = {names[code]}" for code in np.unique(steps[mask]).tolist() if ((steps == code) == mask).all()]
