"""Floor plans of the report: a world's fixed parts with furniture, and what one job visited."""

import math
from collections.abc import Container, Iterable, Sequence

from markupsafe import Markup

from ....schemas.runs.plan import RunResult
from ....schemas.worlds.world import Furniture, Point, Room, Wall, World
from . import trajectory
from .lettering import draw_label
from .svg_writing import EXTENT, Frame, element, group, points

_Box = tuple[float, float, float, float]

# Rectangles: back, one side, front, other side.
_BOXES: dict[str, list[_Box]] = {
    "Baths": [(-0.4, -0.42, 0.4, 0.42)],
    "Beds": [(-0.46, -0.42, -0.28, -0.05), (-0.46, 0.05, -0.28, 0.42), (-0.2, -0.5, 0.5, 0.5)],
    "CoffeeTables": [(-0.4, -0.44, 0.4, 0.44)],
    "DeskChairs": [(-0.5, -0.42, -0.34, 0.42)],
    "DiningChairs": [(-0.5, -0.42, -0.34, 0.42)],
    "DiningTables": [(-0.45, -0.45, 0.45, 0.45)],
    "KitchenIslandsAndCarts": [(-0.42, -0.45, 0.42, 0.45)],
    "LivingRoomChairs": [(-0.5, -0.5, -0.26, 0.5), (-0.26, -0.5, 0.5, -0.34), (-0.26, 0.34, 0.5, 0.5)],
    "Ottomans": [(-0.4, -0.4, 0.4, 0.4)],
    "Showers": [(-0.44, -0.44, 0.44, 0.44)],
    "Sofas": [(-0.5, -0.5, -0.24, 0.5), (-0.24, -0.5, 0.5, -0.4), (-0.24, 0.4, 0.5, 0.5)],
    "Toilets": [(-0.5, -0.45, -0.2, 0.45)],
}
# Ellipses: along, across, radius along, radius across.
_ELLIPSES: dict[str, list[_Box]] = {
    "FloorLamps": [(0, 0, 0.2, 0.2)],
    "Ovens": [(-0.2, -0.22, 0.15, 0.15), (-0.2, 0.22, 0.15, 0.15), (0.2, -0.22, 0.15, 0.15), (0.2, 0.22, 0.15, 0.15)],
    "Showers": [(0, 0, 0.06, 0.06)],
    "Toilets": [(0.14, 0, 0.34, 0.36)],
    "VanityCounters": [(0.02, 0, 0.3, 0.22)],
    "WashingMachinesAndDryers": [(0, 0, 0.3, 0.3)],
}
# Cupboards and appliances get a line along their front, so that one sees which way they open.
_FRONT_LINE = frozenset({
    "BarCabinets", "Bookcases", "ConsoleTables", "CornerCabinets", "DishWashers", "Dressers", "Fridges",
    "MediaStorage", "Nightstands", "SideboardsAndBuffets", "Storage", "StorageBenches",
})  # fmt: skip
_ROUND = frozenset({"FloorLamps"})
_ROUND_STYLE = "round"  # of tables and ottomans


def draw_furniture(item: Furniture, frame: Frame) -> Markup:
    """Draws one piece of furniture in a floor plan, with its id as tooltip."""
    x, y = frame.at((item.x, item.y))
    depth, width = item.depth_m * frame.scale, item.width_m * frame.scale
    round_top = item.style.split("-")[0] == _ROUND_STYLE
    outline = (
        element("ellipse", rx=depth / 2, ry=width / 2)
        if round_top or item.model_type in _ROUND
        else element("rect", x=-depth / 2, y=-width / 2, width=depth, height=width, rx=min(4, depth / 4, width / 4))
    )
    turn = math.degrees(item.yaw)
    return element(
        "g",
        element("title", item.id),
        outline,
        *([] if round_top else _marks(item.model_type, depth, width)),
        class_="loose" if item.movable else None,
        # Turning left on the ground is a negative angle in a drawing whose y points down.
        transform=f"translate({x:.1f} {y:.1f})" + (f" rotate({-turn:.0f})" if round(turn) else ""),
    )


def covered_points(item: Furniture, frame: Frame) -> list[Point]:
    """Returns points of the drawing that a piece of furniture covers, to keep labels off it."""
    cos, sin = math.cos(item.yaw), math.sin(item.yaw)
    shares = (-0.45, 0.0, 0.45)
    offsets = ((u * item.depth_m, v * item.width_m) for u in shares for v in shares)
    return [frame.at((item.x + u * cos - v * sin, item.y + u * sin + v * cos)) for u, v in offsets]


def _marks(model_type: str, depth: float, width: float) -> list[Markup]:
    boxes = [
        element("rect", x=u0 * depth, y=v0 * width, width=(u1 - u0) * depth, height=(v1 - v0) * width, rx=3)
        for u0, v0, u1, v1 in _BOXES.get(model_type, [])
    ]
    ellipses = [
        element("ellipse", cx=u * depth, cy=v * width, rx=ru * depth, ry=rv * width)
        for u, v, ru, rv in _ELLIPSES.get(model_type, [])
    ]
    lines = (
        [element("line", x1=0.34 * depth, y1=-width / 2, x2=0.34 * depth, y2=width / 2)]
        if model_type in _FRONT_LINE
        else []
    )
    return boxes + ellipses + lines


_GALLERY_LETTERS = 36.0  # plans of the gallery are shown at half the size
_BAR_LEFT = 30.0
_BARS_M = (0.5, 1, 2, 5, 10, 20, 50, 100)


def draw_fixtures(world: World, frame: Frame, identity: str) -> Markup:
    """Draws furniture, walls, doors and windows of a world as a reusable SVG group."""
    plan = world.floorplan
    walls = [wall for wall in plan.walls if not wall.lintel]
    return element(
        "g",
        group(
            (draw_furniture(item, frame) for item in sorted(world.furniture, key=lambda item: item.base_m)),
            class_="furniture",
        ),
        group((_line(way.start, way.end, frame) for way in plan.passages), class_="passages"),
        group((_wall(wall, frame) for wall in walls), class_="walls"),
        group((_line(window.start, window.end, frame) for window in plan.windows), class_="windows"),
        id=identity,
    )


def draw_world_plan(world: World, frame: Frame, fixtures: str, title: str) -> Markup:
    """Draws the floor plan of a world as SVG, each room with its name and its area in m²."""
    rooms = world.floorplan.rooms
    crowd = _furniture_points(world, frame)
    return _plan(
        frame,
        title,
        *_ground(_floors(world, frame), fixtures),
        group(
            (draw_label(r.called, f"{r.floor_m2:.1f} m²", r.polygon, frame, crowd, _GALLERY_LETTERS) for r in rooms),
            class_="labels",
        ),
    )


def draw_job_plan(world: World, frame: Frame, fixtures: str, result: RunResult, title: str) -> Markup:
    """Draws the floor plan of a world as SVG with a robot's path and collisions; visited rooms are tinted."""
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
        labels.append(draw_label(room.called, note, room.polygon, frame, crowd))
    lines, marks = trajectory.draw_trajectory(result, frame)
    return _plan(frame, title, *_ground(floors, fixtures), lines, group(labels, class_="labels"), marks)


def draw_open_plan(world: World, frame: Frame, fixtures: str, title: str, drive: str) -> Markup:
    """Draws the floor plan for a running simulation; the robot's path so far is added to the group `drive`."""
    crowd = _furniture_points(world, frame)
    labels = (draw_label(room.called, "", room.polygon, frame, crowd) for room in world.floorplan.rooms)
    ground = _ground(_floors(world, frame), fixtures)
    return _plan(frame, title, *ground, element("g", id=drive), group(labels, class_="labels"))


def draw_shared_plan(
    world: World,
    frame: Frame,
    fixtures: str,
    title: str,
    crowd: Sequence[Point],
    asked: Container[str],
    *,
    below: Markup,
    above: Markup,
) -> Markup:
    """Draws the floor plan of a world around marks of more than one job.

    Args:
        world: The world.
        frame: The drawing.
        fixtures: Id of the SVG group with walls and furniture.
        title: Description of the drawing.
        crowd: Points of the drawing that the rooms' names should not cover.
        asked: Names of the rooms that are goals.
        below: Lines, to go below the rooms' names.
        above: Marks, to go above them.
    """
    rooms = world.floorplan.rooms
    furniture = _furniture_points(world, frame)
    floors = [_floor(room, "floor asked" if room.name in asked else "floor", frame) for room in rooms]
    labels = (
        draw_label(room.called, "goal" if room.name in asked else "", room.polygon, frame, [*furniture, *crowd])
        for room in rooms
    )
    return _plan(frame, title, *_ground(floors, fixtures), below, group(labels, class_="labels"), above)


def draw_on_ground(frame: Frame, title: str, *content: Markup) -> Markup:
    """Draws SVG content on empty ground, with a title and a scale bar."""
    return _plan(frame, title, *content)


def draw_bare_path(result: RunResult, title: str) -> Markup | None:
    """Draws a robot's path without a world; `None` if there is no path."""
    path = trajectory.finite_path(result)
    if not path:
        return None
    frame = Frame.around((x, y) for _, x, y in path)
    return draw_on_ground(frame, title, *trajectory.draw_trajectory(result, frame))


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


def _ground(floors: Iterable[Markup], fixtures: str) -> tuple[Markup, Markup]:
    """Returns the floors, and the group of furniture, walls and other fixtures on them."""
    return group(floors, class_="floors"), element("use", href=f"#{fixtures}")


def _floors(world: World, frame: Frame) -> Iterable[Markup]:
    return (_floor(room, "floor", frame) for room in world.floorplan.rooms)


def _floor(room: Room, style: str, frame: Frame) -> Markup:
    return element("polygon", points=points(frame.at(corner) for corner in room.polygon), class_=style)


def _line(start: Point, end: Point, frame: Frame) -> Markup:
    (x1, y1), (x2, y2) = frame.at(start), frame.at(end)
    return element("line", x1=x1, y1=y1, x2=x2, y2=y2)


def _wall(wall: Wall, frame: Frame) -> Markup:
    """Draws a wall as the box from its start to its end; at corners, one of the two walls includes the corner."""
    (x1, y1), (x2, y2) = frame.at(wall.start), frame.at(wall.end)
    return element("line", x1=x1, y1=y1, x2=x2, y2=y2, stroke_width=wall.thickness_m * frame.scale)


def _furniture_points(world: World, frame: Frame) -> list[Point]:
    return [point for item in world.furniture for point in covered_points(item, frame)]
