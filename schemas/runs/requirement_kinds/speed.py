"""Requirement that the robot does not exceed a speed, anywhere or in a room."""

import math
from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from ...wire.base import optional
from ...worlds.world import Point, contains
from .kind import Look, MetresPerSecond, Numbers, RobotRequirement, RoomName, Rule, Scene, Seconds


class SpeedRequirement(RobotRequirement):
    """Pass criterion: the robot does not exceed a speed."""

    violated_when = "its body moves faster than `max_mps`, on average from one check to the next"
    more_members = "`room`: only checks in this room count"

    kind: Literal["speed"] = Field(description="`speed`.")
    max_mps: MetresPerSecond = Field(description="Highest speed, in metres per second.")
    room: RoomName | None = optional("Room of the world in which the limit holds; absent: everywhere.")
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")

    @property
    def asked_room(self) -> str | None:
        """Name of the room in which the limit applies; `None`: everywhere."""
        return self.room


class SpeedRule(Rule[SpeedRequirement]):
    """Records the highest mean speed between two checks, and judges the speed requirement."""

    fastest_mps: float | None = None
    """Highest counted speed so far, in m/s; None: there was none."""
    _last: tuple[float, tuple[float, ...]] | None = None

    def bind(self, scene: Scene) -> Look:
        """Connects the rule to a simulation; returns the check that measures the distance since the last look."""
        position = scene.position(self)
        polygon = None if self.asked.room is None else self.polygon(self.asked.room, scene)

        def look(time_s: float) -> None:
            self.update(time_s, tuple(map(float, position)), counts=_is_in(polygon, position))

        return look

    def update(self, time_s: float, here: tuple[float, ...], *, counts: bool = True) -> None:
        """Judges the mean speed since the last position.

        Args:
            time_s: Simulated time.
            here: Position x, y, z in metres.
            counts: Whether the limit applies there.
        """
        if math.isnan(here[0]) or (self._last is not None and time_s <= self._last[0]):
            return
        if self._last is not None and counts:
            speed_mps = math.dist(here, self._last[1]) / (time_s - self._last[0])
            self.fastest_mps = max(self.fastest_mps or 0.0, speed_mps)
            if speed_mps > self.asked.max_mps:
                self.violate(time_s)
        self._last = (time_s, here)

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds the highest speed in m/s to the run's metrics, if one was measured."""
        if self.fastest_mps is not None:
            metrics["max_speed_mps"] = max(metrics.get("max_speed_mps", 0.0), round(self.fastest_mps, 6))

    def _unjudgeable(self) -> str | None:
        if self.fastest_mps is not None:
            return None
        if self.asked.room is not None:
            return f"the robot was not seen in {self.asked.room}, so there was no speed to judge"
        return "the run ended before a second look at the robot's position"

    def _numbers(self) -> Numbers:
        return Numbers(self.fastest_mps, self.asked.max_mps, "m/s")

    def _detail(self) -> str:
        where = "" if self.asked.room is None else f" in {self.asked.room}"
        reached = f"reached {self.fastest_mps or 0:.2f} m/s{where}"
        return f"{reached}; at most {self.asked.max_mps:g} m/s is allowed{self._until()}"


def _is_in(polygon: Sequence[Point] | None, position: Sequence[float]) -> bool:
    return polygon is None or contains(polygon, float(position[0]), float(position[1]))
