"""Seeds of the worlds of a generation job, and the generator's version; it does not need MuJoCo."""

import numpy as np

from .floorplans.plan_seed import PlanSeed

GENERATOR_VERSION = "3.3.1"
"""Version of the world generator.

It changes whenever the same seeds give other worlds; the first number, whenever their files are read in another way.
"""


def seeds_for(job_seed: int, floorplan_index: int, interior_index: int, *, diverse: bool = True) -> tuple[int, int]:
    """Computes the random seeds of one world of a generation job; interiors of one floor plan share its seed.

    The floor plans of a job have seeds that follow each other: they are the first ones of one order of plans.

    Args:
        job_seed: The job's seed, not negative.
        floorplan_index: Index of the floor plan in the job, from 0.
        interior_index: Index of the interior in the floor plan, from 0.
        diverse: Whether the floor plans differ; otherwise each is the best one.

    Returns:
        Floor plan seed, below 2**46, and interior seed, below 2**32.
    """
    order = int(np.random.SeedSequence(job_seed).generate_state(1)[0])
    interior = np.random.SeedSequence(job_seed, spawn_key=(floorplan_index, interior_index))
    return PlanSeed(order, floorplan_index, diverse).number, int(interior.generate_state(1)[0])
