"""Kitchens: appliances and counters edge to edge in a line, around one corner or along three walls.

The order is that of the work: food comes out of the fridge at one end, is prepared on worktop beside the stove, and
goes on to the sink, which has the dishwasher at its side. Worktop is between stove and sink in every form.
"""

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Literal, NamedTuple

from ..furniture.usual_furniture import Density, front_of
from ..geometry.boxes import Pose, footprint
from ..geometry.parts import Style
from .candidate_poses import FLUSH_M
from .room_furnishing import RoomFurnishing
from .room_space import WALL_GAP_M, Side

_COUNTERS: dict[Density, tuple[int, int]] = {"Sparse": (1, 1), "Moderate": (2, 3), "Dense": (3, 4)}
"""Least and greatest number of additional kitchen counters by density; sink and corner counters come on top."""

_TALL_CHANCES: dict[Density, float] = {"Sparse": 0.0, "Moderate": 0.4, "Dense": 0.7}
"""Probability of a tall cupboard beside the fridge by density, if there is also place for two counters."""

_LEAST_PIECES = 6
"""Number of pieces that a kitchen should have.

They are fridge, stove, sink, dishwasher, and worktop on both sides of the stove.
"""

_CORNER_M = 0.2
_BETWEEN_M = 0.1
"""Distance between places of a line that stands in no corner."""
_MOST_TRIES = 16

_MOST_GAP_M = 0.2
"""Widest gap beside the second corner of a U-shaped kitchen, in metres: a strip of wood closes it."""

Form = Literal["line", "corner", "three walls"]
_FORMS: tuple[Form, ...] = ("line", "corner", "three walls")


class Unit(NamedTuple):
    """One piece of a kitchen's row of cabinets and appliances."""

    kind: str
    style: Style
    blind: bool = False
    """Whether a kitchen unit is in a corner, which people do not stand in front of."""


Placed = list[tuple[Unit, Pose]]


class Halves(NamedTuple):
    """The two halves of a kitchen run, each from its outer end to their joint, and optional units."""

    cooking: list[Unit]
    """Units of the first half of a kitchen's row, from the fridge to the worktop beside the stove."""
    washing: list[Unit]
    """Units of the second half of a kitchen's row, from the sink on."""
    corner: Unit
    counters: list[Unit]
    """Counters of each size, with which a wall can be filled."""


def line_up(work: RoomFurnishing, kinds: Sequence[str]) -> None:
    """Places a kitchen's cabinets and appliances along walls.

    Args:
        work: The kitchen; nothing stands in it yet.
        kinds: Kinds of furniture that belong to the row.
    """
    if not kinds:
        return
    liked = {kind: work.styles(kind)[0] for kind in kinds}
    compact = {kind: min(work.styles(kind), key=lambda style: (style.width_m, style.height_m)) for kind in kinds}
    if "Storage" in kinds:
        liked["Storage"] = work.style_of("Storage", "counter-sink")
        compact["Storage"] = work.style_of("Storage", "counter-sink-small")
    first, tall = work.dice.randint(*_COUNTERS[work.density]), work.dice.random() < _TALL_CHANCES[work.density]
    forms: list[Form] = sorted(_FORMS, key=lambda _: work.dice.random()) if "Storage" in kinds else list(_FORMS[:1])
    # Where no form has place for all, narrow appliances come, then a washing machine elsewhere.
    sets = [liked, compact, {kind: style for kind, style in compact.items() if kind != "WashingMachinesAndDryers"}]
    tried: list[tuple[dict[str, Style], Form, int]] = [
        (styles, form, number)
        for styles in (sets if "WashingMachinesAndDryers" in kinds else sets[:2])
        for form in forms
        for number in range(first, -1, -1)
    ]
    for styles, form, number in sorted(tried, key=lambda each: _poverty(each[1], each[2], len(each[0]))):
        if _settle(work, _options(work, form, _halves(work, styles, number, tall=tall and number > 1))):
            return
    # A tall fridge may stand before no window: where the corners have some, the line stands between them.
    for styles, form, number in tried:
        if form == "line" and number > 0:
            halves = _halves(work, styles, number, tall=False)
            if _settle(work, _along_one_wall(work, [*halves.cooking, *halves.washing], between=True)):
                return
    halves = _halves(work, compact, 0, tall=False)
    for half in (halves.washing, halves.cooking):
        if half:
            _settle(work, _along_one_wall(work, half))


def _poverty(form: Form, counters: int, others: int) -> int:
    """Rates a kitchen's completeness: 0 complete, 1 too few pieces, 2 no worktop between stove and sink."""
    few = others + counters + _FORMS.index(form) < _LEAST_PIECES
    return 2 if form == "line" and counters == 0 else int(few)


def _options(work: RoomFurnishing, form: Form, halves: Halves) -> Iterator[tuple[float, Placed]]:
    if form == "line":
        return _along_one_wall(work, [*halves.cooking, *halves.washing])
    return _around_a_corner(work, halves) if form == "corner" else _along_three_walls(work, halves)


def _halves(work: RoomFurnishing, styles: dict[str, Style], number: int, *, tall: bool) -> Halves:
    """Chooses the units of a kitchen with `number` additional counters."""
    counters = [Unit("Storage", work.style_of("Storage", form)) for form in ("counter-drawers", "counter")]
    # Drawers and doors by turns: the first beside the stove, towards the sink; the next between fridge and stove.
    spare = [counters[index % len(counters)] for index in range(number if "Storage" in styles else 0)]
    cooking = [Unit("Fridges", styles["Fridges"])] if "Fridges" in styles else []
    cooking += [Unit("Storage", work.style_of("Storage", "pantry"))] if tall else []
    cooking += [*spare[1:2], *([Unit("Ovens", styles["Ovens"])] if "Ovens" in styles else []), *spare[:1]]
    washed = ("Storage", "DishWashers", "WashingMachinesAndDryers")
    washing = [Unit(kind, styles[kind]) for kind in washed if kind in styles]
    corner = Unit("Storage", work.style_of("Storage", "counter-corner"), blind=True)
    return Halves(cooking, [*washing, *spare[2:]], corner, counters)


def _length(units: Sequence[Unit]) -> float:
    return sum(unit.style.width_m for unit in units) + FLUSH_M * (len(units) - 1)


def _along_one_wall(
    work: RoomFurnishing, units: Sequence[Unit], *, between: bool = False
) -> Iterator[tuple[float, Placed]]:
    """Yields layouts of the units in a line along one wall, with their scores, either way round.

    They are at both ends of every free stretch of wall; with `between`, also at places between the ends.
    """
    length = _length(units)
    depth, front = _reach(work, units)
    for side in work.space.sides:
        liking = 0.4 * work.dice.random()
        for low, high in work.space.spans(side, depth, front):
            if high - low < length:
                continue
            steps = int((high - length - low) / _BETWEEN_M) if between else 0
            for start in (low, high - length, *(low + _BETWEEN_M * step for step in range(1, steps + 1))):
                for order in (units, units[::-1]):
                    placed = _in_line(side, order, start)
                    yield liking + _score(side, order, start, length), placed


def _reach(work: RoomFurnishing, units: Sequence[Unit]) -> tuple[float, float]:
    """Returns the depth of the shallowest kitchen unit, and the smallest free space that any unit needs in front."""
    return min(unit.style.depth_m for unit in units), min(front_of(unit.kind, work.room.type) for unit in units)


def _score(side: Side, order: Sequence[Unit], start: float, length: float) -> float:
    """Scores a straight kitchen: best if it begins in a corner, with the fridge."""
    at_low, at_high = start - side.low < _CORNER_M, side.high - start - length < _CORNER_M
    fridge = (at_low and order[0].kind == "Fridges") or (at_high and order[-1].kind == "Fridges")
    return 1.0 * (at_low or at_high) + 0.6 * fridge


def _in_line(side: Side, units: Sequence[Unit], start: float) -> Placed:
    """Returns kitchen units at poses next to each other from a point on, with their backs to the wall."""
    placed: Placed = []
    for unit in units:
        width, depth = unit.style.width_m, unit.style.depth_m
        placed.append((unit, side.pose(start + width / 2, WALL_GAP_M + depth / 2)))
        start += width + FLUSH_M
    return placed


def _around_a_corner(work: RoomFurnishing, halves: Halves) -> Iterator[tuple[float, Placed]]:
    """Yields placements of an L-shaped kitchen, with scores: one half on each of two walls, worktop in the corner."""
    outward, beyond = [halves.corner, *reversed(halves.cooking)], _beyond(halves.corner)
    for first, second, ends in _corners(work):
        one, other = _from(first, outward, ends[0], WALL_GAP_M), _from(second, halves.washing, ends[1], beyond)
        yield work.dice.random(), [*one, *other]


def _along_three_walls(work: RoomFurnishing, halves: Halves) -> Iterator[tuple[float, Placed]]:
    """Yields placements of a U-shaped kitchen, with scores.

    The half with the sink fills the wall between two corners; the stove is on one side, counters are on the other.
    """
    corner, counters = halves.corner, halves.counters
    beyond = _beyond(corner)
    for middle, cooking, near in _corners(work):
        for again, third, far in _corners(work):
            if again != middle or third.quarter == cooking.quarter or near[0][1] == far[0][1]:
                continue
            room_m = abs(far[0][0] - near[0][0]) - 2 * beyond
            filled = _filled(room_m, halves.washing, counters)
            if filled is None:
                continue
            # The second corner belongs to the third wall: a gap is beside it, and each wall's units touch.
            yield (
                work.dice.random(),
                [
                    *_from(middle, [corner, *filled], near[0], WALL_GAP_M),
                    *_from(cooking, halves.cooking[::-1], near[1], beyond),
                    *_from(third, [corner, *counters], far[1], WALL_GAP_M),
                ],
            )


def _filled(room_m: float, washing: Sequence[Unit], counters: Sequence[Unit]) -> list[Unit] | None:
    """Returns units that fill a wall of given length, the sink's half and counters; `None` if no combination fits."""
    sink = [unit for unit in washing if unit.kind != "Storage" or unit.style.form.startswith("counter-sink")]
    for numbers in product(range(4), repeat=len(counters)):
        units = [*sink, *(unit for unit, number in zip(counters, numbers, strict=True) for _ in range(number))]
        if units and 0 <= room_m - _length(units) - FLUSH_M <= _MOST_GAP_M:
            return units
    return None


def _beyond(corner: Unit) -> float:
    """Returns the distance along a wall from a room's corner to the unit next to the corner unit."""
    return WALL_GAP_M + corner.style.depth_m + FLUSH_M


End = tuple[float, int]
"""Inner end of a wall in a corner: coordinate of the face of the adjacent wall, and the direction away from it."""


def _corners(work: RoomFurnishing) -> Iterator[tuple[Side, Side, tuple[End, End]]]:
    """Yields pairs of walls that meet in an inside corner, in both orders."""
    for first in work.space.sides:
        for second in work.space.sides:
            ends = _meet(first, second)
            if ends is not None:
                yield first, second, ends


def _meet(first: Side, second: Side) -> tuple[End, End] | None:
    """Returns the ends of two walls at their inside corner; `None` if they do not meet in one.

    An end is the place of the corner along the wall in metres, and the direction (1 or -1) away from it.
    """
    if (first.quarter - second.quarter) % 2 == 0:
        return None
    found: list[End] = []
    for side, other in ((first, second), (second, first)):
        if 0 < other.face - side.low < _CORNER_M:
            found.append((other.face, 1))
        elif 0 < side.high - other.face < _CORNER_M:
            found.append((other.face, -1))
    return (found[0], found[1]) if len(found) == 2 else None


def _from(side: Side, units: Sequence[Unit], end: End, gap: float) -> Placed:
    """Returns kitchen units at poses along a wall, from one of its ends on, which they are `gap` metres away from."""
    at, way = end
    if way > 0:
        return _in_line(side, units, at + gap)
    return _in_line(side, units[::-1], at - gap - _length(units))


def _settle(work: RoomFurnishing, options: Iterator[tuple[float, Placed]]) -> bool:
    """Places the best kitchen layout that fits as a whole; returns whether there was one."""
    tries = 0
    for _, placed in sorted(options, key=lambda option: -option[0]):
        if not all(_fits(work, unit, pose) for unit, pose in placed):
            continue
        if work.space.stays_open(*(footprint(pose, unit.style.width_m, unit.style.depth_m) for unit, pose in placed)):
            for unit, pose in placed:
                work.place_at(unit.kind, unit.style, pose, zone=not unit.blind)
            return True
        tries += 1
        if tries == _MOST_TRIES:
            break
    return False


def _fits(work: RoomFurnishing, unit: Unit, pose: Pose) -> bool:
    if unit.blind:
        return work.space.admits(footprint(pose, unit.style.width_m, unit.style.depth_m))
    return work.fits(unit.kind, unit.style, pose)
