"""Seating: a television with a sofa opposite it, further groups in large rooms, and two chairs on a balcony."""

from dataclasses import replace
from math import hypot, inf

from ..furniture.usual_furniture import RULES, Density
from ..geometry.boxes import Box, Pose, footprint, pose_of
from ..geometry.parts import Style
from .candidate_poses import against_walls, facing, in_the_open
from .room_furnishing import RoomFurnishing

_MOST_SEAT_TRIES = 12
_BEST_WALLS = 10
"""Number of best wall positions for a television that are tried when looking for seats opposite."""

_HALF_SIGHT_M = 0.4


def arrange_seating(work: RoomFurnishing, *, table: bool) -> None:
    """Places a television and a sofa opposite each other; nothing if no pair fits.

    They are chosen together, because the wall that suits the screen best often has nothing opposite it.

    Args:
        work: The room.
        table: Whether a coffee table belongs to them; they come without it only where no place has room for all.
    """
    screens, sofas = work.styles("MediaStorage"), work.styles("Sofas")
    tables: list[Style | None] = [work.styles("CoffeeTables")[0], None] if table else [None]
    for coffee_table in tables:
        for screen in screens:
            for sofa in sofas:
                if _place_pair(work, screen, sofa, coffee_table):
                    return


def is_watched(work: RoomFurnishing) -> bool:
    """Whether a sofa stands opposite a television."""
    return any(
        (screen.quarter - sofa.quarter) % 4 == 2
        and abs(sofa.x - screen.x if screen.quarter % 2 else sofa.y - screen.y) < _HALF_SIGHT_M
        for screen in map(pose_of, work.placed("MediaStorage"))
        for sofa in map(pose_of, work.placed("Sofas"))
    )


GROUP = ("Sofas", "CoffeeTables", "LivingRoomChairs")
"""Kinds of furniture of a seating group."""

_FLOOR_OF_GROUP_M2: dict[Density, float] = {"Sparse": inf, "Moderate": 70.0, "Dense": 45.0}
_MOST_GROUPS = 4
_TABLE_GAP_M, _CHAIR_GAP_M, _BETWEEN_CHAIRS_M = 0.4, 0.46, 0.2
_AROUND_M = 0.7
"""Free space around a seating group, in metres, through which a robot passes."""

_GROUP_TRIES = 300


def arrange_groups(work: RoomFurnishing) -> None:
    """Places further seating groups (sofa, table, two armchairs) in a large room.

    It ends with the first group that finds no place.
    """
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
                work.place_at(kind, style, pose)
            return True
    return False


_FROM_SMALL_TABLE_M = 0.05
"""Gap between a small table and the chairs at it, in metres: knees are beside it."""


def arrange_balcony(work: RoomFurnishing) -> None:
    """Places two chairs that face each other across a small table, along a wall or railing; nothing if they do not fit.

    Args:
        work: The balcony.
    """
    chair, table = work.style_of("DiningChairs", "ladder"), work.styles("EndAndSideTables")[0]
    aside = table.width_m / 2 + _FROM_SMALL_TABLE_M + chair.depth_m / 2
    row = replace(table, width_m=2 * aside + chair.depth_m, depth_m=max(table.depth_m, chair.width_m))
    for pose in sorted(against_walls(work.space, row, 0.0, "corner", work.dice), key=lambda pose: -pose.score):
        chairs = [("DiningChairs", chair, pose.moved(0.0, side * aside, -side)) for side in (1, -1)]
        group = [("EndAndSideTables", table, pose), *chairs]
        boxes = [footprint(each, style.width_m, style.depth_m) for _, style, each in group]
        if all(map(work.space.admits, boxes)) and work.space.stays_open(*boxes):
            for kind, style, each in group:
                work.place_at(kind, style, each)
            return


def _away(spot: Pose, work: RoomFurnishing) -> float:
    """Returns the distance of a point from all furniture, so that seating groups spread over the room."""
    return min((hypot(item.x - spot.x, item.y - spot.y) for item in work.items), default=0.0)


def _place_pair(work: RoomFurnishing, screen: Style, sofa: Style, table: Style | None) -> bool:
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
        pieces = [("MediaStorage", screen, wall), ("Sofas", sofa, seat)]
        if table is not None:
            to_table = sofa.depth_m / 2 + RULES["CoffeeTables"].gap_m + table.depth_m / 2
            pieces.append(("CoffeeTables", table, seat.moved(to_table, 0.0, 2)))
        boxes = [footprint(pose, style.width_m, style.depth_m) for _, style, pose in pieces]
        if not all(map(work.space.admits, boxes)):
            continue
        if work.space.stays_open(*boxes):
            stood = [work.place_at(kind, style, pose) for kind, style, pose in pieces]
            work.space.keep_clear(stood[1].id, sight)
            return True
        tries += 1
        if tries == _MOST_SEAT_TRIES:
            break
    return False


def _sight(wall: Pose, screen: Style, seat: Pose, sofa: Style) -> Box:
    """Returns the line of sight between the screen and the sofa, as a box."""
    distance = abs(seat.x - wall.x) if wall.quarter % 2 == 0 else abs(seat.y - wall.y)
    return wall.box(screen.depth_m / 2, distance - sofa.depth_m / 2, -_HALF_SIGHT_M, _HALF_SIGHT_M)
