"""Generates a checked world from a template body and two seeds.

The same body, seeds and `GENERATOR_VERSION` give the same world, byte for byte.
"""

import time
from collections.abc import Callable

import numpy as np

from ...schemas.templates.body import WorldTemplateBody
from ...schemas.wire.errors import WorldGenerationError
from ...schemas.worlds.world import World
from .doors.initial_states import dress_doors
from .doors.leaves import leaf_outlines
from .floorplans.floorplan import generate_floorplan
from .geometry.occupancy import occupancy_grid
from .interiors.interior import furnish
from .model.mjcf import world_mjcf
from .proofs.checks import check_world
from .proofs.guarantees import SETTLE_S, violations
from .seeds import GENERATOR_VERSION, seeds_for

__all__ = ["GENERATOR_VERSION", "MAX_ATTEMPTS", "generate_world", "seeds_for"]

MAX_ATTEMPTS = 8
"""Interiors tried on one floor plan before giving up."""

MOST_CPU_S = 20.0
"""CPU seconds after which no further interior is begun; a hundred times what a world takes."""


def generate_world(
    body: WorldTemplateBody,
    floorplan_seed: int,
    interior_seed: int,
    *,
    settle: bool = True,
    clock: Callable[[], float] = time.process_time,
) -> World:
    """Makes one world and checks it.

    An interior that breaks a guarantee is made again from the next sub-seed; the floor plan stays,
    since other worlds share it.

    Args:
        body: the template.
        floorplan_seed: equal seeds give equal walls and passages.
        interior_seed: seed of materials and furniture.
        settle: whether physics runs for two seconds to see that loose objects stay.
        clock: seconds; CPU time unless told otherwise, so that a busy machine rejects no world that an idle one makes.

    Raises:
        WorldGenerationError: no floor plan was found, or no attempt passed the checks in `MOST_CPU_S`; the message says
            what the last one broke.
    """
    begun = clock()
    plan = generate_floorplan(body, np.random.default_rng(floorplan_seed))
    problems: list[str] = []
    attempt = 0
    while attempt < MAX_ATTEMPTS and clock() - begun < MOST_CPU_S:
        sub_seed = np.random.SeedSequence(interior_seed, spawn_key=(attempt,))
        furniture, preferences, rooms = furnish(body, plan, np.random.default_rng(sub_seed))
        hung, door_preferences = dress_doors(body, plan, np.random.default_rng(sub_seed.spawn(1)[0]))
        world = World(
            generator_version=GENERATOR_VERSION,
            template_version=body.Version,
            floorplan_seed=floorplan_seed,
            interior_seed=interior_seed,
            interior_attempt=attempt,
            floorplan=hung.model_copy(update={"rooms": rooms}),
            furniture=furniture,
            wishes=[*preferences, *door_preferences],
        )
        # A robot can push doors open: what it reaches then is what counts.
        grid = occupancy_grid(hung, furniture, leaf_outlines(hung, fully_open=True))
        checks = check_world(world, world_mjcf(world), grid, settle_s=SETTLE_S if settle else None)
        problems = violations(checks)
        if not problems:
            return world.model_copy(update={"checks": checks})
        attempt += 1
    tried = f"{attempt} {'attempt' if attempt == 1 else 'attempts'}"
    if attempt < MAX_ATTEMPTS:
        tried += f" and {clock() - begun:.0f} s, more than {MOST_CPU_S:g} s"
    last = "; ".join(problems) or "the floor plan took all the time"
    seeds = f"floor plan seed {floorplan_seed}, interior seed {interior_seed}"
    raise WorldGenerationError(f"no valid interior in {tried} ({seeds}); the last one: {last}")
