"""Seeds of the worlds of a generation job, and the version of what is made of them; without MuJoCo."""

import numpy as np

GENERATOR_VERSION = "3.2.0"
"""Changes whenever the same seeds give other worlds; the first number, whenever their files are read in another way."""


def seeds_for(job_seed: int, floorplan_index: int, interior_index: int) -> tuple[int, int]:
    """Computes the random seeds of one world of a generation job; interiors of one floor plan share its seed.

    Args:
        job_seed: the job's seed, not negative.
        floorplan_index: which floor plan, from 0.
        interior_index: which interior of it, from 0.

    Returns:
        Floor plan seed and interior seed, each below 2**32.
    """
    floorplan = np.random.SeedSequence(job_seed, spawn_key=(floorplan_index,))
    interior = np.random.SeedSequence(job_seed, spawn_key=(floorplan_index, interior_index))
    return int(floorplan.generate_state(1)[0]), int(interior.generate_state(1)[0])
