"""Requirement that the robot does not hit objects harder than a limit."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from .kind import ROUNDING_S, Count, Look, Newtons, Numbers, Rule, Scene, Seconds, ThingsRequirement, is_meant

SEPARATION_S = 0.1
"""Seconds without contact after which a collision is over; shorter gaps are bouncing."""


class CollisionRequirement(ThingsRequirement):
    """Pass criterion: the robot does not hit anything but the floor harder than a limit."""

    violated_when = "it touches something harder than `max_force_N`, more than `max_count` (0) times"
    more_members = "`others`, `ignore`: what counts, by name, `*` for any text"

    kind: Literal["no_collision"] = Field(description="`no_collision`.")
    max_force_N: Newtons = Field(description="Largest normal force that is no collision yet, in newtons.")
    max_count: Count = Field(default=0, description="How many harder touches are allowed.")
    period_s: Seconds = Field(
        default=0.01, description="Simulated seconds from one check to the next, if the environment is asked so often."
    )


@dataclass
class _Touch:
    last_s: float
    is_hard: bool = False


class CollisionRule(Rule[CollisionRequirement]):
    """Records contact forces and collisions, and judges the collision requirement."""

    looks_within_steps = True  # touches are short

    def __init__(self, asked: CollisionRequirement) -> None:
        super().__init__(asked)
        self.max_force_N = 0.0
        self.hard: Counter[str] = Counter()
        """Number of contacts harder than the limit, by touched object."""
        self._hardest = ""
        self._touches: dict[str, _Touch] = {}
        self._counts: dict[str, bool] = {}

    def bind(self, scene: Scene) -> Look:
        """Connects the rule to a simulation's contact forces; returns the check that records them."""
        read = scene.contacts(self)
        return lambda time_s: self.update(time_s, read())

    def update(self, time_s: float, forces: Mapping[str, float]) -> None:
        """Records the normal force in newtons of each thing that touches the robot now, but not of those that may."""
        for other, force in forces.items():
            if self._matters(other):
                self._note(time_s, other, force)

    def _note(self, time_s: float, other: str, force: float) -> None:
        if force > self.max_force_N:
            self.max_force_N, self._hardest = force, other
        touch = self._touches.get(other)
        if touch is None or time_s - touch.last_s > SEPARATION_S + ROUNDING_S:
            touch = self._touches[other] = _Touch(time_s)
        touch.last_s = time_s
        if force > self.asked.max_force_N and not touch.is_hard:
            touch.is_hard = True
            self.hard[other] += 1
            if self.hard.total() > self.asked.max_count:
                self.violate(time_s, other)

    def _matters(self, other: str) -> bool:
        if other not in self._counts:
            self._counts[other] = is_meant(other, self.asked.others, self.asked.ignore)
        return self._counts[other]

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds the largest contact force to the run's metrics."""
        hardest = metrics.get("max_contact_force_N", 0.0)
        metrics["max_contact_force_N"] = max(hardest, round(self.max_force_N, 3))

    def _numbers(self) -> Numbers:
        if self.asked.max_count:
            return Numbers(float(self.hard.total()), float(self.asked.max_count), "collisions")
        return Numbers(self.max_force_N, self.asked.max_force_N, "N")

    def _detail(self) -> str:
        if not self._hardest:
            return "nothing was touched"
        text = f"hardest touch {self.max_force_N:.1f} N ({self._hardest}), {self.asked.max_force_N:g} N allowed"
        if self.hard:
            others = ", ".join(f"{name} {count}x" for name, count in self.hard.most_common(5))
            text += f"; {self.hard.total()} harder, {self.asked.max_count} allowed: {others}"
        return text
