"""Hill-climbing search for floor plans with L-shaped rooms: random slicing trees, improved by small changes.

It is used where rectangular rooms do badly: a closet in the corner of a hall is better than one along its whole side.
"""

from collections.abc import Sequence
from math import inf, log, sqrt
from random import Random
from typing import NamedTuple

from ....schemas.wire.errors import WorldGenerationError
from ....schemas.worlds.world import RoomType
from .brief import (
    EXTERIOR_WALL,
    FOOTPRINT_WEIGHTS,
    HABITABLE,
    INTERIOR_WALL,
    MISSED_CONNECTION,
    MISSED_PREFERENCE,
    NOT_CONNECTED,
    OPENING_WIDTH,
    OUTLIER,
    RATIO_TOLERANCE,
    STRANGE_NEIGHBOURS,
    TOO_NARROW,
    Brief,
    affinity,
    doors_in,
    shared_spans,
)
from .connections import AREA_TOLERANCE, floor_areas, inside_walls
from .partition import POCKETS, SIDE_BY_SIDE, STACKED, UNITS_PER_M, Partition, area, extent, partition, slenderness

MAX_CLIMBS = 40
"""Limit of hill climbs for a floor plan before giving up; the first few nearly always succeed."""

_CLIMBS = 5
_TOP = 4
"""Number of the best floor plans of a hill climb that are examined further."""

_STEPS_PER_SQUARE = 3
"""Steps of a hill climb, as a multiple of the square of the number of rooms."""

_LEAST_STEPS = 20
_DARK = 0.6

_BENT: dict[RoomType, float] = {"Hallway": 0.1, "Living": 0.5, "Dining": 0.8, "Kitchen": 0.8, "Bedroom": 0.8}
"""Cost of an L-shaped room by room type; an L-shaped bath or closet is worse than most alternatives."""

_BENT_OTHERWISE = 1.5
_TEMPERATURE = 1.0
_RATIO_SHARE = 0.1

_PLAIN_RATIOS = (1.0, 1.2, 4 / 3, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0)

_AREA_WEIGHT = 0.25
_SETTLINGS = 3
"""Number of times that a plan is divided again after the area that walls take was measured."""


class Draft(NamedTuple):
    """Input from which a floor plan is cut: slicing tree, footprint ratio and room areas."""

    expression: tuple[int, ...]
    ratio: float
    """Extent of the footprint along x over its extent along y."""
    areas: tuple[float, ...]
    """Area of each room in square metres, between the centre lines of its walls."""


class PlanEvaluator:
    """Computes the cost of a floor plan against a template's preferences; 0 is perfect."""

    def __init__(self, brief: Brief) -> None:
        self.brief = brief
        self.min_sides = brief.min_sides
        self.possible_ratios = [
            # A little off the limit, because sides are rounded to units.
            min(ratio, 0.97 * square_metres * UNITS_PER_M**2 / (least - INTERIOR_WALL) ** 2)
            for ratio, square_metres, least in zip(brief.ratios, brief.areas_m2, self.min_sides, strict=True)
        ]
        self.log_ratios = [log(ratio) for ratio in brief.ratios]
        self.log_footprint = log(brief.footprint_ratio)
        self.affinities = [[affinity(one, other) for other in brief.types] for one in brief.types]

    def cost(self, plan: Partition, limit: float = inf) -> float:
        """Returns the cost of a floor plan, or a partial cost that already exceeds the limit."""
        cost = self._shapes(plan)
        return cost if cost > limit else cost + self._neighbours(plan)

    def is_valid(self, plan: Partition) -> bool:
        """Whether every room of a floor plan is wide enough and reachable."""
        wide = all(arm >= least for arm, least in zip(plan.arms, self.min_sides, strict=True))
        return wide and _reached_from_first(self._ways(plan)[0]) == (1 << len(plan.rooms)) - 1

    def is_bent(self, plan: Partition) -> bool:
        """Whether the floor plan has an L-shaped room."""
        return any(len(corners) > 4 for corners in plan.rooms)

    def _shapes(self, plan: Partition) -> float:
        off = abs(log(plan.width / plan.height) - self.log_footprint)
        cost = FOOTPRINT_WEIGHTS[min(len(plan.rooms), 3)] * (
            off + (MISSED_PREFERENCE if off > RATIO_TOLERANCE else 0.0)
        )
        inside = inside_walls(plan)
        for room, corners in enumerate(plan.rooms):
            kind = self.brief.types[room]
            if plan.arms[room] < self.min_sides[room]:
                cost += TOO_NARROW + (self.min_sides[room] - plan.arms[room]) / UNITS_PER_M
                if plan.arms[room] <= EXTERIOR_WALL:
                    continue
            cost += self._off_shape(inside, room)
            if len(corners) > 4:
                cost += _BENT.get(kind, _BENT_OTHERWISE)
            if kind in HABITABLE:
                box = extent(corners)
                if box.x0 > 0 and box.y0 > 0 and box.x1 < plan.width and box.y1 < plan.height:
                    cost += _DARK
        return cost

    def _off_shape(self, inside: Partition, room: int) -> float:
        """Returns the cost of a room's deviation from its preferred aspect ratio and area."""
        off = log(slenderness(inside, room)) - self.log_ratios[room]
        if self.brief.types[room] == "Hallway" and off > 0:
            off /= 2  # a hallway that is longer than preferred is still a good hallway
        off = abs(off)
        cost = off + OUTLIER * off * off + (MISSED_PREFERENCE if off > RATIO_TOLERANCE else 0.0)
        off = abs(area(inside.rooms[room]) / (self.brief.areas_m2[room] * UNITS_PER_M**2) - 1)
        return cost + _AREA_WEIGHT * off + (MISSED_PREFERENCE if off > AREA_TOLERANCE else 0.0)

    def _neighbours(self, plan: Partition) -> float:
        if len(plan.rooms) == 1:
            return 0.0
        ways, missed = self._ways(plan)
        cost = MISSED_CONNECTION * missed
        reached = _reached_from_first(ways)
        for room, row in enumerate(self.affinities):
            if not reached >> room & 1:
                cost += NOT_CONNECTED
            best = max((row[other] for other in range(len(row)) if ways[room] >> other & 1), default=0.0)
            cost += STRANGE_NEIGHBOURS * (1 - best)
        return cost

    def _ways(self, plan: Partition) -> tuple[list[int], int]:
        """Returns for every room a bit set of the rooms it can be connected to.

        The second value is the number of requested connections that do not fit.
        """
        ways = [0] * len(plan.rooms)
        doors: dict[tuple[int, int], int] = {}
        openings: set[tuple[int, int]] = set()
        for pair, span in shared_spans(plan):
            fitting = doors_in(span)
            if span >= OPENING_WIDTH:
                openings.add(pair)
            if fitting > 0:
                doors[pair] = doors.get(pair, 0) + fitting
                ways[pair[0]] |= 1 << pair[1]
                ways[pair[1]] |= 1 << pair[0]
        missed = 0
        for pair, kind, count in self.brief.requests:
            if kind == "Doorway":
                missed += max(0, count - doors.get(pair, 0))
            elif pair in openings:
                ways[pair[0]] |= 1 << pair[1]
                ways[pair[1]] |= 1 << pair[0]
            else:
                missed += 1
        return ways, missed


def _reached_from_first(ways: Sequence[int]) -> int:
    """Returns a bit set of the rooms that can be reached from room 0 through connections.

    `ways` has a bit set of the connected rooms for each room.
    """
    reached, fresh = 1, 1
    while fresh:
        found = 0
        for room, others in enumerate(ways):
            if fresh >> room & 1:
                found |= others
        fresh = found & ~reached
        reached |= fresh
    return reached


def climb_to_partition(brief: Brief, dice: Random, *, below: float | None) -> Partition | None:
    """Searches by hill climbing for a floor plan that may have L-shaped rooms.

    Args:
        brief: The preferences.
        dice: The source of chance.
        below: The cost of the best partition of rectangles; nothing unless one with L-shaped rooms costs less. Without
            it, any valid partition will do.

    Returns:
        The cheapest plan that was found; `None` if none with L-shaped rooms costs less than `below`.

    Raises:
        WorldGenerationError: `below` is not given, and no valid partition was met in `MAX_CLIMBS` hill climbs.
    """
    evaluator = PlanEvaluator(brief)
    valid: dict[Partition, float] = {}
    for climb in range(MAX_CLIMBS):
        if climb >= _CLIMBS and (valid or below is not None):
            break
        steps = _climb(evaluator, dice, any_footprint=climb >= _CLIMBS)
        for draft in sorted(steps, key=lambda draft: steps[draft])[:_TOP]:
            plan, cost = _settled(evaluator, draft)
            if evaluator.is_valid(plan) and (below is None or (evaluator.is_bent(plan) and cost < below)):
                valid[plan] = cost
    if valid:
        return min(valid, key=lambda plan: valid[plan])
    if below is not None:
        return None
    raise WorldGenerationError(
        f"no partition of {sum(brief.areas_m2):g} m2 into {len(brief.areas_m2)} rooms where every room is wide "
        f"enough and connected was found in {MAX_CLIMBS} attempts"
    )


def _climb(evaluator: PlanEvaluator, dice: Random, *, any_footprint: bool) -> dict[Draft, float]:
    """Improves one random slicing tree by small changes; steps back are taken less and less.

    Args:
        evaluator: Computes the cost of a plan.
        dice: The source of chance.
        any_footprint: Begin with any outline, where the desired one has led nowhere.

    Returns:
        The drafts on the way, with the costs of their partitions.
    """
    brief = evaluator.brief
    count = len(brief.areas_m2)
    ratios = _footprint_ratios(evaluator)
    expression = _random_tree(dice.sample(range(count), count), dice)
    ratio = dice.choice(ratios) if any_footprint else brief.footprint_ratio
    draft = Draft(tuple(expression), ratio, brief.areas_m2)
    plan = _cut(evaluator, draft)
    cost = evaluator.cost(plan)
    taken = {draft: cost}
    steps = max(_LEAST_STEPS, _STEPS_PER_SQUARE * count**2)
    for step in range(steps):
        changed = draft._replace(areas=_with_walls(evaluator, draft, plan))
        if count == 1 or dice.random() < _RATIO_SHARE:
            changed = changed._replace(ratio=brief.footprint_ratio if dice.random() < 0.5 else dice.choice(ratios))
        else:
            changed = changed._replace(expression=tuple(_changed([*draft.expression], dice)))
        changed_plan = _cut(evaluator, changed)
        limit = cost + _TEMPERATURE * (1 - step / steps) * dice.expovariate(1)
        changed_cost = evaluator.cost(changed_plan, limit)
        if changed_cost <= limit:
            draft, plan, cost = changed, changed_plan, changed_cost
            taken[draft] = cost
    return taken


def _settled(evaluator: PlanEvaluator, draft: Draft) -> tuple[Partition, float]:
    """Divides a draft into rooms repeatedly until the floor areas are near the preferred ones.

    Returns plan and cost.
    """
    plan = _cut(evaluator, draft)
    best = plan, evaluator.cost(plan)
    for _ in range(_SETTLINGS):
        draft = draft._replace(areas=_with_walls(evaluator, draft, plan))
        plan = _cut(evaluator, draft)
        best = min(best, (plan, evaluator.cost(plan)), key=lambda found: found[1])
    return best


def _with_walls(evaluator: PlanEvaluator, draft: Draft, plan: Partition) -> tuple[float, ...]:
    """Returns corrected room areas for dividing a draft again, if the floors of its plan are too small or too large."""
    return tuple(
        between * min(max(preferred * UNITS_PER_M**2 / max(floor, 1.0), 0.5), 2.0)
        for between, preferred, floor in zip(draft.areas, evaluator.brief.areas_m2, floor_areas(plan), strict=True)
    )


def _footprint_ratios(evaluator: PlanEvaluator) -> list[float]:
    """Returns footprint ratios to try when the preferred ratio does not suit the rooms."""
    desired = evaluator.brief.footprint_ratio
    if len(evaluator.possible_ratios) == 1:
        ratio = evaluator.possible_ratios[0]
        return [desired, ratio, 1 / ratio]
    return [desired, *_PLAIN_RATIOS, *(1 / ratio for ratio in _PLAIN_RATIOS)]


def _cut(evaluator: PlanEvaluator, draft: Draft) -> Partition:
    square_units = sum(draft.areas) * UNITS_PER_M**2
    width = round(sqrt(square_units * draft.ratio))
    return partition(draft.expression, draft.areas, evaluator.possible_ratios, width, round(square_units / width))


def _random_tree(rooms: list[int], dice: Random) -> list[int]:
    if len(rooms) == 1:
        return rooms
    split = dice.randrange(1, len(rooms))
    return [*_random_tree(rooms[:split], dice), *_random_tree(rooms[split:], dice), _random_operator(dice)]


def _random_operator(dice: Random) -> int:
    if dice.random() < 0.15:
        return dice.choice(POCKETS)
    return SIDE_BY_SIDE if dice.random() < 0.5 else STACKED


def _changed(expression: list[int], dice: Random) -> list[int]:
    """Returns a copy of a slicing tree with one random change.

    The change swaps two rooms, replaces an operator, or rebuilds a part.
    """
    changed = expression.copy()
    chance = dice.random()
    if chance < 0.5:
        one, other = dice.sample([index for index, token in enumerate(changed) if token >= 0], 2)
        changed[one], changed[other] = changed[other], changed[one]
        return changed
    index = dice.choice([index for index, token in enumerate(changed) if token < 0])
    if chance < 0.8:
        changed[index] = _random_operator(dice)
        return changed
    first = _first_token(changed, index)
    rooms = [token for token in changed[first:index] if token >= 0]
    dice.shuffle(rooms)
    return [*changed[:first], *_random_tree(rooms, dice), *changed[index + 1 :]]


def _first_token(expression: Sequence[int], root: int) -> int:
    """Returns the index in the postfix expression at which the subtree that ends at `root` begins."""
    open_trees, index = 1, root
    while True:
        open_trees += -1 if expression[index] >= 0 else 1
        if not open_trees:
            return index
        index -= 1
