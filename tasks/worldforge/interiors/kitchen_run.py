"""A kitchen's line: appliances and counters edge to edge along one wall or a corner; and seating of living rooms.

The order is that of the work: food comes out of the fridge at one end, is prepared on a counter beside the
oven, and goes back to the sink, which has the dishwasher at its side.
"""

from collections.abc import Iterator, Sequence
from math import hypot, inf
from typing import NamedTuple

from ..furniture.arrangement import RULES, Density, front_of
from ..geometry.boxes import Box, Pose, footprint
from ..geometry.parts import Style
from .candidates import FLUSH_M, against_walls, facing, in_the_open
from .placement import WALL_GAP_M, Side
from .room_furnishing import RoomFurnishing

_COUNTERS: dict[Density, int] = {"Sparse": 0, "Moderate": 1, "Dense": 2}
"""Counters besides the one with the sink."""

_CORNER_M = 0.2
_MOST_TRIES = 16


class Unit(NamedTuple):
    """One piece of a kitchen's row of cabinets and appliances."""

    kind: str
    style: Style
    blind: bool = False
    """Whether it stands in the corner, behind the other half of the line: people do not stand before it."""


Placed = list[tuple[Unit, Pose]]


def line_up(work: RoomFurnishing, kinds: Sequence[str]) -> None:
    """Places a kitchen's row of cabinets and appliances along walls.

    Args:
        work: the kitchen; nothing stands in it yet.
        kinds: what belongs to the line.
    """
    if not kinds:
        return
    counters = _COUNTERS[work.density] if "Storage" in kinds else 0
    for number in range(counters, -1, -1):
        cooking, washing = _units(work, kinds, number)
        if _settle(work, _along_one_wall(work, [*cooking, *washing])):
            return
        if number and washing and _settle(work, _around_a_corner(work, cooking, washing)):
            return
    cooking, washing = _units(work, kinds, 0)
    for half in (washing, cooking):
        if half:
            _settle(work, _along_one_wall(work, half))


def _units(work: RoomFurnishing, kinds: Sequence[str], counters: int) -> tuple[list[Unit], list[Unit]]:
    """The two halves of the line, each from its outer end to where they meet."""
    styles = {kind: work.styles(kind) for kind in kinds}
    counter = next((style for style in styles.get("Storage", []) if style.form != "counter-sink"), None)
    spare = [] if counter is None else [Unit("Storage", counter)] * counters
    cooking = [Unit(kind, styles[kind][0]) for kind in ("Fridges", "Ovens") if kind in styles]
    # The first counter is beside the oven, towards the sink; the next between fridge and oven.
    cooking += spare[:1]
    cooking[1:1] = spare[1:2]
    washed = ("Storage", "DishWashers", "WashingMachinesAndDryers")
    washing = [Unit(kind, styles[kind][0]) for kind in washed if kind in styles]
    return cooking, [*washing, *spare[2:]]


def _along_one_wall(work: RoomFurnishing, units: Sequence[Unit]) -> Iterator[tuple[float, Placed]]:
    """The line at both ends of every free stretch of wall, either way round."""
    length = sum(unit.style.width_m for unit in units) + FLUSH_M * (len(units) - 1)
    depth, front = _reach(work, units)
    for side in work.space.sides:
        liking = 0.4 * work.dice.random()
        for low, high in work.space.spans(side, depth, front):
            if high - low < length:
                continue
            for start in (low, high - length):
                for order in (units, units[::-1]):
                    placed = _in_line(side, order, start)
                    yield liking + _score(side, order, start, length), placed


def _reach(work: RoomFurnishing, units: Sequence[Unit]) -> tuple[float, float]:
    """Depth of the shallowest unit, and the least that any needs before it."""
    return min(unit.style.depth_m for unit in units), min(front_of(unit.kind, work.room.type) for unit in units)


def _score(side: Side, order: Sequence[Unit], start: float, length: float) -> float:
    """A line begins in a corner, best with the fridge."""
    at_low, at_high = start - side.low < _CORNER_M, side.high - start - length < _CORNER_M
    fridge = (at_low and order[0].kind == "Fridges") or (at_high and order[-1].kind == "Fridges")
    return 1.0 * (at_low or at_high) + 0.6 * fridge


def _in_line(side: Side, units: Sequence[Unit], start: float) -> Placed:
    """Units from a point on, their backs to the wall."""
    placed: Placed = []
    for unit in units:
        width, depth = unit.style.width_m, unit.style.depth_m
        placed.append((unit, side.pose(start + width / 2, WALL_GAP_M + depth / 2)))
        start += width + FLUSH_M
    return placed


def _around_a_corner(
    work: RoomFurnishing, cooking: Sequence[Unit], washing: Sequence[Unit]
) -> Iterator[tuple[float, Placed]]:
    """One half on each of two walls that meet; a counter fills the corner."""
    corner = cooking[-1]._replace(blind=True)
    outward = [corner, *reversed(cooking[:-1])]
    for first in work.space.sides:
        for second in work.space.sides:
            ends = _meet(first, second)
            if ends is None:
                continue
            one = _from(first, outward, ends[0], WALL_GAP_M)
            other = _from(second, washing, ends[1], WALL_GAP_M + corner.style.depth_m + FLUSH_M)
            yield work.dice.random(), [*one, *other]


def _meet(first: Side, second: Side) -> tuple[tuple[float, int], tuple[float, int]] | None:
    """Inside corner of two walls: for each the coordinate of the other's face, and the way from it; None: no corner."""
    if (first.quarter - second.quarter) % 2 == 0:
        return None
    found: list[tuple[float, int]] = []
    for side, other in ((first, second), (second, first)):
        if 0 < other.face - side.low < _CORNER_M:
            found.append((other.face, 1))
        elif 0 < side.high - other.face < _CORNER_M:
            found.append((other.face, -1))
    return (found[0], found[1]) if len(found) == 2 else None


def _from(side: Side, units: Sequence[Unit], end: tuple[float, int], gap: float) -> Placed:
    """Units along a wall, from one of its ends on."""
    at, way = end
    if way > 0:
        return _in_line(side, units, at + gap)
    length = sum(unit.style.width_m for unit in units) + FLUSH_M * (len(units) - 1)
    return _in_line(side, units[::-1], at - gap - length)


def _settle(work: RoomFurnishing, options: Iterator[tuple[float, Placed]]) -> bool:
    """Places the best option that fits as a whole; says whether there was one."""
    tries = 0
    for _, placed in sorted(options, key=lambda option: -option[0]):
        if not all(_fits(work, unit, pose) for unit, pose in placed):
            continue
        if work.space.stays_open(*(footprint(pose, unit.style.width_m, unit.style.depth_m) for unit, pose in placed)):
            for unit, pose in placed:
                work.stand(unit.kind, unit.style, pose, zone=not unit.blind)
            return True
        tries += 1
        if tries == _MOST_TRIES:
            break
    return False


def _fits(work: RoomFurnishing, unit: Unit, pose: Pose) -> bool:
    if unit.blind:
        return work.space.admits(footprint(pose, unit.style.width_m, unit.style.depth_m))
    return work.fits(unit.kind, unit.style, pose)


_MOST_SEAT_TRIES = 12
_BEST_WALLS = 10
"""Spots for the screen that seats are looked for opposite of."""

_HALF_SIGHT_M = 0.4


def arrange_seating(work: RoomFurnishing) -> None:
    """Places a television and a sofa opposite each other; nothing if no pair fits.

    They are chosen together, because the wall that suits the screen best often has nothing opposite it.
    """
    for screen in work.styles("MediaStorage"):
        for sofa in work.styles("Sofas"):
            if _place_pair(work, screen, sofa):
                return


GROUP = ("Sofas", "CoffeeTables", "LivingRoomChairs")
"""Kinds of furniture that people who talk sit around and on."""

_FLOOR_OF_GROUP_M2: dict[Density, float] = {"Sparse": inf, "Moderate": 70.0, "Dense": 45.0}
_MOST_GROUPS = 4
_TABLE_GAP_M, _CHAIR_GAP_M, _BETWEEN_CHAIRS_M = 0.4, 0.46, 0.2
_AROUND_M = 0.7
"""Free around a group: a robot passes."""

_GROUP_TRIES = 300


def arrange_groups(work: RoomFurnishing) -> None:
    """Places further seating groups (sofa, table, two armchairs) in a large room."""
    for _ in range(min(_MOST_GROUPS, int(work.room.floor_m2 / _FLOOR_OF_GROUP_M2[work.density]))):
        if not _place_group(work):
            return


def _place_group(work: RoomFurnishing) -> bool:
    sofa, table, chair = (work.styles(kind)[0] for kind in GROUP)
    to_table = sofa.depth_m / 2 + _TABLE_GAP_M + table.depth_m / 2
    to_chairs = to_table + table.depth_m / 2 + _CHAIR_GAP_M + chair.depth_m / 2
    aside = (chair.width_m + _BETWEEN_CHAIRS_M) / 2
    half = max(sofa.width_m, table.width_m, 2 * aside + chair.width_m) / 2 + _AROUND_M
    spots = in_the_open(work.space, work.dice, [])
    some = work.dice.sample(spots, min(_GROUP_TRIES, len(spots)))
    for spot in sorted(some, key=lambda spot: -_away(spot, work)):
        if not work.space.admits(
            spot.box(-sofa.depth_m / 2 - _AROUND_M, to_chairs + chair.depth_m / 2 + _AROUND_M, -half, half)
        ):
            continue
        chairs = [("LivingRoomChairs", chair, spot.moved(to_chairs, side * aside, 2)) for side in (1, -1)]
        group = [("Sofas", sofa, spot), ("CoffeeTables", table, spot.moved(to_table, 0.0, 2)), *chairs]
        if work.space.stays_open(*(footprint(pose, style.width_m, style.depth_m) for _, style, pose in group)):
            for kind, style, pose in group:
                work.stand(kind, style, pose)
            return True
    return False


def _away(spot: Pose, work: RoomFurnishing) -> float:
    """How far a spot is from all furniture: groups spread over the room."""
    return min((hypot(item.x - spot.x, item.y - spot.y) for item in work.items), default=0.0)


def _place_pair(work: RoomFurnishing, screen: Style, sofa: Style) -> bool:
    rule = RULES["MediaStorage"]
    walls = against_walls(work.space, screen, rule.front_m, rule.prefer, work.dice, tall=True)
    pairs = [
        (wall.score + seat.score, wall, seat)
        for wall in sorted(walls, key=lambda wall: -wall.score)[:_BEST_WALLS]
        for seat in facing(work.space, wall, screen.depth_m, sofa)
    ]
    tries = 0
    for _, wall, seat in sorted(pairs, key=lambda pair: -pair[0]):
        sight = _sight(wall, screen, seat, sofa)
        if not work.space.is_clear(sight) or not work.fits("Sofas", sofa, seat):
            continue
        if not work.fits("MediaStorage", screen, wall):
            continue
        boxes = footprint(wall, screen.width_m, screen.depth_m), footprint(seat, sofa.width_m, sofa.depth_m)
        if work.space.stays_open(*boxes):
            work.stand("MediaStorage", screen, wall)
            work.space.keep_clear(work.stand("Sofas", sofa, seat).id, sight)
            return True
        tries += 1
        if tries == _MOST_SEAT_TRIES:
            break
    return False


def _sight(wall: Pose, screen: Style, seat: Pose, sofa: Style) -> Box:
    """Line of sight between the screen and the sofa, as a box."""
    distance = abs(seat.x - wall.x) if wall.quarter % 2 == 0 else abs(seat.y - wall.y)
    return wall.box(screen.depth_m / 2, distance - sofa.depth_m / 2, -_HALF_SIGHT_M, _HALF_SIGHT_M)
