"""Fits drawn doors, openings and windows into the walls of the floor plan."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple, TypeVar

from ....schemas.wire.errors import ConfigurationError
from ....schemas.worlds.world import PassageKind, Preference
from ..floorplans.connections import Way
from ..floorplans.partition import UNITS_PER_M, Contact
from ..floorplans.walls import Pane, Side, Walls
from .drawn_shapes import Line
from .squaring import Lines

_REACH = 8
"""Largest distance between a drawn door and the centre line of its wall, in grid units."""
_LEAST: dict[PassageKind, int] = {"Doorway": 17, "Opening": 16}
"""Smallest width of doorways and openings, in grid units: 0.8 m stay clear, beside an open leaf, too."""
_NARROWEST_M = 0.5
_WIDEST_M = 2.4
"""Largest width of a door, with two leaves, in metres."""
_LEAST_WINDOW = 8
_AS_NEAR = 1.0
"""Difference of distances from walls, in units, that says nothing about which of two lines is the door."""
_FURTHER = 4.0
"""Largest amount, in grid units, by which the likelier line may be further from a wall than another line.

Up to it, the likelier line is the door: doors are drawn on a face of thick walls, and open leaves are drawn at thin
ones.
"""


Wall = TypeVar("Wall", Contact, Side)


class DrawnWay(NamedTuple):
    """A door, opening or window as drawn, in metres."""

    name: str
    kind: PassageKind
    lines: tuple[Line, ...]
    """Lines from end to end along which it may be: one, or both of a door's swing; the nearest wall decides."""
    percent: float | None = None
    """Opening of a drawn door in percent; `None`: the drawing does not say."""
    told: bool | None = True
    """Whether the first of several lines is likelier, where all are in walls.

    `None`: the line nearest to a wall is taken.
    """
    required: bool = True
    """Whether it is an error if a drawn door fits in no wall; doors of a robot's map may be noise."""


class FittedWay(NamedTuple):
    """A door or opening placed in a wall, and how far its door is open."""

    way: Way
    percent: float | None


class _Place(NamedTuple):
    """Position of a drawn door or window on a line of walls, in grid units."""

    horizontal: bool
    at: float
    start: float
    end: float

    def off(self, horizontal: bool, at: int, start: int, end: int) -> float | None:
        """Returns the distance of a drawn door or window from a wall, in grid units.

        `None` if it is not beside the wall.
        """
        shared = min(end, self.end) - max(start, self.start)
        if horizontal != self.horizontal or shared < (self.end - self.start) / 2 or abs(at - self.at) > _REACH:
            return None
        return abs(at - self.at)


def fit_way(
    drawn: DrawnWay, walls: Walls, moved: tuple[Lines, Lines], names: Sequence[str], file: str, ways: Sequence[Way]
) -> tuple[Way | None, Preference]:
    """Places a drawn door or opening in the wall between two rooms.

    Args:
        drawn: The drawn door, opening or window.
        walls: The walls.
        moved: Grid units of the drawing's coordinates.
        names: Names of the rooms.
        file: The drawing.
        ways: Doors and openings that are placed in walls already.

    Returns:
        The way, and how far it is as drawn; no way for a door to the outside.

    Raises:
        ConfigurationError: The door or opening lies in no wall, or does not fit there.
    """
    path, what = f"{file}#{drawn.name}", "opening" if drawn.kind == "Opening" else "door"
    inner, outer, width_m = _choose(drawn, walls, moved, file)
    wish = f"{what} {drawn.name} of {width_m:.2f} m"
    if inner is None or (outer is not None and outer[1] < inner[1]):
        if outer is None:
            raise ConfigurationError(f"{file}: {wish}: {_astray(drawn, walls, moved, names)}")
        reason = f"it leads out of {names[outer[2][4]]}, and worlds end at their outer walls"
        return None, Preference.judged(path, wish, reason)
    place, _, contact = inner
    if width_m < _NARROWEST_M:
        raise ConfigurationError(f"{file}: {wish}: it is narrower than {_NARROWEST_M:g} m; is the scale right?")
    if width_m > _WIDEST_M and drawn.kind == "Doorway":
        raise ConfigurationError(
            f"{file}: {wish}: it is wider than {_WIDEST_M:g} m; is the scale right? What has no leaf is an opening"
        )
    pair = (min(contact.low, contact.high), max(contact.low, contact.high))
    between = f"between {names[pair[0]]} and {names[pair[1]]}"
    width = max(_LEAST[drawn.kind], round(place.end - place.start))
    low, high = walls.clear_span(contact)
    if high - low < width and (drawn.kind == "Opening" or not drawn.required):  # from corner to corner
        width = max(_LEAST[drawn.kind], high - low)
    if high - low < width:
        raise ConfigurationError(
            f"{file}: {wish} {between}: their wall has {(high - low) / UNITS_PER_M:.2f} m between its corners, and a "
            f"{what} takes {width / UNITS_PER_M:.2f} m"
        )
    start = round((place.start + place.end - width) / 2)
    start = min(max(start, low), high - width)
    way = Way(pair, contact, drawn.kind, start, start + width, True)
    if any(each.contact == contact and each.start < way.end and way.start < each.end for each in ways):
        raise ConfigurationError(f"{file}: {wish} {between}: another door or opening is there")
    as_drawn = abs(width / UNITS_PER_M - width_m) <= 0.5 / UNITS_PER_M + 1e-6
    reason = f"it is {width / UNITS_PER_M:.2f} m wide here, so that 0.8 m stay clear"
    return way, Preference.judged(path, f"{wish} {between}", "" if as_drawn else reason)


def _astray(drawn: DrawnWay, walls: Walls, moved: tuple[Lines, Lines], names: Sequence[str]) -> str:
    """Tells why a door or opening is in no wall: it crosses one, or is away from all."""
    for place in _places(drawn.lines, moved):
        for contact in walls.contacts:
            horizontal, at, start, end = contact[2:]
            if horizontal != place.horizontal and start <= place.at <= end and place.start <= at <= place.end:
                rooms = f"{names[contact.low]} and {names[contact.high]}"
                return f"it crosses the wall between {rooms}; draw it along that wall"
    return "it lies in no wall of a room; draw it in a wall between two rooms"


_Near = tuple[_Place, float, Wall]
"""Position of a drawn door or window, its distance from a wall in grid units, and the wall."""


def _choose(
    drawn: DrawnWay, walls: Walls, moved: tuple[Lines, Lines], file: str
) -> tuple[_Near[Contact] | None, _Near[Side] | None, float]:
    """Returns the nearest inner wall and the nearest outer wall to a drawn door, and the door's width in metres.

    A wall is `None` if the door lies in none of its kind. Of the lines that the door may be along, the one nearest to
    any wall counts. Raises ConfigurationError for a door that is drawn with its swing alone, if both ends of it lie in
    walls.
    """
    found: list[tuple[float, int, _Near[Contact] | None, _Near[Side] | None, float]] = []
    for number, line in enumerate(drawn.lines):
        places = _places([line], moved)
        inner = _nearest(places, [(each[2:], each) for each in walls.contacts])
        outer = _nearest(places, [(side[:4], side) for side in walls.sides])
        off = min((each[1] for each in (inner, outer) if each), default=inf)
        width_m = max(place.end - place.start for place in places) / UNITS_PER_M
        found.append((off, number, inner, outer, width_m))
    found.sort(key=lambda each: each[:2])
    if drawn.told is False and len(found) > 1 and found[1][0] - found[0][0] <= _AS_NEAR:
        raise ConfigurationError(
            f"{file}: door {drawn.name}: both ends of its swing lie in walls; its leaf, drawn open, or a line along "
            "the wall in place of the swing, would be right"
        )
    if drawn.told:
        found = [each for each in found if each[0] <= found[0][0] + _FURTHER]
        return min(found, key=lambda each: each[1])[2:]
    return found[0][2:]


def fit_window(
    drawn: DrawnWay, sides: Sequence[Side], moved: tuple[Lines, Lines], file: str
) -> tuple[Pane | None, Preference]:
    """Places a drawn window in an outer wall, as far as it fits.

    Args:
        drawn: The drawn door, opening or window.
        sides: The outer walls.
        moved: Grid units of the drawing's coordinates.
        file: The drawing.

    Returns:
        The window, cut off at the wall's ends, or `None` if it fits in no outer wall; and how far it is as drawn.
    """
    path, places = f"{file}#{drawn.name}", _places(drawn.lines, moved)
    wish = f"window {drawn.name} of {max(each.end - each.start for each in places) / UNITS_PER_M:.2f} m"
    found = _nearest(places, [(side[:4], side) for side in sides])
    if found is None:
        return None, Preference.judged(path, wish, "it lies in no outer wall")
    place, _, (horizontal, at, low, high, room, _) = found
    start, end = max(round(place.start), low + 2), min(round(place.end), high - 2)
    if end - start < _LEAST_WINDOW:
        return None, Preference.judged(path, wish, "its wall has no 0.4 m for it between the corners")
    return Pane(horizontal, at, start, end, room), Preference.judged(path, wish)


def _places(drawn: Sequence[Line], moved: tuple[Lines, Lines]) -> list[_Place]:
    """Returns the possible positions of a drawn door or window.

    They are along its longer side, or along either side if both are about as long.
    """
    found: list[_Place] = []
    for one, other in drawn:
        (x0, x1), (y0, y1) = (_span(lines, one[axis], other[axis]) for axis, lines in enumerate(moved))
        along, up = x1 - x0, y1 - y0
        found += [_Place(True, (y0 + y1) / 2, x0, x1)] if along >= up else []
        found += [_Place(False, (x0 + x1) / 2, y0, y1)] if up >= along else []
    return found


def _span(lines: Lines, one: float, other: float) -> tuple[float, float]:
    """Returns the span of an opening: its drawn width around its fitted middle, in grid units."""
    middle, half = lines.place((one + other) / 2), abs(one - other) / 2 * UNITS_PER_M
    return middle - half, middle + half


def _nearest(places: Sequence[_Place], walls: Sequence[tuple[tuple[bool, int, int, int], Wall]]) -> _Near[Wall] | None:
    """Finds the wall nearest to a drawn door or opening, and its distance; None if it lies in no wall."""
    found: list[tuple[float, int, _Place]] = []
    for index, (line, _) in enumerate(walls):
        for place in places:
            off = place.off(*line)
            if off is not None:
                found.append((off, index, place))
    if not found:
        return None
    off, index, place = min(found)
    return place, off, walls[index][1]
