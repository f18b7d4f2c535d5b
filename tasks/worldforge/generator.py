"""Generates a checked world from a template body and two seeds.

The same body, seeds and `GENERATOR_VERSION` give the same world, byte for byte.
"""

import time
from collections.abc import Callable

import numpy as np

from ...schemas.templates.body import WorldTemplateBody
from ...schemas.wire.errors import WorldGenerationError
from ...schemas.worlds.world import Floorplan, World
from .doors.initial_states import dress_doors
from .doors.leaves import leaf_outlines
from .floorplans.floorplan import generate_floorplan
from .geometry.occupancy import occupancy_grid
from .interiors.interior import furnish
from .model.mjcf import proof_mjcf
from .proofs.checks import check_world
from .proofs.guarantees import SETTLE_S, violations
from .seeds import GENERATOR_VERSION, seeds_for

__all__ = ["GENERATOR_VERSION", "MAX_ATTEMPTS", "furnish_and_prove", "generate_world", "measured", "seeds_for"]

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
    return furnish_and_prove(body, plan, (floorplan_seed, interior_seed), settle=settle, clock=clock, begun=begun)


def furnish_and_prove(
    body: WorldTemplateBody,
    plan: Floorplan,
    seeds: tuple[int, int],
    *,
    settle: bool = True,
    clock: Callable[[], float] = time.process_time,
    begun: float | None = None,
    finish: Callable[[World], World] = lambda world: world,
) -> World:
    """Makes a world of a floor plan and checks it, again and again until it keeps all guarantees.

    Args:
        body: whose interior is wished.
        plan: the plan, with its doors hung.
        seeds: of the floor plan, which the world says, and of materials and furniture.
        settle: whether physics runs for two seconds.
        clock: seconds.
        begun: when work on the world began, by the clock; now, unless told otherwise.
        finish: what else is done to a world before it is checked.

    Raises:
        WorldGenerationError: no attempt passed the checks in time.
    """
    begun = clock() if begun is None else begun
    floorplan_seed, interior_seed = seeds
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
        world = measured(finish(world), settle=settle)
        problems = violations(world.checks) if world.checks else []
        if not problems:
            return world
        attempt += 1
    tried = f"{attempt} {'attempt' if attempt == 1 else 'attempts'}"
    if attempt < MAX_ATTEMPTS:
        tried += f" and {clock() - begun:.0f} s, more than {MOST_CPU_S:g} s"
    last = "; ".join(problems) or "the floor plan took all the time"
    from_seeds = f"floor plan seed {floorplan_seed}, interior seed {interior_seed}"
    raise WorldGenerationError(f"no valid interior in {tried} ({from_seeds}); the last one: {last}")


def measured(world: World, *, settle: bool = True) -> World:
    """The world with its checks taken anew.

    Args:
        world: the world.
        settle: whether physics runs for two seconds.
    """
    # A robot can push doors open: what it reaches then is what counts.
    grid = occupancy_grid(world.floorplan, world.furniture, leaf_outlines(world.floorplan, fully_open=True))
    checks = check_world(world, proof_mjcf(world), grid, settle_s=SETTLE_S if settle else None)
    return world.model_copy(update={"checks": checks})
