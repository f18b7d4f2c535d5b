"""Makes the floor plan of a world from a drawing.

The plan has rooms, walls, doorways and windows, and says how exactly each follows the drawing.
"""

from collections.abc import Sequence
from random import Random
from typing import NamedTuple

import numpy as np

from ....schemas.wire.errors import ConfigurationError
from ....schemas.worlds.world import (
    OUTDOOR_ROOM_TYPE,
    Floorplan,
    FurnishedRoomType,
    Point,
    Preference,
    Room,
    Wall,
    bounds,
)
from ..balconies.building import RAILING_M
from ..doors.bath_windows import with_bath_windows
from ..doors.doors import hang_doors
from ..floorplans.connections import AREA_TOLERANCE
from ..floorplans.floorplan import (
    Spot,
    Spots,
    choose_origin,
    placed_passage,
    placed_points,
    placed_wall,
    placed_window,
    spots_in,
)
from ..floorplans.partition import UNITS_PER_M, Corners, area, extent
from ..floorplans.walls import Pane, Piece, Walls, floor_cells, windows_along
from .door_fitting import DrawnWay, FittedWay, fit_way, fit_window
from .squaring import Squared, outline_area, outline_of, overlaps, room_units, square, units_area


class DrawnRoom(NamedTuple):
    """A room of an imported drawing, in metres."""

    name: str
    original: str | None
    type: FurnishedRoomType
    corners: tuple[tuple[float, float], ...]


class DrawnPlan(NamedTuple):
    """Content of an imported drawing in metres: rooms, doors, openings and windows."""

    file: str
    rooms: list[DrawnRoom]
    ways: list[DrawnWay]
    windows: list[DrawnWay]
    on_faces: bool | None


class MadePlan(NamedTuple):
    """A floor plan made from a drawing, and how far its doors are open if drawn."""

    floorplan: Floorplan
    open_percents: dict[int, float]
    """Opening of drawn doors in percent, by the doorway's index in the floor plan's `passages`."""
    on_faces: bool
    origin_m: Point
    """Position of the world's origin in the drawing, in metres."""


class ApartError(ConfigurationError):
    """Raised for a plan with rooms that no door or opening leads to."""

    def __init__(self, rooms: Sequence[str], message: str) -> None:
        super().__init__(message)
        self.rooms = rooms


def make_plan(drawn: DrawnPlan, ceiling_m: float, seed: int) -> MadePlan:
    """Makes a floor plan from a drawing's rooms, doors and windows.

    Args:
        drawn: Content of the drawing.
        ceiling_m: Floor to ceiling.
        seed: Seed of windows, if none are drawn.

    Raises:
        ConfigurationError: Rooms overlap or are not joined, none is inside, or a door lies in no wall.
    """
    names = [room.name for room in drawn.rooms]
    if all(room.type == OUTDOOR_ROOM_TYPE for room in drawn.rooms):
        raise ConfigurationError(
            f"{drawn.file}: only balconies ({', '.join(names)}); a room inside besides would be right"
        )
    squared = square([room.corners for room in drawn.rooms], drawn.on_faces)
    _refuse_overlaps(squared.rooms, names, drawn.file)
    walls = Walls(squared.rooms)
    told: list[Preference] = []
    fitted: list[FittedWay] = []
    wrong: list[str] = []
    for each in drawn.ways:
        try:
            way, preference = fit_way(each, walls, squared.moved, names, drawn.file, [one.way for one in fitted])
        except ConfigurationError as error:
            wrong += [str(error)] if each.required else []
            way, preference = None, Preference.judged(f"{drawn.file}#{each.name}", each.name, str(error))
        told.append(preference)
        fitted += [FittedWay(way, each.percent)] if way else []
    if wrong:
        raise ConfigurationError("\n".join(wrong))
    ways = [one.way for one in fitted]
    _refuse_apart(names, [way.pair for way in ways], drawn.file)
    panes, window_report = _windows(drawn, walls, squared, seed)
    pieces = walls.pieces(ways)
    spots = [spots_in(corners) for corners in squared.rooms]
    origin = choose_origin(squared.rooms, [room.type for room in drawn.rooms], ways, spots)
    whole = walls.pieces([])
    rooms = [
        _room(room, squared.rooms[number], spots[number], whole, origin, on_faces=squared.on_faces)
        for number, room in enumerate(drawn.rooms)
    ]
    plan = Floorplan(
        footprint=placed_points(outline_of(walls.around), origin),
        ceiling_height_m=ceiling_m,
        rooms=rooms,
        walls=[_wall(piece, drawn.rooms, panes, origin) for piece in pieces],
        passages=[placed_passage(way, names, origin) for way in ways],
        windows=[placed_window(pane, names, origin) for pane in panes],
        wishes=[],
    )
    hung, doorless = hang_doors(plan if drawn.windows else with_bath_windows(plan))
    for index, why in doorless.items():
        told.append(Preference.judged(drawn.file, f"a door between {' and '.join(plan.passages[index].rooms)}", why))
    wishes = [*(_area(drawn.file, room) for room in rooms), *told, *window_report]
    percents = {index: one.percent for index, one in enumerate(fitted) if one.percent is not None}
    x, y = (lines.start_m + at / UNITS_PER_M for lines, at in zip(squared.moved, origin, strict=True))
    placed = round(x, 3), round(y, 3)
    return MadePlan(hung.model_copy(update={"wishes": wishes}), percents, squared.on_faces, placed)


def _wall(piece: Piece, rooms: Sequence[DrawnRoom], panes: Sequence[Pane], origin: Spot) -> Wall:
    """Returns a wall in metres; around a balcony it is a railing, unless it has windows."""
    wall = placed_wall(piece, [room.name for room in rooms], origin)
    is_glazed = any(
        (pane.horizontal, pane.at) == (piece.horizontal, piece.at) and piece.start < pane.end and pane.start < piece.end
        for pane in panes
    )
    is_railing = wall.exterior and rooms[piece.rooms[0]].type == OUTDOOR_ROOM_TYPE and not is_glazed
    return wall.model_copy(update={"top_m": RAILING_M}) if is_railing else wall


def _room(
    drawn: DrawnRoom, corners: Corners, spots: Spots, pieces: Sequence[Piece], origin: Spot, *, on_faces: bool
) -> Room:
    middle = int(spots.clearance.argmax())
    cells = floor_cells(corners, pieces)
    rows, columns = np.nonzero(cells)
    sides = sorted((int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1)) if len(rows) else [1, 1]
    floor_m2, area_m2 = int(cells.sum()) / UNITS_PER_M**2, units_area(corners)
    desired_m2 = outline_area(drawn.corners)
    x0, y0, x1, y1 = bounds(drawn.corners)
    span = sorted((x1 - x0, y1 - y0))
    if not on_faces:  # what was drawn holds the walls' halves
        desired_m2 -= area_m2 - floor_m2
        box = extent(corners)
        lost = (box.x1 - box.x0 + box.y1 - box.y0 - sum(sides)) / 2 / UNITS_PER_M
        span = [side - lost for side in span]
    return Room(
        name=drawn.name,
        original_name=drawn.original,
        type=drawn.type,
        polygon=placed_points(corners, origin),
        area_m2=area_m2,
        floor_area_m2=floor_m2,
        aspect_ratio=round(sides[1] / sides[0], 4),
        desired_area_m2=round(max(desired_m2, 0.01), 4),
        desired_aspect_ratio=round(span[1] / span[0], 4),
        goal=placed_points(((int(spots.x[middle]), int(spots.y[middle])),), origin)[0],
    )


def _windows(drawn: DrawnPlan, walls: Walls, squared: Squared, seed: int) -> tuple[list[Pane], list[Preference]]:
    """Returns the drawn windows; without any, those that a generated world would have.

    The second value is the outcome of each drawn window. One that crosses an earlier one is left out of the first.
    """
    if not drawn.windows:
        types: list[FurnishedRoomType] = [room.type for room in drawn.rooms]
        return windows_along(walls.sides, types, Random(seed)), []  # noqa: S311 (chance, not secrecy)
    panes: list[Pane] = []
    told: list[Preference] = []
    for each in drawn.windows:
        pane, preference = fit_window(each, walls.sides, squared.moved, drawn.file)
        told.append(preference)
        panes += [pane] if pane and not any(_cross(pane, other) for other in panes) else []
    return panes, told


def _cross(one: Pane, other: Pane) -> bool:
    return (one.horizontal, one.at) == (other.horizontal, other.at) and one.start < other.end and other.start < one.end


def _area(file: str, room: Room) -> Preference:
    made, wished = room.floor_m2, room.desired_area_m2
    near = abs(made / wished - 1) <= AREA_TOLERANCE
    reason = "" if near else f"its floor became {made:.1f} m2 on the grid of 5 cm, with walls of 10 and 20 cm"
    return Preference.judged(f"{file}#{room.original_name or room.name}", f"{room.name} of {wished:.1f} m2", reason)


def _refuse_overlaps(rooms: Sequence[Corners], names: Sequence[str], file: str) -> None:
    wrong: list[str] = []
    for number, corners in enumerate(rooms):
        if len(corners) < 4:
            wrong.append(f"{file}: {names[number]}: it is narrower than a wall; is the scale right?")
        elif int(room_units(corners).sum()) != area(corners):
            wrong.append(
                f"{file}: {names[number]}: its outline crosses itself, once its edges lie on the grid of 5 cm; a "
                "simple outline would be right"
            )
    wrong = wrong or [
        f"{file}: {names[one]} and {names[other]} overlap by {square_metres:.2f} m2; rooms that touch, or that "
        "have a gap of a wall's thickness between them, would be right"
        for one, other, square_metres in overlaps(rooms)
    ]
    if wrong:
        raise ConfigurationError("\n".join(wrong))


def _refuse_apart(names: Sequence[str], pairs: Sequence[tuple[int, int]], file: str) -> None:
    joined = {0}
    while grown := {room for pair in pairs if joined & {*pair} for room in pair} - joined:
        joined |= grown
    if apart := [name for number, name in enumerate(names) if number not in joined]:
        raise ApartError(
            apart,
            f"{file}: no door or opening leads from {names[0]} to {', '.join(apart)}; draw one in a wall between rooms",
        )
