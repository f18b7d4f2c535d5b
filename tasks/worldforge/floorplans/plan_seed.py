"""The seed of a floor plan: one whole number that says which plan of which order it is."""

from typing import NamedTuple

_PLANS_PER_ORDER = 2**12
"""Seeds of floor plans that share an order; a job has 50 floor plans at most, unless it is allowed more."""

_FROM_BEST = 2**45
"""Seeds from here on mean the best plan. Those below hold an order (32 bits) and a plan's number (12 bits); the last
order may run on."""


class PlanSeed(NamedTuple):
    """Meaning of the seed of a floor plan: which plan of which order, or the best one."""

    order: int
    """Seed of an order of all plans that a template has."""
    rank: int
    """Number of plans that come before it, from 0."""
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
