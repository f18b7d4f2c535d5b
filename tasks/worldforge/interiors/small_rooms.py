"""Furnishes rooms below 10 m2, which RoboMaker's templates did not have: the best of several attempts is kept."""

from collections import Counter
from collections.abc import Callable, Sequence

from ....schemas.templates.body import INTERIOR_PATH, SERVICE_LEAST_AREA_M2, WorldTemplateBody
from ....schemas.worlds.world import Preference
from ..furniture.usual_furniture import SMALL_ROOM_NEEDS
from .room_furnishing import RoomFurnishing

_TRIES = 6
"""Number of attempts to furnish a small room; the first two or three mostly have everything."""


def small_rooms(body: WorldTemplateBody) -> frozenset[str]:
    """Returns the names of the rooms that a template wishes below 10 m2."""
    return frozenset(room.Name for room in body.floorplan.Rooms if room.DesiredShape.Area < SERVICE_LEAST_AREA_M2)


def furnish_small(
    begin: Callable[[], RoomFurnishing],
    fill: Callable[[RoomFurnishing], None],
    kinds: Sequence[str],
    names: Counter[str],
) -> RoomFurnishing:
    """Furnishes a small room several times, and keeps the attempt that lacks least of its essential furniture.

    Args:
        begin: Makes the empty room.
        fill: Furnishes it.
        kinds: Kinds of furniture to place.
        names: Pieces of each kind in the world so far; afterwards those with the kept attempt.
    """
    before = names.copy()
    first: list[str] = []
    best: tuple[int, RoomFurnishing, Counter[str]] | None = None
    for _ in range(_TRIES):
        put_back(names, before)
        work = begin()
        for kind in first:
            work.place_first_that_fits((kind,))
        fill(work)
        lacking = _lacking(work, kinds)
        worth = sum(_worth(work, group) for group in lacking)
        if best is None or worth < best[0]:
            best = worth, work, names.copy()
        if not lacking:
            break
        # Whatever found no place comes first next time.
        first = [group[0] for group in lacking]
    assert best is not None
    put_back(names, best[2])
    return best[1]


def _worth(work: RoomFurnishing, group: Sequence[str]) -> int:
    """Returns the weight of a missing kind.

    It is more than that of all kinds listed after it, so that a bath rather has its toilet.
    """
    groups = SMALL_ROOM_NEEDS[work.room.type]
    place = next(place for place, each in enumerate(groups) if set(group) <= set(each))
    return 2 ** (len(groups) - place)


def put_back(names: Counter[str], before: Counter[str]) -> None:
    """Restores the counts of pieces after an attempt that is not kept.

    Args:
        names: Pieces of each kind in the world.
        before: Pieces of each kind before the attempt.
    """
    names.clear()
    names.update(before)


def _lacking(work: RoomFurnishing, kinds: Sequence[str]) -> list[list[str]]:
    """Returns the groups of kinds of which the room should have one and has none."""
    groups = ([kind for kind in group if kind in kinds] for group in SMALL_ROOM_NEEDS.get(work.room.type, ()))
    return [group for group in groups if group and not any(map(work.placed, group))]


def small_room_preferences(work: RoomFurnishing, kinds: Sequence[str]) -> list[Preference]:
    """Returns a missed preference for everything that a small room should have, and has no place for."""
    return [
        Preference(
            path=f"{INTERIOR_PATH}.Furniture",
            wish=f"{' or '.join(group)} in {work.room.name}, which is a {work.room.type}",
            outcome="missed",
            reason="; ".join(dict.fromkeys(work.missed[kind] for kind in group if kind in work.missed))
            or f"it found no place on {work.room.floor_m2:.1f} m2",
        )
        for group in _lacking(work, kinds)
    ]
