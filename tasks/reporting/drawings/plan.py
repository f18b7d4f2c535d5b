"""Floor plans of the report: a world's fixed parts, and what one job visited.

A page shows the same world several times: furniture and walls are drawn once, in a hidden part of
the page, and every plan refers to them; floors, path and labels belong to each plan. Colours come
from the page's style sheet, so that a plan follows light, dark and print.
"""

import math

from markupsafe import Markup

from ....schemas.runs.plan import RunResult
from ....schemas.worlds.world import Point, Room, Wall, World
from . import furniture, trajectory
from .frame import EXTENT, Frame
from .lettering import draw_label
from .svg import element, group, points

_GALLERY_LETTERS = 36.0  # plans of the gallery are shown at half the size
_BAR_LEFT = 30.0
_BARS_M = (0.5, 1, 2, 5, 10, 20, 50, 100)


def draw_fixtures(world: World, frame: Frame, identity: str) -> Markup:
    """Furniture, walls, passages and windows of a world, to be referred to by `identity`."""
    plan = world.floorplan
    walls = [wall for wall in plan.walls if not wall.lintel]
    return element(
        "g",
        group(
            (furniture.draw_furniture(item, frame) for item in sorted(world.furniture, key=lambda item: item.base_m)),
            class_="furniture",
        ),
        group((_line(way.start, way.end, frame) for way in plan.passages), class_="passages"),
        group((_wall(wall, frame) for wall in walls), class_="walls"),
        group((_line(window.start, window.end, frame) for window in plan.windows), class_="windows"),
        id=identity,
    )


def draw_world_plan(world: World, frame: Frame, fixtures: str, title: str) -> Markup:
    """A world as an architect would draw it, each room with its area."""
    rooms = world.floorplan.rooms
    crowd = _furniture_points(world, frame)
    return _plan(
        frame,
        title,
        *_ground(world, frame, fixtures),
        group(
            (draw_label(r.name, f"{r.area_m2:.1f} m²", r.polygon, frame, crowd, _GALLERY_LETTERS) for r in rooms),
            class_="labels",
        ),
    )


def draw_job_plan(world: World, frame: Frame, fixtures: str, result: RunResult, title: str) -> Markup:
    """A world with a job's path and collisions; visited rooms are tinted, the others hatched."""
    visits = {visit.name: visit for visit in result.rooms}
    crowd = _furniture_points(world, frame) + trajectory.covered_points(result, frame)
    floors, labels = [], []
    for room in world.floorplan.rooms:
        visit = visits.get(room.name)
        state = "floor" if visit is None else "floor visited" if visit.visited else "floor unvisited"
        floors.append(_floor(room, state, frame))
        note = ""
        if visit is not None:
            at = "" if visit.first_visit_s is None else f" at {visit.first_visit_s:.0f} s"
            note = f"visited{at}" if visit.visited else "not visited"
        labels.append(draw_label(room.name, note, room.polygon, frame, crowd))
    lines, marks = trajectory.draw_trajectory(result, frame)
    return _plan(
        frame,
        title,
        group(floors, class_="floors"),
        element("use", href=f"#{fixtures}"),
        lines,
        group(labels, class_="labels"),
        marks,
    )


def draw_open_plan(world: World, frame: Frame, fixtures: str, title: str, drive: str) -> Markup:
    """A world in which a robot drives: the way that it has driven so far goes into the group with the id `drive`."""
    crowd = _furniture_points(world, frame)
    labels = (draw_label(room.name, "", room.polygon, frame, crowd) for room in world.floorplan.rooms)
    ground = _ground(world, frame, fixtures)
    return _plan(frame, title, *ground, element("g", id=drive), group(labels, class_="labels"))


def draw_bare_path(result: RunResult, title: str) -> Markup | None:
    """A path without its world; None when there is none to draw."""
    path = trajectory.finite_path(result)
    if not path:
        return None
    frame = Frame.around((x, y) for _, x, y in path)
    return _plan(frame, title, *trajectory.draw_trajectory(result, frame))


def _plan(frame: Frame, title: str, *content: Markup) -> Markup:
    return element(
        "svg",
        element("title", title),
        *content,
        _scale_bar(frame),
        class_="plan",
        viewBox=frame.view_box,
        role="img",
        aria_label=title,
    )


def _scale_bar(frame: Frame) -> Markup:
    wanted = EXTENT / 6 / frame.scale
    length_m = min(_BARS_M, key=lambda bar: abs(math.log(bar / wanted)))
    x, y = _BAR_LEFT, frame.foot
    end = x + length_m * frame.scale
    return element(
        "g",
        element("path", d=f"M{x:.1f} {y - 7:.1f}v14M{x:.1f} {y:.1f}H{end:.1f}m0 -7v14"),
        element("text", f"{length_m:g} m", x=end + 12, y=y + 7),
        class_="scale-bar",
    )


def _ground(world: World, frame: Frame, fixtures: str) -> tuple[Markup, Markup]:
    """The floors, and all that stands on them."""
    floors = group((_floor(room, "floor", frame) for room in world.floorplan.rooms), class_="floors")
    return floors, element("use", href=f"#{fixtures}")


def _floor(room: Room, style: str, frame: Frame) -> Markup:
    return element("polygon", points=points(frame.at(corner) for corner in room.polygon), class_=style)


def _line(start: Point, end: Point, frame: Frame) -> Markup:
    (x1, y1), (x2, y2) = frame.at(start), frame.at(end)
    return element("line", x1=x1, y1=y1, x2=x2, y2=y2)


def _wall(wall: Wall, frame: Frame) -> Markup:
    """A wall is the box from its start to its end; at corners, one of the two reaches around."""
    (x1, y1), (x2, y2) = frame.at(wall.start), frame.at(wall.end)
    return element("line", x1=x1, y1=y1, x2=x2, y2=y2, stroke_width=wall.thickness_m * frame.scale)


def _furniture_points(world: World, frame: Frame) -> list[Point]:
    return [point for item in world.furniture for point in furniture.covered_points(item, frame)]
