"""Generates a checked world from a template and two seeds, and makes variations of a world.

The same template, seeds and `GENERATOR_VERSION` give the same world, byte for byte.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from difflib import get_close_matches
from math import cos, degrees, radians, sin
from typing import NamedTuple

import mujoco
import numpy as np

from ...schemas.templates.body import WorldTemplateBody
from ...schemas.wire.errors import ConfigurationError, WorldGenerationError
from ...schemas.worlds.world import (
    Change,
    Floorplan,
    Furniture,
    Light,
    Passage,
    Variation,
    World,
    contains,
)
from .balconies.balconies import whole_floorplan
from .doors.bath_windows import with_bath_windows
from .doors.styles_and_openings import dress_doors
from .furniture.catalogue import parts_of
from .furniture.placed_parts import height_at, turn
from .interiors.interior import furnish
from .model.mjcf import proof_mjcf
from .proofs.checks import check_world, planned_site
from .proofs.guarantees import SETTLE_S, violations
from .seeds import GENERATOR_VERSION, seeds_for

__all__ = ["GENERATOR_VERSION", "MAX_ATTEMPTS", "furnish_and_prove", "generate_world", "measured", "seeds_for"]

MAX_ATTEMPTS = 8
"""Limit of the interiors that are tried on one floor plan before giving up."""

MOST_CPU_S = 20.0
"""CPU seconds after which no further interior is tried; a hundred times the time for one world."""


def generate_world(
    body: WorldTemplateBody,
    floorplan_seed: int,
    interior_seed: int,
    *,
    settle: bool = True,
    clock: Callable[[], float] = time.process_time,
) -> World:
    """Generates one world (floor plan, furniture, materials) from a template and seeds, and checks it.

    An interior that breaks a guarantee is made again from the next sub-seed; the floor plan stays,
    since other worlds share it.

    Args:
        body: The template.
        floorplan_seed: Equal seeds give equal walls and passages.
        interior_seed: Seed of materials and furniture.
        settle: Whether physics runs for two seconds to see that loose objects stay.
        clock: Seconds; CPU time unless told otherwise, so that a busy machine rejects no world that an idle one makes.

    Raises:
        WorldGenerationError: No floor plan was found, or no attempt passed the checks in `MOST_CPU_S`; the message says
            what the last one broke.
    """
    begun = clock()
    plan = with_bath_windows(whole_floorplan(body, floorplan_seed))
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
    """Furnishes a floor plan and checks the world, repeatedly until it meets all guarantees.

    Args:
        body: Template body with the preferences for the interior.
        plan: The plan, with its doors hung.
        seeds: Seed of the floor plan, which is recorded in the world, and seed of materials and furniture.
        settle: Whether physics runs for two seconds.
        clock: Seconds.
        begun: Time at which work on the world began, by the clock; absent: now.
        finish: Function that changes the world before it is checked.

    Raises:
        WorldGenerationError: No attempt passed the checks in time.
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
    """Returns the world with its checks measured anew.

    Args:
        world: The world.
        settle: Whether physics runs for two seconds.
    """
    site = planned_site(world, mujoco.MjModel.from_xml_string(proof_mjcf(world)))
    checks = check_world(world, site, settle_s=SETTLE_S if settle else None)
    return world.model_copy(update={"checks": checks})


_MOST_NAMED = 12
_TOUCHES_M = 2e-3
"""Largest gap between an object and the surface it rests on, in metres.

Worlds store heights to 0.1 mm, and a round top ends 1 mm lower.
"""


class Move(NamedTuple):
    """Displacement of a piece of furniture: metres to the east and north, and a turn in degrees."""

    east_m: float
    north_m: float
    turn_deg: float = 0.0
    """Turn of a moved piece of furniture counter-clockwise about its middle, in degrees."""


class Wanted(NamedTuple):
    """Requested changes for a variation of a world: doors, furniture, light and friction."""

    doors: Mapping[str, float] = {}
    """Requested opening of doors in percent, by door id or by the door's two rooms: `Hall/Bedroom`."""
    moved: Mapping[str, Move] = {}
    removed: Sequence[str] = ()
    light: Light | None = None
    friction: Mapping[str, float] = {}
    """Requested sliding friction of pieces of imported worlds, by name; `*`: of all pieces."""


def vary(world: World, wanted: Wanted, content: str, arn: str | None = None) -> World:
    """Makes a variation of a world, which differs only in the requested changes, and measures it.

    It may break guarantees that the other world keeps; its checks say so.

    Args:
        world: The original world, which is not changed.
        wanted: Requested changes.
        content: Content hash of the original world.
        arn: Its ARN.

    Raises:
        ConfigurationError: The world has no such door or furnishing, the variation equals the world, or another
            generator version made the world.
    """
    if wanted.friction:
        raise ConfigurationError(
            f"friction of {next(iter(wanted.friction))}: only worlds that were imported from Gazebo are varied in it"
        )
    if world.generator_version != GENERATOR_VERSION:
        raise ConfigurationError(
            f"generator {world.generator_version} made the world; only worlds of this one, {GENERATOR_VERSION}, can be "
            "varied, as more than the wanted would differ otherwise"
        )
    changes: list[Change] = []
    varied = world
    for name, percent in wanted.doors.items():
        varied, change = _with_door(varied, name, percent)
        changes.append(change)
    for name, move in wanted.moved.items():
        varied, moved = _with_moved(varied, name, move)
        changes += moved
    for name in wanted.removed:
        varied, gone = _without(varied, name)
        changes += gone
    if wanted.light is not None and wanted.light != world.appearance:
        varied = varied.model_copy(update={"appearance": wanted.light})
        changes.append(Change(what="light", thing="world", before=world.appearance, after=wanted.light))
    if not changes:
        raise ConfigurationError(f"nothing would differ: the world's light is {world.appearance} already")
    variation = Variation(of_content=content, of_world=arn, changes=changes)
    return measured(varied.model_copy(update={"variation": variation}))


def _with_door(world: World, name: str, percent: float) -> tuple[World, Change]:
    passages = list(world.floorplan.passages)
    index = _door_index(passages, name)
    door = passages[index].door
    assert door is not None
    if door.open_percent == percent:
        raise ConfigurationError(f"{name} is {percent:g} % open already")
    passages[index] = passages[index].model_copy(update={"door": door.model_copy(update={"open_percent": percent})})
    plan = world.floorplan.model_copy(update={"passages": passages})
    before, after = f"{door.open_percent:g} % open", f"{percent:g} % open"
    return world.model_copy(update={"floorplan": plan}), Change(what="door", thing=door.id, before=before, after=after)


def _door_index(passages: Sequence[Passage], name: str) -> int:
    names = {passage.door.id: index for index, passage in enumerate(passages) if passage.door}
    if name in names:
        return names[name]
    between = [
        index
        for index, passage in enumerate(passages)
        if passage.door and name in ("/".join(passage.rooms), "/".join(passage.rooms[::-1]))
    ]
    if len(between) > 1:
        raise ConfigurationError(f"{name}: {len(between)} doors; name one of {', '.join(names)}")
    if not between:
        raise ConfigurationError(f"the world has no door {name!r}{_doorless(passages, name) or _instead(name, names)}")
    return between[0]


def _doorless(passages: Sequence[Passage], name: str) -> str:
    """Returns why two rooms that a name joins have no door between them; empty: nothing joins them."""
    kinds = [each.kind for each in passages if name in ("/".join(each.rooms), "/".join(each.rooms[::-1]))]
    if not kinds:
        return ""
    if "Doorway" in kinds:
        return "; its doorway has none; doorways of worlds whose template has version 2 have doors"
    return "; an opening joins its rooms, which has none; a template's ConnectionType Doorway, in version 2, makes one"


def _with_moved(world: World, name: str, move: Move) -> tuple[World, list[Change]]:
    """Returns the world with a piece of furniture moved together with all objects on it, and the changes.

    Raises ConfigurationError if there is no such piece, it would leave all rooms, or it stands fast and cannot turn
    so.
    """
    piece = _piece(world, name)
    if not piece.movable and move.turn_deg % 90:
        raise ConfigurationError(
            f"{name} stands fast, square to the walls, and cannot turn by {move.turn_deg:g} degrees; 90, 180 or 270 "
            "would be right"
        )
    c, s = cos(radians(move.turn_deg)), sin(radians(move.turn_deg))
    along = {item.id for item in (piece, *_carried(world, piece))}
    furniture: list[Furniture] = []
    changes: list[Change] = []
    for item in world.furniture:
        if item.id not in along:
            furniture.append(item)
            continue
        u, v = item.x - piece.x, item.y - piece.y
        x, y = piece.x + move.east_m + c * u - s * v, piece.y + move.north_m + s * u + c * v
        rooms = [room.name for room in world.floorplan.rooms if contains(room.polygon, x, y)]
        if not rooms:
            raise ConfigurationError(f"{item.id} would be at ({x:.2f}, {y:.2f}) m, outside of every room")
        new = {"x": round(x, 4), "y": round(y, 4), "yaw": item.yaw + radians(move.turn_deg), "room": rooms[0]}
        furniture.append(item.model_copy(update=new))
        changes.append(Change(what="moved", thing=item.id, before=_place(item), after=_place(furniture[-1])))
    return world.model_copy(update={"furniture": furniture}), changes


def _without(world: World, name: str) -> tuple[World, list[Change]]:
    """Removes a piece of furniture together with all objects on it.

    The world given stays as it is. Returns the new world, and a change for each removed piece. Raises
    ConfigurationError if the world has no such piece.
    """
    piece = _piece(world, name)
    gone = [piece, *_carried(world, piece)]
    rest = [item for item in world.furniture if item not in gone]
    changes = [Change(what="removed", thing=item.id, before=_place(item), after="not there") for item in gone]
    return world.model_copy(update={"furniture": rest}), changes


def _piece(world: World, name: str) -> Furniture:
    pieces = {item.id: item for item in world.furniture}
    if name not in pieces:
        raise ConfigurationError(f"the world has no piece {name!r}{_instead(name, pieces)}")
    return pieces[name]


def _carried(world: World, piece: Furniture) -> list[Furniture]:
    """Returns the objects that rest on a furnishing, but not those on the table that a chair is pushed under."""
    parts, (c, s) = parts_of(piece), turn(piece.yaw)
    carried: list[Furniture] = []
    for item in world.furniture:
        east, north = item.x - piece.x, item.y - piece.y
        x, y = c * east + s * north, c * north - s * east
        level = height_at(parts, (x, y, x, y))
        if level is not None and item.base_m > piece.base_m and abs(piece.base_m + level - item.base_m) < _TOUCHES_M:
            carried.append(item)
    return carried


def _place(item: Furniture) -> str:
    return f"at ({item.x:.2f}, {item.y:.2f}) m in {item.room}, turned {degrees(item.yaw) % 360:.0f} degrees"


def _instead(name: str, names: Collection[str]) -> str:
    """Suggests a name for an unknown one, to end an error message: `; did you mean 'chair_2'?`, or `; it has ...`.

    The most similar existing name is suggested, else the first ones that exist.
    """
    if near := get_close_matches(name, names, n=1):
        return f"; did you mean {near[0]!r}?"
    shown = ", ".join(sorted(names)[:_MOST_NAMED])
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return f"; it has {shown}{more}" if names else "; it has none"
