"""Variations: the same world with a door shut, a piece moved or taken away, or another light, and proved again."""

from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from math import cos, degrees, radians, sin
from typing import NamedTuple

from ...schemas.wire.errors import ConfigurationError
from ...schemas.worlds.polygons import contains
from ...schemas.worlds.world import Change, Furniture, Light, Passage, Variation, World
from .furniture.catalogue import parts_of
from .furniture.solids import turn
from .furniture.tops import height_at
from .generator import GENERATOR_VERSION, measured

_MOST_NAMED = 12
_TOUCHES_M = 2e-3
"""How near to a level things lie: the world says it to a tenth of a millimetre, and a round top ends 1 mm lower."""


class Move(NamedTuple):
    """Displacement of a piece of furniture: metres to the east and north, and a turn in degrees."""

    east_m: float
    north_m: float
    turn_deg: float = 0.0
    """Counter-clockwise, about its middle."""


class Wanted(NamedTuple):
    """Requested differences from the world."""

    doors: Mapping[str, float] = {}
    """How far doors are open, in percent; a door is named by its id, or by its two rooms: `Hall/Bedroom`."""
    moved: Mapping[str, Move] = {}
    removed: Sequence[str] = ()
    light: Light | None = None


def vary(world: World, wanted: Wanted, content: str, arn: str | None = None) -> World:
    """Makes a world that differs in what is wanted and in nothing else, and measures it.

    It may break guarantees that the other world keeps; its checks say so.

    Args:
        world: the other world, which is left as it is.
        wanted: what is to differ.
        content: the other world's hash.
        arn: its ARN.

    Raises:
        ConfigurationError: there is no such door or piece, nothing differs, or another generator made the world.
    """
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
        raise ConfigurationError(f"the world has no door {name!r}{_instead(name, names)}")
    return between[0]


def _with_moved(world: World, name: str, move: Move) -> tuple[World, list[Change]]:
    """A piece goes elsewhere with all that stands on it."""
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
    """A piece is taken away with all that stands on it."""
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
    """Furniture that rests on a piece, not what is on the table that a chair is pushed under."""
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
    """Suggestion for an unknown name: the most similar one, else the first of those that exist."""
    if near := get_close_matches(name, names, n=1):
        return f"; did you mean {near[0]!r}?"
    shown = ", ".join(sorted(names)[:_MOST_NAMED])
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return f"; it has {shown}{more}" if names else "; it has none"
