"""Drawing of the robot's path and its collisions on a floor plan."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from markupsafe import Markup

from ....schemas.runs.plan import Collision, RunResult
from ....schemas.worlds.world import Point
from .svg_writing import Frame, element, group, number, points

SHADES = 8
"""Number of colours along the path, from start to end; the style sheet has the colours."""

_ARROWS = 9
_CLUSTER_M = 0.3
_MOST_LABELS = 6
_FARTHEST_M = 10_000.0

PathPoint = tuple[float, float, float]


@dataclass(frozen=True)
class CollisionSpot:
    """Several collisions close to each other, drawn as one mark."""

    x: float
    y: float
    collisions: tuple[Collision, ...]

    @property
    def force_N(self) -> float:  # noqa: N802 - the unit is part of the name
        """Largest force of the spot's collisions, in newtons."""
        return max(collision.max_force_N for collision in self.collisions)

    @property
    def text(self) -> str:
        """Tooltip of the mark: one line for each collision."""
        return "\n".join(f"{c.other}: {c.max_force_N:.1f} N at {c.time_s:.1f} s" for c in self.collisions)


def cluster(collisions: Sequence[Collision], radius_m: float = _CLUSTER_M) -> list[CollisionSpot]:
    """Groups collisions within `radius_m` of the strongest one nearby, strongest group first, each group by time.

    Collisions without finite place and force are left out.
    """
    left = sorted(
        (c for c in collisions if _drawable(c.x, c.y) and math.isfinite(c.max_force_N)),
        key=lambda c: (-c.max_force_N, c.time_s),
    )
    spots = []
    while left:
        first = left[0]
        near = [c for c in left if math.dist((c.x, c.y), (first.x, first.y)) <= radius_m]
        left = [c for c in left if c not in near]
        spots.append(CollisionSpot(first.x, first.y, tuple(sorted(near, key=lambda c: c.time_s))))
    return spots


def finite_path(result: RunResult) -> list[PathPoint]:
    """Returns a run's path without NaN and absurd points, which a diverged simulation leaves."""
    return [(t, x, y) for t, x, y in result.path if _drawable(x, y) and math.isfinite(t)]


def _drawable(x: float, y: float) -> bool:
    return abs(x) < _FARTHEST_M and abs(y) < _FARTHEST_M


def shaded_runs(path: Sequence[PathPoint]) -> list[tuple[int, list[Point]]]:
    """Cuts a path into pieces, one for each colour shade, by time; empty for fewer than two points.

    Each piece is a shade's number and its points; it begins where the piece before ends.
    """
    if len(path) < 2:
        return []
    start, end = path[0][0], path[-1][0]
    span = (end - start) or 1.0
    runs: list[tuple[int, list[Point]]] = []
    for (t0, x0, y0), (t1, x1, y1) in pairwise(path):
        shade = min(SHADES - 1, max(0, int(((t0 + t1) / 2 - start) / span * SHADES)))
        if not runs or runs[-1][0] != shade:
            runs.append((shade, [(x0, y0)]))
        runs[-1][1].append((x1, y1))
    return runs


def draw_trajectory(result: RunResult, frame: Frame) -> tuple[Markup, Markup]:
    """Draws a robot's path and collisions in a floor plan.

    Returns:
        Lines, to go below the rooms' names, and marks (start, end, collisions), to go above them.
    """
    path = finite_path(result)
    spots = cluster(result.collisions)
    if not path:
        return Markup(), _collision_marks(spots, frame)
    drawn = [frame.at((x, y)) for _, x, y in path]
    marks = group((_collision_marks(spots, frame), _mark(drawn[-1], "end"), _mark(drawn[0], "start")), class_="marks")
    return _lines(path, frame), marks


def draw_drive(path: Sequence[PathPoint], frame: Frame) -> Markup:
    """Draws the path so far of a running simulation, with its start and the robot's position; empty without a path."""
    path = [(t, x, y) for t, x, y in path if _drawable(x, y)]
    if not path:
        return Markup()
    start, now = (frame.at(path[index][1:]) for index in (0, -1))
    return _lines(path, frame) + group((_mark(start, "start"), _mark(now, "now")), class_="marks")


def _lines(path: Sequence[PathPoint], frame: Frame) -> Markup:
    drawn = [frame.at((x, y)) for _, x, y in path]
    return element(
        "g",
        element("polyline", points=points(drawn), class_="casing"),
        *(
            element("polyline", points=points(frame.at(p) for p in run), class_=f"shade-{shade}")
            for shade, run in shaded_runs(path)
        ),
        *_arrows(path, drawn),
        class_="path",
    )


def covered_points(result: RunResult, frame: Frame) -> list[Point]:
    """Returns points of the drawing that path, marks and their labels cover."""
    drawn = [frame.at((x, y)) for _, x, y in finite_path(result)]
    covered = []
    for (x0, y0), (x1, y1) in pairwise(drawn):
        steps = 1 + int(min(math.dist((x0, y0), (x1, y1)) / 12, 100))
        covered += [(x0 + (x1 - x0) * i / steps, y0 + (y1 - y0) * i / steps) for i in range(steps)]
    # Marks and words weigh more than a bit of path, so each counts with several points.
    ends = [(drawn[0], -20), (drawn[-1], 26)] if drawn else []
    covered += [(x + dx, y + dy) for (x, y), word in ends for dx in (-24, 0, 24) for dy in (0, word, word)]
    for spot in cluster(result.collisions):
        x, y = frame.at((spot.x, spot.y))
        covered += [(x + dx, y + dy) for dx in (0, 30, 60, 90) for dy in (-9, 9)]
    return covered


def _arrows(path: Sequence[PathPoint], drawn: Sequence[Point]) -> list[Markup]:
    """Draws small arrow heads at equal distances along a path; none on a path that is too short in the drawing."""
    lengths = [math.dist(a, b) for a, b in pairwise(drawn)]
    total = sum(lengths)
    if total < 60:
        return []
    count = max(1, min(_ARROWS, int(total / 110)))
    wanted = [total * (index + 0.5) / count for index in range(count)]
    start, span = path[0][0], (path[-1][0] - path[0][0]) or 1.0
    arrows, walked = [], 0.0
    for index, length in enumerate(lengths):
        while wanted and length and walked + length >= wanted[0]:
            share = (wanted.pop(0) - walked) / length
            (x0, y0), (x1, y1) = drawn[index], drawn[index + 1]
            angle = math.degrees(math.atan2(y1 - y0, x1 - x0))
            shade = min(SHADES - 1, max(0, int((path[index][0] - start) / span * SHADES)))
            place = f"translate({x0 + share * (x1 - x0):.1f} {y0 + share * (y1 - y0):.1f}) rotate({angle:.0f})"
            arrows.append(element("path", d="M12 0L-8 10L-3 0L-8 -10Z", class_=f"arrow shade-{shade}", transform=place))
        walked += length
    return arrows


def _mark(at: Point, kind: str) -> Markup:
    """Draws a disc for the start or present position, and a chequered square for the end, with a label."""
    x, y = at
    shape = (
        element("circle", r=11)
        if kind != "end"
        else element("rect", x=-10, y=-10, width=20, height=20) + element("rect", x=-4, y=-4, width=8, height=8)
    )
    return element(
        "g",
        shape,
        element("text", kind, y=-17 if kind == "start" else 32),
        class_=kind,
        transform=f"translate({x:.1f} {y:.1f})",
    )


def _collision_marks(spots: Sequence[CollisionSpot], frame: Frame) -> Markup:
    labelled: list[Point] = []
    marks = []
    for spot in spots:
        x, y = frame.at((spot.x, spot.y))
        # Room for the letters: hardest first, and a label that would cover another is left to the tooltip.
        free = all(abs(x - other[0]) > 95 or abs(y - other[1]) > 26 for other in labelled)
        text = ""
        if free and len(labelled) < _MOST_LABELS:
            labelled.append((x, y))
            times = f"{len(spot.collisions)}× " if len(spot.collisions) > 1 else ""
            text = element("text", f"{times}{spot.force_N:.0f} N", x=19, y=7)
        marks.append(
            element(
                "g",
                element("title", spot.text),
                element("circle", r=13),
                element("path", d="M-6 -6L6 6M6 -6L-6 6"),
                text,
                class_="collision",
                transform=f"translate({number(x)} {number(y)})",
            )
        )
    return group(marks, class_="collisions")
