"""Seeds of the worlds of a generation job, and the version of what is made of them; without MuJoCo."""

from typing import NamedTuple

import numpy as np

GENERATOR_VERSION = "3.3.0"
"""Changes whenever the same seeds give other worlds; the first number, whenever their files are read in another way."""


_PLANS_PER_ORDER = 2**12
"""Seeds of floor plans that share an order; a job has 50 floor plans at most, unless it is allowed more."""

_FROM_BEST = 2**45
"""Least seed of the best plan: orders have 32 bits and plans 12, and one order may run over into the next one."""


class PlanSeed(NamedTuple):
    """Meaning of the seed of a floor plan: which plan of which order, or the best one."""

    order: int
    """Seed of an order of all plans that a template has."""
    rank: int
    """How many plans come before it, from 0."""
    diverse: bool
    """Whether plans differ; otherwise each is the best one, with sizes of its own."""

    @classmethod
    def of(cls, seed: int) -> "PlanSeed":
        """Reads a seed, which is any whole number from 0."""
        return cls(*divmod(seed % _FROM_BEST, _PLANS_PER_ORDER), diverse=seed < _FROM_BEST)

    @property
    def number(self) -> int:
        """The seed as one whole number."""
        return (0 if self.diverse else _FROM_BEST) + self.order * _PLANS_PER_ORDER + self.rank


def seeds_for(job_seed: int, floorplan_index: int, interior_index: int, *, diverse: bool = True) -> tuple[int, int]:
    """Computes the random seeds of one world of a generation job; interiors of one floor plan share its seed.

    The floor plans of a job have seeds that follow each other: they are the first ones of one order of plans.

    Args:
        job_seed: the job's seed, not negative.
        floorplan_index: which floor plan, from 0.
        interior_index: which interior of it, from 0.
        diverse: whether the floor plans differ; otherwise each is the best one.

    Returns:
        Floor plan seed, below 2**46, and interior seed, below 2**32.
    """
    order = int(np.random.SeedSequence(job_seed).generate_state(1)[0])
    interior = np.random.SeedSequence(job_seed, spawn_key=(floorplan_index, interior_index))
    return PlanSeed(order, floorplan_index, diverse).number, int(interior.generate_state(1)[0])
