"""Finds rooms, doors and windows among the shapes of a drawing."""

import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from ....schemas.templates.drawing_notes import DrawingNotes
from ....schemas.wire.errors import ConfigurationError
from ....schemas.wire.request_problems import nearest_of
from ....schemas.worlds.world import ROOM_TYPES, FurnishedRoomType, PassageKind, Point
from .door_fitting import DrawnWay
from .drawn_floorplan import DrawnPlan, DrawnRoom
from .drawn_shapes import (
    MOST_ROOMS,
    Drawing,
    Kind,
    Label,
    Line,
    Shape,
    counted,
    is_given,
    kind_of,
    label_in,
    label_of,
    plain_words,
    room_type,
    without_accents,
    without_kinds,
)
from .squaring import upright

_LARGEST_M = 100.0
_SMALLEST_M = 1.5
_MOST_NAMED = 5
_LONGEST_NAME = 60
"""Limit of the characters of a name that messages repeat; a text of a drawing may be a page long."""
_SHUT = frozenset(["shut", "closed", "zu", "geschlossen"])
_OPEN = frozenset(["open", "offen"])
_STRAIGHT = 0.1
"""Largest deviation of a line from an axis, as a share of its length, with which it is still drawn along a wall."""


def metres_per_unit(drawing: Drawing, stated: str | float | None, file: str) -> float:
    """Determines the scale of a drawing in metres per unit.

    Args:
        drawing: The drawing.
        stated: Metres a unit, or a scale on paper such as `1:50`.
        file: Name of the file.

    Raises:
        ConfigurationError: With that scale it would be no building.
    """
    if isinstance(stated, str):
        if drawing.paper_m is None:
            raise ConfigurationError(
                f"{file}: scale {stated}: the drawing has no size on paper (a width in mm, cm or in, and a viewBox); "
                "metres a unit, such as 0.01, would be right"
            )
        scale = drawing.paper_m * float(stated.partition(":")[2])
    else:
        scale = stated or drawing.metres_per_unit or 1.0
    rooms = [shape for shape in drawing.shapes if kind_of(shape, drawing.labels) == "room"]
    if rooms:
        boxes = [shape.box for shape in rooms]
        width = (max(box[2] for box in boxes) - min(box[0] for box in boxes)) * scale
        if not _SMALLEST_M <= width <= _LARGEST_M:
            raise ConfigurationError(
                f"{file}: at {scale:g} m a unit its rooms are {width:.4g} m wide together; say its scale with --scale: "
                'metres a unit, such as 0.01, or "1:50" for a drawing with a size on paper'
            )
    return scale


def read_plan(drawing: Drawing, scale: float, notes: DrawingNotes, file: str) -> tuple[DrawnPlan, list[str]]:
    """Finds rooms, doors and windows in a drawing.

    Args:
        drawing: The drawing.
        scale: Metres a unit.
        notes: Scale, room types and wishes that the drawing does not have.
        file: Name of the file.

    Returns:
        The plan, and what was taken for none of it.

    Raises:
        ConfigurationError: The drawing has no rooms, or a room that no world can have.
    """
    found: dict[Kind | None, list[Shape]] = {}
    for shape in drawing.shapes:
        found.setdefault(kind_of(shape, drawing.labels), []).append(shape)
    shapes = found.get("room", [])
    if not 0 < len(shapes) <= MOST_ROOMS:
        raise ConfigurationError(
            f"{file}: {len(shapes)} rooms in it, and 1 to {MOST_ROOMS} would be right; a room is a closed shape with "
            "the class, layer or group `room`, or with a name such as `Kitchen`"
        )
    flaws: list[str] = []
    rooms = _rooms(shapes, drawing, scale, notes, file, flaws)
    if not flaws and (unknown := sorted(set(notes.rooms) - {room.original or room.name for room in rooms})):
        names = [room.original or room.name for room in rooms]
        instead = {each: nearest_of(each, names, "the drawing has") for each in unknown}
        flaws += [f"{file}: the notes name a room {each!r}{words}" for each, words in instead.items()]
    kinds: tuple[tuple[Kind, PassageKind], ...] = (("door", "Doorway"), ("opening", "Opening"))
    ways: list[DrawnWay] = []
    for key, kind in kinds:
        for number, shape in enumerate(found.get(key, []), 1):
            with _kept(flaws):
                ways.append(_way(shape, kind, scale, number, required=drawing.is_exact))
    if flaws:
        raise ConfigurationError("\n".join(flaws))
    windows = [_way(shape, "Opening", scale, n, required=False) for n, shape in enumerate(found.get("window", []), 1)]
    faces = None if notes.outlines is None else notes.outlines == "faces"
    rest = [*found.get("other", []), *found.get(None, [])]
    nameless = [shape for shape in shapes if not is_given(shape.name)]
    return DrawnPlan(file, rooms, ways, windows, faces), _left_out(rest, drawing.labels, nameless)


@contextmanager
def _kept(flaws: list[str]) -> Iterator[None]:
    """Adds what is wrong with one shape to a list, so that all shapes are looked at."""
    try:
        yield
    except ConfigurationError as error:
        flaws.append(str(error))


def _rooms(
    shapes: Sequence[Shape], drawing: Drawing, scale: float, notes: DrawingNotes, file: str, flaws: list[str]
) -> list[DrawnRoom]:
    """Returns the rooms of shapes; what is wrong with others is added to the flaws."""
    taken: Counter[str] = Counter()
    rooms: list[DrawnRoom] = []
    for shape in shapes:
        with _kept(flaws):
            rooms.append(_room(shape, drawing, scale, notes, file, taken))
    return rooms


def _room(
    shape: Shape, drawing: Drawing, scale: float, notes: DrawingNotes, file: str, taken: Counter[str]
) -> DrawnRoom:
    label = label_of(shape, drawing.labels) or next(
        (without_kinds(word) for word in shape.words if room_type(word)), ""
    )
    what = f"{file}: room {label!r}" if label else f"{file}: {shape.place}"
    if any(unicodedata.category(letter) == "Cc" for letter in label):
        raise ConfigurationError(f"{what}: its name has control characters; remove them")
    if not shape.closed or shape.curved:
        flaw = "has curves" if shape.curved else "is not closed"
        raise ConfigurationError(f"{what}: its outline {flaw}; a closed one of level and upright edges would be right")
    kind = _type(shape, label, notes, what)
    name = " ".join(re.findall(r"[A-Za-z0-9_-]+", without_accents(label)) or [kind])
    taken[name] += 1
    name += f" {taken[name]}" if taken[name] > 1 else ""
    drawn = [(x, drawing.y_up * y) for x, y in shape.points]
    corners = upright([_scaled(point, scale) for point in shape.points], what, drawn)
    return DrawnRoom(name, label if label != name and label else None, kind, corners)


def _type(shape: Shape, label: str, notes: DrawingNotes, what: str) -> FurnishedRoomType:
    """Determines the type of a room: from notes, the shape's attributes, its name, or its classes and layers.

    Raises ConfigurationError if the type is unknown or cannot be told.
    """
    if label in notes.rooms:
        return notes.rooms[label].type
    if stated := shape.facts.get("type"):
        known: dict[str, FurnishedRoomType] = {kind.lower(): kind for kind in ROOM_TYPES}
        if stated.lower() not in known:
            raise ConfigurationError(f"{what}: its type is {stated!r}; one of {', '.join(ROOM_TYPES)} would be right")
        return known[stated.lower()]
    for words in (label, *shape.words):
        if kind := room_type(words):
            return kind
    raise ConfigurationError(
        f"{what}: what kind of room it is cannot be told from its name; say it with a text in it, with data-type in an "
        f"SVG drawing, or under `rooms` in a file of notes: one of {', '.join(ROOM_TYPES)}"
    )


def _way(shape: Shape, kind: PassageKind, scale: float, number: int, *, required: bool) -> DrawnWay:
    """Makes a door, an opening or a window from a shape.

    It is placed along its swing, its line from first to last point, or its extent.
    """
    lines = tuple((_scaled(one, scale), _scaled(other, scale)) for one, other in shape.ways or (_ends(shape),))
    return DrawnWay(shape.name or f"number {number}", kind, lines, _percent(shape), shape.told, required)


def _ends(shape: Shape) -> Line:
    west, south, east, north = shape.box
    first, last = shape.points[0], shape.points[-1]
    across, up = abs(last[0] - first[0]), abs(last[1] - first[1])
    if not shape.closed and min(across, up) <= _STRAIGHT * max(across, up):
        return first, last
    return (west, south), (east, north)


def _percent(shape: Shape) -> float | None:
    """Returns by how many percent a door is drawn open, from `data-open` or a word in its classes, names and layers.

    Returns None if the drawing does not say it. Raises ConfigurationError if `data-open` is no number from 0 to 100.
    """
    stated = shape.facts.get("open")
    if stated is not None:
        try:
            percent = float(stated.rstrip("% "))
        except ValueError:
            percent = -1.0
        if not 0 <= percent <= 100:
            raise ConfigurationError(f"{shape.place}: data-open is {stated!r}; a number from 0 to 100 would be right")
        return percent
    words = {word for each in shape.words for word in plain_words(each)}
    return 0.0 if words & _SHUT else 100.0 if words & _OPEN else None


def _scaled(point: Point, scale: float) -> Point:
    return round(point[0] * scale, 4), round(point[1] * scale, 4)


def _left_out(shapes: Sequence[Shape], labels: Sequence[Label], used: Sequence[Shape]) -> list[str]:
    """Lists shapes and texts of a drawing that are no part of the plan, counted by kind, with the first names."""
    sorts: dict[str, list[str]] = {}
    for shape in shapes:
        sorts.setdefault(shape.sort or shape.place, []).append(shape.name)
    names = {label_in(shape, labels) for shape in used}
    if texts := [label.text for label in labels if label not in names]:
        sorts["texts" if len(texts) > 1 else "text"] = texts
    return counted({f"{sort}{_examples(found)}": len(found) for sort, found in sorts.items()})


def _examples(names: Sequence[str]) -> str:
    named = list(dict.fromkeys(name for name in names if name))
    shown = [f'"{name[:_LONGEST_NAME]}"' for name in named[:_MOST_NAMED]]
    return f": {', '.join(shown)}{', ...' if len(named) > _MOST_NAMED else ''}" if shown else ""
