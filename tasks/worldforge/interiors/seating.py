"""Seating of a living room: a screen on one wall and a sofa that faces it, placed as a pair."""

from ..furniture.arrangement import RULES
from ..geometry.boxes import Box, Pose, footprint
from ..geometry.parts import Style
from .candidates import against_walls, facing
from .room_furnishing import RoomFurnishing

_MOST_TRIES = 12
_BEST_WALLS = 10
"""Spots for the screen that seats are looked for opposite of."""

_HALF_SIGHT_M = 0.4


def arrange_seating(work: RoomFurnishing) -> None:
    """Places a screen and a sofa opposite it, with the line of sight kept free; nothing where no pair fits.

    They are chosen together, because the wall that suits the screen best often has nothing opposite it.
    """
    for screen in work.styles("MediaStorage"):
        for sofa in work.styles("Sofas"):
            if _place_pair(work, screen, sofa):
                return


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
        if tries == _MOST_TRIES:
            break
    return False


def _sight(wall: Pose, screen: Style, seat: Pose, sofa: Style) -> Box:
    """What lies between the screen and the sofa."""
    distance = abs(seat.x - wall.x) if wall.quarter % 2 == 0 else abs(seat.y - wall.y)
    return wall.box(screen.depth_m / 2, distance - sofa.depth_m / 2, -_HALF_SIGHT_M, _HALF_SIGHT_M)
