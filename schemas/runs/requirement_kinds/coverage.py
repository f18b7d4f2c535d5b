"""Requirement that the robot passes over a share of the floor."""

import math
from collections.abc import Set
from typing import Annotated, Literal

from pydantic import Field

from ...wire.base import ShapeName, optional
from ...worlds.world import Point
from .kind import ROUNDING_S, STOP_OR_REACHED, Look, Numbers, RobotRequirement, RoomName, Rule, Scene, Seconds, Share

DiscRadius = Annotated[float, ShapeName("DiscRadius"), Field(gt=0, le=10, allow_inf_nan=False)]


class CoverageRequirement(RobotRequirement):
    """Pass criterion: the robot passes over a share of the floor of a room, or of the whole world."""

    violated_when = "a disc of `radius_m` around its body passes over less than `min_share` of the free floor"
    more_members = "`room`: absent, all rooms; `by_s`"
    needs_world = True

    kind: Literal["coverage"] = Field(description="`coverage`.")
    min_share: Share = Field(description="Least share of the free floor, 0 to 1.")
    radius_m: DiscRadius = Field(
        description="Radius in metres of the disc around the robot's body that covers. Free floor is where such a "
        "disc can pass on the world's map."
    )
    room: RoomName | None = optional("Room of the world whose floor is meant; absent: that of all rooms.")
    by_s: Seconds | None = optional("Simulated time at which the share has to be covered at the latest.")
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")
    stop: bool = Field(default=False, description=STOP_OR_REACHED)

    @property
    def asked_room(self) -> str | None:
        """Name of the room whose floor counts; `None` for the whole world."""
        return self.room


class CoverageRule(Rule[CoverageRequirement]):
    """Records the passed share of the free floor, and judges the coverage requirement."""

    is_reached = False

    def __init__(self, asked: CoverageRequirement) -> None:
        super().__init__(asked)
        self.covered: set[int] = set()
        """Numbers of the free cells that the robot has passed over."""
        self._cells = 0
        self._area_m2 = 0.0
        self._reached_s: float | None = None
        self._last: Point | None = None

    def bind(self, scene: Scene) -> Look:
        """Finds the free floor, and returns the check that adds the cells that the robot passes over.

        Raises RequirementError if there is no world; with no free cells the requirement cannot be judged.
        """
        asked, position, floor = self.asked, scene.position(self), scene.floor(self)
        if floor is None:
            raise self.cannot("it asks for the floor of a world, but there is no world")
        polygon = None if asked.room is None else self.polygon(asked.room, scene)
        cells = floor.cells(polygon, asked.radius_m)
        self._cells, self._area_m2 = len(cells), len(cells) * floor.cell_m2
        if not cells:
            where = "the world" if asked.room is None else asked.room
            self.fail(f"the map of {where} has no floor that a disc of {asked.radius_m:g} m can pass over")

        def look(time_s: float) -> None:
            here = (float(position[0]), float(position[1]))
            if math.isnan(here[0]):
                return
            self.update(time_s, cells & floor.passed(self._last or here, here, asked.radius_m))
            self._last = here

        return look

    def update(self, time_s: float, passed: Set[int]) -> None:
        """Adds cells of the free floor, by number, that the body has passed over; those after `by_s` do not count.

        The requirement cannot be judged if the first cells are already enough.
        """
        if not self.is_reached and self.asked.by_s is not None and time_s > self.asked.by_s + ROUNDING_S:
            self.violate(self.asked.by_s)
            return  # what comes too late does not count
        is_first = self._last is None
        self.covered |= passed
        if not self.is_reached and self._cells and self.share >= self.asked.min_share:
            self.is_reached, self._reached_s = True, time_s
            if is_first:
                self.fail("the robot covers so much where it starts, so it could not be missed")

    @property
    def share(self) -> float:
        """Share of the free floor that was passed over, 0 to 1."""
        return len(self.covered) / self._cells if self._cells else 0.0

    @property
    def planned_s(self) -> float:
        """Simulated time in seconds by which the floor has to be covered."""
        return self.asked.by_s or 0.0

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds the covered share to the run's metrics; of several requirements the smallest."""
        if self.error is None:
            metrics["floor_coverage"] = min(metrics.get("floor_coverage", 1.0), round(self.share, 6))

    def _numbers(self) -> Numbers:
        return Numbers(self.share, self.asked.min_share, None, at_least=True)

    def _detail(self) -> str:
        asked, where = (
            self.asked,
            "the free floor" if self.asked.room is None else f"the free floor of {self.asked.room}",
        )
        by = "" if asked.by_s is None else f" by {asked.by_s:g} s"
        reached = "" if self._reached_s is None else f", reached at {self._reached_s:.2f} s"
        share = f"{100 * self.share:.1f} % of {self._area_m2:.1f} m2 of {where}"
        return f"{share}, {100 * asked.min_share:g} % asked for{by}{reached}"
