"""Poses a piece of furniture could take in a room, each with a score; which of them fit is asked later."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...schemas.world import Floorplan, Furniture, Room
from .parts import Style
from .placement import Rects

_WALL_GAP_M = 0.015
_STEP_M = 0.1
_FRONTS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])

TUCK_M = 0.13
"""How far chairs are pushed under their table."""


@dataclass(frozen=True)
class Poses:
    """Candidate poses; arrays of equal length."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    quarter: NDArray[np.int64]
    """Facing direction in quarter turns from +x."""
    score: NDArray[np.float64]
    """Higher is better."""

    def __len__(self) -> int:
        return len(self.x)

    def footprints(self, style: Style) -> Rects:
        """What the piece would cover."""
        upright = self.quarter % 2 == 1
        half_x = np.where(upright, style.width_m, style.depth_m) / 2
        half_y = np.where(upright, style.depth_m, style.width_m) / 2
        return np.stack([self.x - half_x, self.y - half_y, self.x + half_x, self.y + half_y], axis=1)

    def zones(self, style: Style, depth: float) -> Rects:
        """What would have to stay free in front of it; empty rectangles for depth 0."""
        rects = self.footprints(style)
        front = _FRONTS[self.quarter]
        if depth == 0:
            return np.stack([self.x, self.y, self.x, self.y], axis=1)
        start = np.stack([self.x, self.y], axis=1) + front * style.depth_m / 2
        end = start + front * depth
        zone = np.stack([np.minimum(start, end), np.maximum(start, end)], axis=1).reshape(-1, 4)
        upright = self.quarter % 2 == 1
        zone[~upright, 1], zone[~upright, 3] = rects[~upright, 1], rects[~upright, 3]
        zone[upright, 0], zone[upright, 2] = rects[upright, 0], rects[upright, 2]
        return zone

    def plus(self, bonus: NDArray[np.float64]) -> "Poses":
        """The same poses with other scores."""
        return Poses(self.x, self.y, self.quarter, self.score + bonus)


def joined(groups: list[Poses]) -> Poses:
    """Several groups as one."""
    return Poses(
        np.concatenate([np.empty(0), *(group.x for group in groups)]),
        np.concatenate([np.empty(0), *(group.y for group in groups)]),
        np.concatenate([np.empty(0, np.int64), *(group.quarter for group in groups)]),
        np.concatenate([np.empty(0), *(group.score for group in groups)]),
    )


def single(poses: list[tuple[float, float, int, float]]) -> Poses:
    """Poses from rows of x, y, quarter turns, score."""
    rows = np.array(poses, dtype=float).reshape(-1, 4)
    return Poses(rows[:, 0], rows[:, 1], rows[:, 2].astype(np.int64) % 4, rows[:, 3])


@dataclass(frozen=True)
class Side:
    """One side of a room, seen from inside."""

    start: NDArray[np.float64]
    """Its right end, for someone who looks into the room from the wall."""
    along: NDArray[np.float64]
    length_m: float
    quarter: int
    """Direction into the room."""
    half_wall_m: float
    """Half the thickness of the wall on it; 0 where there is none."""


def sides_of(room: Room, floorplan: Floorplan) -> list[Side]:
    """All sides of a room that have a wall."""
    sides: list[Side] = []
    for first, second in zip(room.polygon, [*room.polygon[1:], room.polygon[0]], strict=True):
        start, end = np.array(first), np.array(second)
        length = float(np.abs(end - start).sum())
        along = (end - start) / length
        axis = 0 if along[0] == 0 else 1
        half = max(
            (
                wall.thickness_m / 2
                for wall in floorplan.walls
                if not wall.lintel
                and room.name in wall.rooms
                and abs(wall.start[axis] - start[axis]) < 1e-6
                and abs(wall.end[axis] - start[axis]) < 1e-6
            ),
            default=0.0,
        )
        # The inside of a counter-clockwise polygon lies to the left of each side.
        quarter = {(1, 0): 1, (0, 1): 2, (-1, 0): 3, (0, -1): 0}[round(along[0]), round(along[1])]
        if half > 0:
            sides.append(Side(start, along, length, quarter, half))
    return sides


def against_walls(sides: list[Side], style: Style, prefer: str, rng: np.random.Generator) -> Poses:
    """Back to a wall, everywhere along it; `prefer` is `middle`, `corner` or `any`."""
    groups: list[Poses] = []
    for side in sides:
        low, high = 0.1 + _WALL_GAP_M + style.width_m / 2, side.length_m - 0.1 - _WALL_GAP_M - style.width_m / 2
        if high < low:
            continue
        spots = np.unique(np.concatenate([np.arange(low, high, _STEP_M), [high, (low + high) / 2]]))
        off_corner = np.minimum(spots - low, high - spots) / max(side.length_m, 1e-6)
        score = {"middle": 2.0, "corner": -2.0, "any": 0.0}[prefer] * off_corner + 0.5 * rng.random(len(spots))
        score += 0.4 * rng.random()
        offset = side.half_wall_m + _WALL_GAP_M + style.depth_m / 2
        at = side.start + spots[:, None] * side.along + offset * _FRONTS[side.quarter]
        groups.append(Poses(at[:, 0], at[:, 1], np.full(len(spots), side.quarter), score))
    return joined(groups)


def in_corners(sides: list[Side], style: Style, rng: np.random.Generator) -> Poses:
    """Back and right side to two walls that meet."""
    poses: list[tuple[float, float, int, float]] = []
    for before, side in zip([sides[-1], *sides[:-1]], sides, strict=True):
        # Inside corners only: the direction along the last side is the reverse of the way into the room from this one.
        if (before.quarter - side.quarter) % 4 != 3 or not np.allclose(
            before.start + before.along * before.length_m, side.start
        ):
            continue
        inward = side.half_wall_m + _WALL_GAP_M + style.depth_m / 2
        sideways = before.half_wall_m + _WALL_GAP_M + style.width_m / 2
        x, y = side.start + side.along * sideways + inward * _FRONTS[side.quarter]
        poses.append((float(x), float(y), side.quarter, float(rng.random())))
    return single(poses)


def in_the_open(bounds: tuple[float, float, float, float], rng: np.random.Generator) -> Poses:
    """Away from walls, best in the middle of the room."""
    x0, y0, x1, y1 = bounds
    xs, ys = np.meshgrid(np.arange(x0 + 0.4, x1 - 0.4, 0.2), np.arange(y0 + 0.4, y1 - 0.4, 0.2))
    x, y = xs.ravel(), ys.ravel()
    off = np.hypot((x - (x0 + x1) / 2) / (x1 - x0), (y - (y0 + y1) / 2) / (y1 - y0))
    turns = np.repeat([0, 1], len(x))
    # A long table lies along a long room: fronts face its long sides.
    lengthwise = np.where(turns == int(x1 - x0 >= y1 - y0), 0.3, 0.0)
    score = -2 * np.tile(off, 2) + lengthwise + 0.2 * rng.random(2 * len(x))
    return Poses(np.tile(x, 2), np.tile(y, 2), turns, score)


def beside(partner: Furniture, style: Style, rng: np.random.Generator) -> Poses:
    """At the partner's left or right, backs in line, looking the same way."""
    quarter, front, left = _frame(partner)
    poses: list[tuple[float, float, int, float]] = []
    for side in (1, -1):
        across = side * (partner.width_m / 2 + 0.04 + style.width_m / 2)
        back = -(partner.depth_m - style.depth_m) / 2
        x, y = np.array([partner.x, partner.y]) + across * left + back * front
        poses.append((float(x), float(y), quarter, float(rng.random())))
    return single(poses)


def before(partner: Furniture, style: Style, gap: float, rng: np.random.Generator) -> Poses:
    """In front of the partner, looking at it or, for tables, along it."""
    quarter, front, left = _frame(partner)
    distance = partner.depth_m / 2 + gap + style.depth_m / 2
    poses: list[tuple[float, float, int, float]] = []
    for shift in (0.0, 0.25, -0.25):
        x, y = np.array([partner.x, partner.y]) + distance * front + shift * left
        poses.append((float(x), float(y), quarter + 2, 0.2 * float(rng.random()) - abs(shift)))
    return single(poses)


def around(table: Furniture, style: Style) -> Poses:
    """Chairs at a table, pushed in a little: first along its sides, then at its ends."""
    quarter, front, left = _frame(table)
    reach = table.depth_m / 2 + style.depth_m / 2 - TUCK_M
    seats = max(1, int(table.width_m / (style.width_m + 0.12)))
    poses: list[tuple[float, float, int, float]] = []
    for index in range(seats):
        shift = (index + 0.5) * table.width_m / seats - table.width_m / 2
        for side in (1, -1):
            x, y = np.array([table.x, table.y]) + side * reach * front + shift * left
            poses.append((float(x), float(y), quarter + (2 if side == 1 else 0), 1.0 - 0.1 * index))
    ends = table.width_m / 2 + style.depth_m / 2 - TUCK_M
    for side in (1, -1):
        x, y = np.array([table.x, table.y]) + side * ends * left
        poses.append((float(x), float(y), quarter + (3 if side == 1 else 1), 0.0))
    return single(poses)


def at_desk(desk: Furniture, style: Style) -> Poses:
    """A chair at a desk, pushed in a little, beside the drawers."""
    quarter, front, left = _frame(desk)
    x, y = np.array([desk.x, desk.y]) + (desk.depth_m / 2 + style.depth_m / 2 - TUCK_M) * front + 0.12 * left
    return single([(float(x), float(y), quarter + 2, 0.0)])


def facing(partner: Furniture, style: Style, rng: np.random.Generator) -> Poses:
    """Opposite the partner at a comfortable distance, looking at it."""
    quarter, front, left = _frame(partner)
    poses: list[tuple[float, float, int, float]] = []
    for distance in np.arange(1.6, 3.6, 0.1):
        for shift in (0.0, 0.2, -0.2, 0.4, -0.4):
            step = partner.depth_m / 2 + distance + style.depth_m / 2
            x, y = np.array([partner.x, partner.y]) + step * front + shift * left
            score = 1.5 - 0.5 * abs(distance - 2.3) - abs(shift) + 0.2 * float(rng.random())
            poses.append((float(x), float(y), quarter + 2, score))
    return single(poses)


def facing_bonus(poses: Poses, partner: Furniture) -> NDArray[np.float64]:
    """What poses gain by looking at the partner from not too far, without anything turned away."""
    offset = np.stack([partner.x - poses.x, partner.y - poses.y], axis=1)
    distance = np.hypot(offset[:, 0], offset[:, 1])
    looks = (offset * _FRONTS[poses.quarter]).sum(axis=1) / np.maximum(distance, 1e-6)
    _, front, _ = _frame(partner)
    before_it = -(offset * front).sum(axis=1) / np.maximum(distance, 1e-6)
    return np.where(before_it > 0.5, 2 * looks, 0.0) + 1.5 * before_it - 0.4 * np.abs(distance - 2.8)


def run_bonus(poses: Poses, style: Style, run: list[Furniture]) -> NDArray[np.float64]:
    """What poses gain by standing in line with appliances that are already there."""
    rects = poses.footprints(style)
    best = np.full(len(poses), 9.0)
    for item in run:
        quarter, _, _ = _frame(item)
        along_y = quarter % 2 == 0
        half = item.width_m / 2
        low, high, at = (1, 3, item.y) if along_y else (0, 2, item.x)
        gap = np.maximum(rects[:, low] - (at + half), (at - half) - rects[:, high])
        across = np.abs(poses.x - item.x) if along_y else np.abs(poses.y - item.y)
        in_line = (poses.quarter == quarter) & (across < 0.4)
        best = np.minimum(best, np.where(in_line, np.abs(gap), 9.0))
    return -2.0 * np.minimum(best, 2.0)


def next_to(item: Furniture, style: Style) -> Poses:
    """In line with an appliance, edge to edge, backs in line."""
    quarter, front, left = _frame(item)
    back = -(item.depth_m - style.depth_m) / 2
    spots = [
        np.array([item.x, item.y]) + side * (item.width_m / 2 + style.width_m / 2 + 0.004) * left + back * front
        for side in (1, -1)
    ]
    return single([(float(x), float(y), quarter, 0.5) for x, y in spots])


def quarter_of(item: Furniture) -> int:
    """A piece's facing direction in quarter turns."""
    return round(item.yaw / (np.pi / 2)) % 4


def _frame(item: Furniture) -> tuple[int, NDArray[np.float64], NDArray[np.float64]]:
    quarter = quarter_of(item)
    return quarter, _FRONTS[quarter], _FRONTS[(quarter + 1) % 4]
