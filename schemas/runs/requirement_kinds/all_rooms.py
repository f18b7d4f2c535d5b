"""Requirement that the robot visits every room."""

from collections.abc import Mapping, Sequence
from typing import Literal

from pydantic import Field

from ...wire.base import optional
from ...wire.common import counted
from ...worlds.world import Point, contains
from .kind import (
    ROUNDING_S,
    STOP_OR_REACHED,
    Look,
    NamePatterns,
    Numbers,
    RobotRequirement,
    Rule,
    Scene,
    Seconds,
    is_meant,
)

_MOST_NAMED = 5
"""Maximum number of unvisited rooms that a result names."""


class AllRoomsRequirement(RobotRequirement):
    """Pass criterion: the robot visits every room of the world."""

    violated_when = "its body was not in every room of the world; or not before `by_s`"
    more_members = "`ignore`: names of rooms that do not count, `*` for any text"
    needs_world = True

    kind: Literal["all_rooms"] = Field(description="`all_rooms`.")
    by_s: Seconds | None = optional("Simulated time at which the last room has to be visited at the latest.")
    ignore: NamePatterns | None = optional("Names of rooms that do not count, with `*` for any text.")
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")
    stop: bool = Field(default=False, description=STOP_OR_REACHED)


class AllRoomsRule(Rule[AllRoomsRequirement]):
    """Records when each room was visited, and judges the requirement to visit all rooms."""

    is_reached = False

    def __init__(self, asked: AllRoomsRequirement) -> None:
        super().__init__(asked)
        self.visited_s: dict[str, float] = {}
        """Simulated time of the first visit, by room."""
        self._rooms: tuple[str, ...] = ()
        self._began_s: float | None = None
        """Simulated time of the first check, in seconds: recordings may have no pose at 0."""

    def bind(self, scene: Scene) -> Look:
        """Finds the rooms to visit, and returns the check that determines at each look which room the body is in.

        Raises RequirementError if there is no world, or if `ignore` fits none of its rooms.
        """
        if scene.world is None:
            raise self.cannot("it asks for the rooms of a world, but there is no world")
        rooms = {each.name: each.polygon for each in scene.world.floorplan.rooms}
        if unknown := [
            each for each in self.asked.ignore or () if not any(is_meant(name, [each], None) for name in rooms)
        ]:
            raise self.cannot(f"ignore is {unknown[0]!r}, which fits no room; there are {', '.join(rooms)}")
        self.begin({name: polygon for name, polygon in rooms.items() if is_meant(name, None, self.asked.ignore)})
        position, polygons = scene.position(self), rooms

        def look(time_s: float) -> None:
            x, y = float(position[0]), float(position[1])
            self.update(time_s, next((name for name, each in polygons.items() if contains(each, x, y)), None))

        return look

    def begin(self, rooms: Mapping[str, Sequence[Point]] | Sequence[str]) -> None:
        """Sets the rooms that have to be visited; without any, the requirement cannot be judged."""
        self._rooms = tuple(rooms)
        if not self._rooms:
            self.fail("ignore leaves no room")

    def update(self, time_s: float, room: str | None) -> None:
        """Records a visit to the room that the body is in; `None`: it is in no room. Visits after `by_s` do not count.

        The requirement cannot be judged if the robot starts in the only room.
        """
        self._began_s = time_s if self._began_s is None else self._began_s
        if not self.is_reached and self.asked.by_s is not None and time_s > self.asked.by_s + ROUNDING_S:
            self.violate(self.asked.by_s)
            return  # what comes too late does not count
        if room in self._rooms:
            self.visited_s.setdefault(room, time_s)
        if not self.is_reached and len(self.visited_s) == len(self._rooms):
            self.is_reached = True
            if time_s == self._began_s:
                self.fail("the robot starts in the only room that counts, so it could not be missed")

    @property
    def planned_s(self) -> float:
        """Simulated time in seconds by which all rooms have to be visited."""
        return self.asked.by_s or 0.0

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds the number of visited rooms, and their share of the required ones, to the run's metrics."""
        if self._rooms:
            metrics["visited_rooms_share"] = round(len(self.visited_s) / len(self._rooms), 6)

    def _numbers(self) -> Numbers:
        return Numbers(float(len(self.visited_s)), float(len(self._rooms)), "rooms", at_least=True)

    def _detail(self) -> str:
        by = "" if self.asked.by_s is None else f", {self.asked.by_s:g} s asked for"
        missing = [name for name in self._rooms if name not in self.visited_s]
        if not missing:
            return f"all {counted(len(self._rooms), 'room')} visited at {max(self.visited_s.values()):.2f} s{by}"
        more = f" and {len(missing) - _MOST_NAMED} more" if len(missing) > _MOST_NAMED else ""
        named = ", ".join(missing[:_MOST_NAMED])
        return f"{len(self.visited_s)} of {counted(len(self._rooms), 'room')} visited{by}; not {named}{more}"
