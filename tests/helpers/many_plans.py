"""Counting the plans of ten templates: how many there are, how many 200 seeds show, and how clean their outlines are.

`tests/endurance/many_plans.py` runs it.
"""

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from math import log
from unittest.mock import patch

from helpers.plan_templates import TEMPLATES
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.worlds.world import Floorplan
from prefect_robomaker.tasks.worldforge.floorplans import (
    partition_choice,
    partition_notches,
    partition_setbacks,
    partition_shortlist,
)
from prefect_robomaker.tasks.worldforge.floorplans.brief import brief
from prefect_robomaker.tasks.worldforge.floorplans.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.floorplans.plan_signature import signature_of
from prefect_robomaker.tasks.worldforge.seeds import GENERATOR_VERSION, seeds_for

LIMITS = (0.25, 0.5)
"""Shares by which ratios may be off; the second one counts where the first leaves fewer than `FEW` plans."""

FEW = 20
ENOUGH = 60
LEAST_SHARE = 0.6
MOST_OFTEN = 0.1
OFTEN_OF_FEW = 1.5
"""Largest share of a plan over its even share, where plans are few."""
LEAST_EDGE_M = 0.8
WIDE = {
    partition_shortlist: {"_REFINED": 3000},
    partition_notches: {"_SETTLED": 6000, "_REFINED": 3000},
    partition_setbacks: {"_JUDGED": 16_000, "_REFINED": 3000},
}
"""Limits of a wide search: ten to twenty times those of worlds."""


@dataclass
class PlanCount:
    """Counts of one template."""

    rooms: int
    exist: int
    """Forms that a wide search finds: areas, connections and widths kept, ratios off by `off_share` at most."""
    exist_plain: int
    off_share: float
    shown: int
    """Different plans among the seeds."""
    shown_forms: int
    """The same, doors aside."""
    most_often_share: float
    """Share of the seeds that have the most frequent plan."""
    plain_share: float
    """Share of outlines that are rectangles or a clean L, T or U."""
    shortest_edge_m: float
    outer_walls_m: list[float]
    """Thicknesses of outer walls."""
    missed: int
    """Most missed wishes of a plan."""
    missed_by_best: int

    @property
    def is_varied(self) -> bool:
        """Whether there are plans, enough of them are shown, and none is shown too often for their number."""
        if self.exist == 0:
            return False
        often = self.most_often_share <= max(MOST_OFTEN, OFTEN_OF_FEW / self.exist)
        return self.shown_forms >= min(ENOUGH, LEAST_SHARE * self.exist) and often


@contextmanager
def wide_search() -> Iterator[None]:
    """Has searches look much farther, with nothing remembered before or after."""
    found = (
        partition_shortlist.shortlist,
        partition_notches.notched_shortlists,
        partition_setbacks.setback_shortlist,
        partition_choice.plans_of,
    )
    patches = [patch.object(module, name, value) for module, names in WIDE.items() for name, value in names.items()]
    for each in patches:
        each.start()
    for each in found:
        each.cache_clear()
    try:
        yield
    finally:
        for each in patches:
            each.stop()
        for each in found:
            each.cache_clear()


def existing(body: WorldTemplateBody) -> tuple[int, int, float]:
    """Forms that a wide search finds, those with a plain outline, and the limit that was taken."""
    numbers = brief(body.floorplan)
    if len(numbers.types) == 1:
        return 1, 1, 0.0
    forms: set[int] = set()
    plain: set[int] = set()
    share = LIMITS[0]
    with wide_search():
        lists = partition_choice.shortlists(numbers)
    for share in LIMITS:
        for plans in lists:
            fine = ~plans.misses[1 + len(numbers.types) :].any(axis=0) & (plans.off <= round(log(1 + share), 6) + 1e-6)
            forms.update(plans.forms[fine].tolist())
            plain.update(plans.forms[fine & plans.plain].tolist())
        if len(forms) >= FEW:
            break
    return len(forms), len(plain), share


def is_plain_outline(plan: Floorplan) -> bool:
    """Whether an outline is a rectangle or a clean L, T or U: two inner corners are beside each other, or a T's."""
    points = plan.footprint
    turns = []
    for index, (x, y) in enumerate(points):
        (u, v), (s, t) = points[index - 1], points[(index + 1) % len(points)]
        turns.append((x - u) * (t - y) - (y - v) * (s - x) < 0)
    inner = [index for index, turn in enumerate(turns) if turn]
    if len(inner) < 2:
        return True
    gap = inner[1] - inner[0]
    return len(inner) == 2 and {gap, len(points) - gap} in ({1, 7}, {3, 5})


def counted(name: str, seeds: int, job_seed: int) -> PlanCount:
    """Counts the plans of a template."""
    body = TEMPLATES[name]
    exist, exist_plain, share = existing(body)
    plans = [generate_floorplan(body, seeds_for(job_seed, number, 0)[0]) for number in range(seeds)]
    best = generate_floorplan(body, seeds_for(job_seed, 0, 0, diverse=False)[0])
    keys = Counter(signature_of(plan).key for plan in plans)
    edges = [
        abs(x - u) + abs(y - v)
        for plan in plans
        for (x, y), (u, v) in zip(plan.footprint, (*plan.footprint[1:], plan.footprint[0]), strict=True)
    ]
    return PlanCount(
        rooms=len(body.floorplan.Rooms),
        exist=exist,
        exist_plain=exist_plain,
        off_share=share,
        shown=len(keys),
        shown_forms=len({signature_of(plan)._replace(doors=()) for plan in plans}),
        most_often_share=max(keys.values()) / seeds,
        plain_share=sum(map(is_plain_outline, plans)) / seeds,
        shortest_edge_m=round(min(edges), 3),
        outer_walls_m=sorted({wall.thickness_m for plan in plans for wall in plan.walls if wall.exterior}),
        missed=max(map(missed, plans)),
        missed_by_best=missed(best),
    )


def missed(plan: Floorplan) -> int:
    """Number of missed wishes about the plan."""
    return sum(wish.outcome == "missed" for wish in plan.wishes)


def main() -> int:
    """Counts the plans of all templates and prints one JSON summary."""
    parser = argparse.ArgumentParser(description="Counts the plans of ten templates.")
    parser.add_argument("--seeds", type=int, default=200, help="floor plans of each template (200)")
    parser.add_argument("--seed", type=int, default=7, help="seed of the job that they are of (7)")
    args = parser.parse_args()
    found = {}
    for name in TEMPLATES:
        found[name] = counted(name, args.seeds, args.seed)
        print(json.dumps({name: asdict(found[name])}), flush=True)
    plain = sum(each.plain_share for each in found.values()) / len(found)
    met = {
        "varied": [name for name, each in found.items() if not each.is_varied] == [],
        "plain": plain >= LEAST_SHARE,
        "edges": all(each.shortest_edge_m >= LEAST_EDGE_M for each in found.values()),
        "walls": all(len(each.outer_walls_m) == 1 for each in found.values()),
        "wishes": all(each.missed <= each.missed_by_best + 1 for each in found.values()),
    }
    print(json.dumps({"generator": GENERATOR_VERSION, "plain_share": round(plain, 3), "targets_met": met}))
    return 0 if all(met.values()) else 1
