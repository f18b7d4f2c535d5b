"""Candidate poses of furniture in a room, each with a score; whether they fit is checked later."""

from collections.abc import Iterator
from math import hypot
from random import Random

from ....schemas.worlds.world import Furniture
from ..furniture.catalogue import parts_of
from ..geometry.boxes import Box, Pose, pose_of
from ..geometry.parts import Style
from .room_space import WALL_GAP_M, RoomSpace, Side

TUCK_M = 0.13
"""Distance that chairs are pushed under their table, in metres."""

DESK_SEAT_M = 0.12
"""Offset of a chair to the left of its desk's middle, in metres: drawers are on the right."""

_LEG_GAP_M = 0.01
"""Gap between a chair that is pushed in and a leg of the table, in metres."""

_SEAT_M = 0.5
"""Height above which a part does not block a chair, in metres."""

FLUSH_M = 0.004
"""Gap between pieces that are placed edge to edge, in metres."""

_STEP_M = 0.3
OPEN_SCORE = -2.0
"""Lowest score of a furniture pose away from walls."""

_END_ON_SCORE = -3.0
_CORNER_M = 0.2
_BESIDE_GAP_M = 0.04
_NEAREST_SCREEN_M = 1.7
_FARTHEST_SCREEN_M = 4.2
_BEST_SCREEN_M = 2.5
"""Best distance between a television and the sofa opposite, in metres: about three times the width of the screen."""


def against_walls(
    space: RoomSpace, style: Style, front_m: float, prefer: str, dice: Random, *, tall: bool = False
) -> list[Pose]:
    """Returns candidate poses of a piece of furniture with its back to a wall.

    Args:
        space: The room.
        style: The piece.
        front_m: Free space in front of it, in metres.
        prefer: `middle`, `corner` or `any`.
        dice: The source of chance.
        tall: Whether the piece must not stand before a window.
    """
    poses: list[Pose] = []
    inward = WALL_GAP_M + style.depth_m / 2
    for side in space.sides:
        liking = 0.5 * dice.random()
        for low, high in space.spans(side, style.depth_m, front_m, tall=tall):
            slack = high - low - style.width_m
            if slack < 0:
                continue
            for share in (0.0, 0.25, 0.5, 0.75, 1.0) if slack > 0.05 else (0.0,):
                along = low + style.width_m / 2 + share * slack
                score = liking + _wall_score(side, along, style.width_m, share, prefer) + 0.3 * dice.random()
                poses.append(side.pose(along, inward, score))
    return poses


def _wall_score(side: Side, along: float, width_m: float, share: float, prefer: str) -> float:
    """Scores a spot on a wall, higher for better: near its middle, near its corners, or beside neighbours.

    Args:
        side: The wall.
        along: The middle of the spot, in metres along the wall.
        width_m: The width of the piece.
        share: The spot's place in its free stretch: 0 at the first end, 1 at the other.
        prefer: `middle`, `corner`, or another word for anywhere.
    """
    off_middle = abs(along - (side.low + side.high) / 2) / max(side.high - side.low, 1e-6)
    if prefer == "middle":
        return 1.2 - 2.0 * off_middle - (0.4 if share in (0.0, 1.0) else 0.0)
    off_corner = min(along - side.low, side.high - along) - width_m / 2
    if prefer == "corner":
        return (0.6 if share in (0.0, 1.0) else 0.0) - min(off_corner, 2.0)
    # Anywhere, but rather flush with a neighbour or a corner than with a useless gap beside it.
    return 0.4 if share in (0.0, 0.5, 1.0) else 0.0


def in_corners(space: RoomSpace, style: Style, dice: Random) -> list[Pose]:
    """Returns candidate poses of a piece of furniture in the room's corners."""
    poses: list[Pose] = []
    inward, sideways = WALL_GAP_M + style.depth_m / 2, WALL_GAP_M + style.width_m / 2
    for side in space.sides:
        for other in space.sides:
            if (side.quarter - other.quarter) % 2 == 0:
                continue
            # Inside corners only: the other wall's face lies a little within this one's end.
            if 0 < other.face - side.low < _CORNER_M:
                poses.append(side.pose(other.face + sideways, inward, dice.random()))
            elif 0 < side.high - other.face < _CORNER_M:
                poses.append(side.pose(other.face - sideways, inward, dice.random()))
    return poses


def in_the_open(space: RoomSpace, dice: Random, run: list[Furniture]) -> list[Pose]:
    """Returns candidate poses of a piece of furniture away from walls; those in the middle of the room score best."""
    x0, y0, x1, y1 = space.bounds
    middle_x, middle_y = (x0 + x1) / 2, (y0 + y1) / 2
    columns, rows = int((x1 - x0 - 0.8) / 2 / _STEP_M), int((y1 - y0 - 0.8) / 2 / _STEP_M)
    # A long table lies along a long room: fronts face its long sides.
    best_turn = (pose_of(run[0]).quarter + 2) % 4 if run else int(x1 - x0 >= y1 - y0)
    turns = (best_turn, (best_turn + 1) % 4)
    poses: list[Pose] = []
    for column in range(-columns, columns + 1):
        for row in range(-rows, rows + 1):
            x, y = middle_x + column * _STEP_M, middle_y + row * _STEP_M
            off = ((x - middle_x) / (x1 - x0)) ** 2 + ((y - middle_y) / (y1 - y0)) ** 2
            score = -2.0 * off**0.5 + 0.15 * dice.random()
            poses += [Pose(x, y, turn, score + (0.4 if turn == best_turn else 0.0)) for turn in turns]
    return poses


def end_on(space: RoomSpace, style: Style) -> list[Pose]:
    """Returns candidate poses of a table with one end at a wall; they score below those away from walls."""
    poses: list[Pose] = []
    for side in space.sides:
        first, last = side.low + style.depth_m / 2, side.high - style.depth_m / 2
        for step in range(max(0, int((last - first) / _STEP_M)) + 1):
            pose = side.pose(first + step * _STEP_M, WALL_GAP_M + style.width_m / 2)
            poses.append(pose._replace(quarter=(pose.quarter + 1) % 4, score=_END_ON_SCORE))
    return poses


def distance(pose: Pose, box: Box) -> float:
    """Returns the distance in metres from a pose's middle to a rectangle."""
    return hypot(max(box[0] - pose.x, pose.x - box[2], 0.0), max(box[1] - pose.y, pose.y - box[3], 0.0))


def beside(partner: Furniture, style: Style, dice: Random) -> list[Pose]:
    """Returns candidate poses of furniture beside another piece, with backs in line."""
    back = -(partner.depth_m - style.depth_m) / 2
    across = partner.width_m / 2 + _BESIDE_GAP_M + style.width_m / 2
    return [pose_of(partner).moved(back, side * across, 0, dice.random()) for side in (1, -1)]


def before(partner: Furniture, style: Style, gap_m: float, dice: Random) -> list[Pose]:
    """Returns candidate poses of furniture in front of another piece, turned towards it."""
    distance = partner.depth_m / 2 + gap_m + style.depth_m / 2
    return [
        pose_of(partner).moved(distance, shift, 2, 0.2 * dice.random() - abs(shift)) for shift in (0.0, 0.25, -0.25)
    ]


def gathered(table: Furniture, style: Style, gap_m: float, dice: Random) -> list[Pose]:
    """Returns candidate poses of armchairs at the ends of a coffee table, turned towards it."""
    reach = table.width_m / 2 + gap_m + style.depth_m / 2
    # A table's front is turned to its sofa: a little away from it, chairs leave the way to the sofa open.
    return [
        pose_of(table).moved(back, side * reach, 3 if side == 1 else 1, 1.0 + 0.5 * dice.random() + back)
        for side in (1, -1)
        for back in (0.0, -0.2, -0.4)
    ]


def around(table: Furniture, style: Style) -> list[Pose]:
    """Returns candidate poses of chairs at a table, pushed in between its legs."""
    pose = pose_of(table)
    seats = max(1, int(table.width_m / (style.width_m + 0.12)))
    tuck, farthest = _between_legs(table, style, at_end=False)
    reach = table.depth_m / 2 + style.depth_m / 2 - tuck
    shifts = sorted(((i + 0.5) * table.width_m / seats - table.width_m / 2 for i in range(seats)), key=abs)
    poses: list[Pose] = []
    for index, wished in enumerate(shifts):
        shift = max(-farthest, min(wished, farthest))
        poses.append(pose.moved(reach, shift, 2, 1.0 - 0.1 * index))
        poses.append(pose.moved(-reach, shift, 0, 1.0 - 0.1 * index))
    tuck, _ = _between_legs(table, style, at_end=True)
    ends = table.width_m / 2 + style.depth_m / 2 - tuck
    return [*poses, pose.moved(0.0, ends, 3), pose.moved(0.0, -ends, 1)]


def sits_at(chair: Furniture, table: Furniture) -> bool:
    """Whether a chair is at a table."""
    return hypot(chair.x - table.x, chair.y - table.y) < (table.width_m + chair.depth_m) / 2 + 0.1


def _between_legs(table: Furniture, style: Style, *, at_end: bool) -> tuple[float, float]:
    """Returns how far a chair fits under a table, and its largest offset from the middle of that side then."""
    along, across = (0, 1) if at_end else (1, 0)
    size = (table.depth_m, table.width_m)
    free = size[along] / 2
    for part in parts_of(table):
        low = part.center[2] - part.size[2] / 2
        if (
            part.solid
            and low < _SEAT_M
            and abs(part.center[across]) + part.size[across] / 2 > size[across] / 2 - TUCK_M
        ):
            free = min(free, abs(part.center[along]) - part.size[along] / 2 - _LEG_GAP_M)
    farthest = free - style.width_m / 2
    # A chair too wide for the legs stands before them.
    return (TUCK_M, farthest) if farthest >= 0 else (0.0, max(0.0, (size[along] - style.width_m) / 2))


def at_desk(desk: Furniture, style: Style) -> list[Pose]:
    """Returns candidate poses of a chair at a desk."""
    reach = desk.depth_m / 2 + style.depth_m / 2 - TUCK_M
    return [pose_of(desk).moved(reach, DESK_SEAT_M, 2)]


def next_to(item: Furniture, style: Style) -> list[Pose]:
    """Returns candidate poses of furniture directly next to a piece, with backs in line."""
    back = -(item.depth_m - style.depth_m) / 2
    across = item.width_m / 2 + style.width_m / 2 + FLUSH_M
    return [pose_of(item).moved(back, side * across, 0, 0.5) for side in (1, -1)]


def facing(space: RoomSpace, screen: Pose, screen_depth_m: float, style: Style) -> Iterator[Pose]:
    """Yields candidate poses of seats opposite a television."""
    depth = style.depth_m
    steps: list[tuple[float, float]] = [(distance, -0.7) for distance in (_BEST_SCREEN_M, 2.1, 2.9)]
    for side in space.sides:
        if side.quarter == (screen.quarter + 2) % 4:
            span = abs(side.face - (screen.x if side.axis else screen.y))
            distance = span - screen_depth_m / 2 - depth - WALL_GAP_M
            if _NEAREST_SCREEN_M <= distance <= _FARTHEST_SCREEN_M:
                steps.append((distance, 0.5))
    for distance, liking in steps:
        for shift in (0.0, 0.35, -0.35):
            score = liking - 0.35 * abs(distance - _BEST_SCREEN_M) - 0.6 * abs(shift)
            yield screen.moved(screen_depth_m / 2 + distance + depth / 2, shift, 2, score)


def facing_bonus(pose: Pose, partner: Furniture) -> float:
    """Returns the score bonus of a pose that faces a partner piece at a good distance."""
    x, y = partner.x - pose.x, partner.y - pose.y
    distance = max((x * x + y * y) ** 0.5, 1e-6)
    here, there = pose.moved(1.0, 0.0), pose_of(partner).moved(1.0, 0.0)
    looks = (x * (here.x - pose.x) + y * (here.y - pose.y)) / distance
    before_it = -(x * (there.x - partner.x) + y * (there.y - partner.y)) / distance
    return (2 * looks if before_it > 0.5 else 0.0) + 1.5 * before_it - 0.4 * abs(distance - 2.8)
