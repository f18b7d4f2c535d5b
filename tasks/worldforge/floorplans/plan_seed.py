"""Seed of a floor plan: a whole number that says which plan it is, in which random order of a template's plans."""

from typing import NamedTuple

_PLANS_PER_ORDER = 2**12
"""Number of seeds for one random order of plans; a job has 50 floor plans at most, unless it is allowed more."""

_FROM_BEST = 2**45
"""Smallest seed that means the best plan.

Seeds below it consist of an order (32 bits) and a plan's number in it (12 bits); the last order may have more numbers.
"""


class PlanSeed(NamedTuple):
    """Meaning of the seed of a floor plan: which plan of which order, or the best one."""

    order: int
    """Seed of the random order of all plans that a template has."""
    rank: int
    """Position of the floor plan in its random order, from 0."""
    diverse: bool
    """Whether floor plans of a job differ; otherwise each is the best one with other sizes."""

    @classmethod
    def of(cls, seed: int) -> "PlanSeed":
        """Converts a seed (any whole number from 0) to an order and a plan's position in it."""
        return cls(*divmod(seed % _FROM_BEST, _PLANS_PER_ORDER), diverse=seed < _FROM_BEST)

    @property
    def number(self) -> int:
        """Returns the seed of a floor plan as one whole number."""
        return (0 if self.diverse else _FROM_BEST) + self.order * _PLANS_PER_ORDER + self.rank
