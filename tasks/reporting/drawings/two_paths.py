"""Paths of two runs in the same world, on one floor plan."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from markupsafe import Markup

from ....schemas.runs.plan import RunResult
from ....schemas.worlds.world import Point, World
from . import plan
from .svg_writing import Frame, element, group, number, points
from .trajectory import PathPoint, finite_path

_NEAR = 46.0
"""Units of the drawing within which two marks would cover each other."""

_LABEL_WIDTH, _LABEL_HEIGHT = 80.0, 24.0
"""Units that `A end` takes, on narrow pages too: nearer labels cover each other, so that one goes below its mark."""
_START_LABEL_Y = -17.0
_END_LABEL_YS = (-19.0, 33.0, 58.0, -44.0, 83.0)
"""Places of the label of an end below the middle of its mark, the best first, a label's height apart."""

_SPACING = 12.0
"""Units of the drawing between two points of a path that names of rooms keep clear of: half a letter."""


@dataclass(frozen=True)
class Miss:
    """The first moment at which a job missed one of its requirements."""

    requirement: str
    time_s: float
    """Simulated time, in seconds."""


@dataclass(frozen=True)
class Way:
    """The path of one of the two jobs, with the letter that it is called by."""

    letter: str
    """`A` or `B`."""
    result: RunResult
    missed: Miss | None = None

    @property
    def path(self) -> list[PathPoint]:
        """Simulated times and places of the robot, those that can be drawn."""
        return finite_path(self.result)


@dataclass(frozen=True)
class Goal:
    """A place that a requirement asks the robot to get to: a point, or a room."""

    name: str
    at: Point | None = None
    within_m: float = 0.0
    room: str = ""


def place_at(path: Sequence[PathPoint], time_s: float) -> Point | None:
    """Returns where the robot was at a time, between two points of its path; `None` before and after the path.

    Args:
        path: Simulated time in seconds, x and y in metres, in the order of time.
        time_s: The time.
    """
    if not path or not path[0][0] <= time_s <= path[-1][0]:
        return None
    index = min(bisect_right(path, time_s, key=lambda point: point[0]), len(path) - 1)
    (t0, x0, y0), (t1, x1, y1) = path[max(index - 1, 0)], path[index]
    share = (time_s - t0) / (t1 - t0) if t1 > t0 else 1.0
    return x0 + share * (x1 - x0), y0 + share * (y1 - y0)


def draw_two_paths(
    world: World, frame: Frame, fixtures: str, ways: Sequence[Way], goals: Sequence[Goal], title: str
) -> Markup:
    """Draws the floor plan of a world with the paths of two jobs, their starts, ends and first misses, and the goals.

    Args:
        world: The world that both jobs drove in.
        frame: The drawing.
        fixtures: Id of the SVG group with walls and furniture.
        ways: Both paths; one that is empty is left out.
        goals: Places that requirements ask for.
        title: Description of the drawing.
    """
    rooms = {goal.room: goal for goal in goals if goal.room}
    asked = frozenset(room.name for room in world.floorplan.rooms if room.name in rooms)
    crowd = [point for way in ways for point in _covered(way, frame)]
    return plan.draw_shared_plan(
        world,
        frame,
        fixtures,
        title,
        crowd,
        asked,
        below=group([_goal(goal, frame) for goal in goals if goal.at is not None], class_="goals")
        + _lines(ways, frame),
        above=_marks(ways, frame),
    )


def draw_bare_paths(ways: Sequence[Way], goals: Sequence[Goal], title: str) -> Markup | None:
    """Draws the paths of two jobs without a world; `None` if there is none."""
    places = [(x, y) for way in ways for _, x, y in way.path]
    if not places:
        return None
    frame = Frame.around([*places, *(goal.at for goal in goals if goal.at is not None)])
    marks = group([_goal(goal, frame) for goal in goals if goal.at is not None], class_="goals")
    return plan.draw_on_ground(frame, title, marks, _lines(ways, frame), _marks(ways, frame))


def _lines(ways: Sequence[Way], frame: Frame) -> Markup:
    """Draws both paths: the second one dashed, so that the first is seen where they are the same."""
    found = [(way, way.path) for way in ways]
    drawn = [(way, points(frame.at((x, y)) for _, x, y in path), path) for way, path in found if path]
    casings = [element("polyline", points=line, class_="casing") for _, line, _ in drawn]
    lines = [
        element(
            "polyline",
            points=line,
            class_=f"way side-{way.letter.lower()}",
            data_times=" ".join(f"{time_s:.2f}" for time_s, _, _ in path),
        )
        for way, line, path in drawn
    ]
    return group([*casings, *lines], class_="path two")


def _marks(ways: Sequence[Way], frame: Frame) -> Markup:
    """Draws starts, ends and first misses of both paths; at last the robots' places, which a script moves.

    A path without points has no marks, and a start beside the other one is drawn once.
    """
    starts: list[Point] = []
    marks: list[Markup] = []
    labels: list[Point] = []
    robots = []
    for way in ways:
        path = way.path
        if not path:
            continue
        start, end = (frame.at(path[index][1:]) for index in (0, -1))
        if all(math.dist(start, other) > _NEAR / 2 for other in starts):
            marks.append(_mark(start, "start", element("circle", r=11), "start", _START_LABEL_Y))
            labels.append((start[0], start[1] + _START_LABEL_Y))
        starts.append(start)
        label_y = _free_label_y(end, labels)
        labels.append((end[0], end[1] + label_y))
        marks.append(_end(end, way.letter, label_y))
        if way.missed is not None and (place := place_at(path, way.missed.time_s)) is not None:
            marks.append(_miss(frame.at(place), way.letter, way.missed))
        robots.append(_robot(start, way.letter))
    return group([*marks, *robots], class_="marks")


def _free_label_y(at: Point, labels: Sequence[Point]) -> float:
    """Returns where the label of an end stands, above or below its mark, so that it covers no other label."""
    for y in _END_LABEL_YS:
        if all(abs(at[0] - x) >= _LABEL_WIDTH or abs(at[1] + y - other_y) >= _LABEL_HEIGHT for x, other_y in labels):
            return y
    return _END_LABEL_YS[-1]


def _mark(at: Point, kind: str, shape: Markup, text: str, y: float) -> Markup:
    return element("g", shape, element("text", text, y=y), class_=kind, transform=_moved(at))


def _end(at: Point, letter: str, label_y: float) -> Markup:
    shape = element("rect", x=-11, y=-11, width=22, height=22, rx=3)
    return _mark(at, f"end-of side-{letter.lower()}", shape, f"{letter} end", label_y)


def _miss(at: Point, letter: str, missed: Miss) -> Markup:
    words = f"{letter} first missed {missed.requirement} at {missed.time_s:.1f} s"
    return element(
        "g",
        element("title", words),
        element("path", d="M0 -19L17 12H-17Z"),
        element("text", "!", y=8),
        class_=f"miss side-{letter.lower()}",
        transform=_moved(at),
    )


def _robot(at: Point, letter: str) -> Markup:
    return element(
        "g",
        element("circle", r=16),
        element("text", letter, y=8),
        class_=f"robot side-{letter.lower()}",
        transform=_moved(at),
        visibility="hidden",
    )


def _goal(goal: Goal, frame: Frame) -> Markup:
    assert goal.at is not None
    radius = max(goal.within_m * frame.scale, 9.0)
    return element(
        "g",
        element("circle", r=radius),
        element("circle", r=4, class_="middle"),
        element("text", goal.name.replace("_", " "), y=-radius - 9),
        class_="goal",
        transform=_moved(frame.at(goal.at)),
    )


def _covered(way: Way, frame: Frame) -> list[Point]:
    """Returns points of the drawing that a path and its marks cover, to keep the rooms' names off them."""
    drawn = [frame.at((x, y)) for _, x, y in way.path]
    between: list[Point] = []
    for (x0, y0), (x1, y1) in pairwise(drawn):
        if between and math.dist(between[-1], (x1, y1)) < _SPACING:
            continue
        steps = 1 + int(min(math.dist((x0, y0), (x1, y1)) / _SPACING, 100))
        between += [(x0 + (x1 - x0) * i / steps, y0 + (y1 - y0) * i / steps) for i in range(steps)]
    ends = [drawn[0], drawn[-1]] if drawn else []
    return between + [(x + dx, y + dy) for x, y in ends for dx in (-24, 0, 24) for dy in (-20, 0, 26)]


def _moved(at: Point) -> str:
    return f"translate({number(at[0])} {number(at[1])})"
