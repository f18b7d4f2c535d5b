"""Which set of a template is for which room, and what became of what the sets wish."""

from collections.abc import Sequence
from typing import Protocol, TypeVar

from ...schemas.world import Room, WishOutcome
from ...schemas.world_template_body import TemplateTargetSet


class TargetedSet(Protocol):
    """A material set or a furniture arrangement."""

    @property
    def Name(self) -> str:  # noqa: N802 (the service's name)
        """The set's name."""
        ...

    @property
    def TargetSet(self) -> TemplateTargetSet:  # noqa: N802 (the service's name)
        """The rooms it is for."""
        ...


Set = TypeVar("Set", bound=TargetedSet)


def targeted(one_set: TargetedSet, rooms: Sequence[Room]) -> list[Room]:
    """The rooms a set asks for, whether it gets them or not."""
    target = one_set.TargetSet
    names, types = target.RoomNames or [], target.RoomTypes or []
    return [room for room in rooms if room.name in names or room.type in types]


def choose_sets(sets: Sequence[Set], rooms: Sequence[Room]) -> dict[str, int]:
    """Index of the set that each room follows, by the room's name.

    A set that names a room beats one that names its type; among equals the first in the template wins.
    """
    chosen: dict[str, int] = {}
    for by_name in (True, False):
        for index, one_set in enumerate(sets):
            target = one_set.TargetSet
            for room in rooms:
                wanted = room.name in (target.RoomNames or []) if by_name else room.type in (target.RoomTypes or [])
                if wanted:
                    chosen.setdefault(room.name, index)
    return chosen


def why_unused(
    one_set: TargetedSet, sets: Sequence[TargetedSet], chosen: dict[str, int], rooms: Sequence[Room]
) -> tuple[WishOutcome, str]:
    """What becomes of the wishes of a set without rooms: there are none, or other sets have them."""
    wanted = targeted(one_set, rooms)
    if not wanted:
        target = one_set.TargetSet
        return "missed", f"the plan has no room {', '.join(target.RoomNames or target.RoomTypes or [])}"
    others = sorted({sets[chosen[room.name]].Name for room in wanted})
    return "contradictory", f"its rooms follow {', '.join(others)}"
