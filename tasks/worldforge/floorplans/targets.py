"""Assigns the sets of a template to rooms, and decides the outcome of sets without rooms."""

from collections.abc import Sequence
from typing import Protocol, TypeVar

from ....schemas.templates.targets import RoomTarget
from ....schemas.worlds.world import PreferenceOutcome, Room


class TargetedSet(Protocol):
    """A material set or a furniture arrangement."""

    @property
    def Name(self) -> str:  # noqa: N802 (the service's name)
        """The set's name."""
        ...

    @property
    def TargetSet(self) -> RoomTarget:  # noqa: N802 (the service's name)
        """The rooms it is for."""
        ...


Set = TypeVar("Set", bound=TargetedSet)


def _for_room(target: RoomTarget, room: Room) -> int | None:
    """How a target means a room: 0 by name, 1 by type, 2 with all others; None: it does not."""
    if isinstance(target, str):
        return 2
    if room.name in (target.RoomNames or []):
        return 0
    return 1 if room.type in (target.RoomTypes or []) else None


def targeted(one_set: TargetedSet, rooms: Sequence[Room]) -> list[Room]:
    """The rooms a set asks for, whether it gets them or not."""
    return [room for room in rooms if _for_room(one_set.TargetSet, room) is not None]


def choose_sets(sets: Sequence[Set], rooms: Sequence[Room]) -> dict[str, int]:
    """Index of the set that each room follows, by the room's name.

    A set that names a room beats one that names its type, and that beats one for all rooms; among equals
    the first in the template wins.
    """
    chosen: dict[str, int] = {}
    for rank in range(3):
        for index, one_set in enumerate(sets):
            for room in rooms:
                if _for_room(one_set.TargetSet, room) == rank:
                    chosen.setdefault(room.name, index)
    return chosen


def why_unused(
    one_set: TargetedSet, sets: Sequence[TargetedSet], chosen: dict[str, int], rooms: Sequence[Room]
) -> tuple[str, PreferenceOutcome]:
    """Why a set has no rooms, and the outcome of its preferences: there are none, or other sets have them."""
    wanted = targeted(one_set, rooms)
    if not wanted:
        target = one_set.TargetSet
        preferred = [target] if isinstance(target, str) else target.RoomNames or target.RoomTypes or []
        return f"the plan has no room {', '.join(preferred)}", "missed"
    others = sorted({sets[chosen[room.name]].Name for room in wanted})
    return f"its rooms follow {', '.join(others)}", "contradictory"
