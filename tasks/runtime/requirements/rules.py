"""Scores requirements: turns measurements into satisfied or missed requirements.

Nothing here knows of MuJoCo; times are simulated seconds.
"""

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase

from ....schemas.runs.plan import Requirement
from ....schemas.runs.programs import RunStop
from ....schemas.runs.requirements import (
    ClearanceRequirement,
    CollisionRequirement,
    GoalRequirement,
    JobRequirement,
    PredicateRequirement,
    TimeLimitRequirement,
)

SEPARATION_S = 0.1
"""A touch is over when nothing was felt for this long; shorter gaps are bouncing."""

_ROUNDING_S = 1e-6
_MAX_TEXT = 300


@dataclass(frozen=True)
class Numbers:
    """Measured value of a requirement and its limit."""

    value: float | None = None
    limit: float | None = None
    unit: str | None = None
    at_least: bool = False
    """Whether the limit is a lower one."""

    @property
    def margin(self) -> float | None:
        """Margin between value and limit, positive when satisfied."""
        if self.value is None or self.limit is None:
            return None
        return self.value - self.limit if self.at_least else self.limit - self.value


class Rule(ABC):
    """The score of one requirement."""

    def __init__(self, requirement: JobRequirement) -> None:
        self.requirement = requirement
        self.violated_s: float | None = None
        """When it was first found violated; None: never."""
        self.error: str | None = None
        """Why it cannot be judged; None: it can."""
        self._end_s = 0.0
        self._ended_by = ""

    @property
    def is_over(self) -> bool:
        """Whether the run has to end now, as far as this requirement alone can say."""
        return self.requirement.stop and (self.violated_s is not None or self.error is not None)

    def fail(self, error: str) -> None:
        """Notes that it cannot be judged; the first reason stays."""
        self.error = self.error or error[:_MAX_TEXT]

    def judged(self, end_s: float, ended_by: str) -> Requirement:
        """Judges the whole run.

        Args:
            end_s: Simulated time at its end.
            ended_by: What ended it.
        """
        self._end_s, self._ended_by = end_s, ended_by
        if (why := self._unjudgeable()) is not None:
            self.fail(why)
        name, kind = self.requirement.name, self.requirement.kind
        if self.error is not None:
            detail = f"could not be judged: {self.error}"
            return Requirement(name=name, kind=kind, satisfied=False, detail=detail, error=self.error)
        satisfied = self._is_satisfied()  # before anything else: it may find the last violation
        if not satisfied:
            self._violate(end_s)
        numbers = self._numbers()
        return Requirement(
            name=name,
            kind=kind,
            satisfied=satisfied,
            detail=self._detail(),
            value=_rounded(numbers.value),
            limit=numbers.limit,
            unit=numbers.unit,
            margin=_rounded(numbers.margin),
            first_violation_s=_rounded(self.violated_s),
        )

    def _violate(self, time_s: float) -> None:
        if self.violated_s is None:
            self.violated_s = time_s

    def _unjudgeable(self) -> str | None:
        """Returns why the requirement cannot be judged, now that the run has ended; None: it can."""
        return None

    def remark(self) -> str | None:
        """Returns a line beside the verdict, once it is judged; None: there is nothing to say."""
        return None

    def _is_satisfied(self) -> bool:
        return self.violated_s is None

    @abstractmethod
    def _numbers(self) -> Numbers: ...

    @abstractmethod
    def _detail(self) -> str: ...


class GoalRule(Rule):
    """Whether and when a goal was reached."""

    def __init__(self, requirement: GoalRequirement, before: "GoalRule | None" = None) -> None:
        """Starts with nothing reached.

        Args:
            requirement: The goal.
            before: The goal that has to be reached first.
        """
        super().__init__(requirement)
        self.goal = requirement
        self.reached_s: float | None = None
        """When it was reached, late or not; None: not yet."""
        self._before = before
        self._nearest_m: float | None = None
        """Smallest distance since it is its turn; None: it never was."""

    def update(self, time_s: float, distance_m: float) -> None:
        """Takes note of the distance to a goal; 0 inside a room, infinite outside of it."""
        goal = self.goal
        is_its_turn = self._before is None or self._before.reached_s is not None
        if is_its_turn and math.isfinite(distance_m):
            self._nearest_m = distance_m if self._nearest_m is None else min(self._nearest_m, distance_m)
        if self.reached_s is None and is_its_turn and distance_m <= (goal.within_m if goal.room is None else 0.0):
            self.reached_s = time_s
        latest_s = math.inf if goal.by_s is None else goal.by_s + _ROUNDING_S
        if time_s > latest_s and (self.reached_s is None or self.reached_s > latest_s):
            self._violate(latest_s - _ROUNDING_S)

    def remark(self) -> str | None:
        """Returns a line about a goal that was reached before the robot moved."""
        is_ordinary = self._before is None and self.goal.by_s is None
        if self.reached_s == 0.0 and is_ordinary and self._end_s:
            return f"{self.goal.name}: reached where the robot starts, before it moved"
        return None

    def _is_satisfied(self) -> bool:
        return self.reached_s is not None and self.violated_s is None

    def _numbers(self) -> Numbers:
        if self.reached_s is None and self.goal.room is None:
            return Numbers(self._nearest_m, self.goal.within_m, "m")
        return Numbers(self.reached_s, self.goal.by_s, "s")

    def _detail(self) -> str:
        goal = self.goal
        place = goal.room if goal.room is not None else f"({goal.x:g}, {goal.y:g})"
        asked = "" if goal.by_s is None else f", {goal.by_s:g} s asked for"
        if self.reached_s is not None:
            return f"{place} reached at {self.reached_s:.2f} s{asked}"
        first = self._before is not None and self._before.reached_s is None and goal.after
        why = f", {goal.after} comes first and was not reached either" if first else ""
        near = ""
        if goal.room is None and self._nearest_m is not None:
            since = f" after {goal.after}" if goal.after else ""
            near = f", nearest{since} {self._nearest_m:.2f} m, {goal.within_m:g} m asked for"
        return f"{place} not reached in {self._end_s:.2f} s{asked}{near}{why}; ended by {self._ended_by}"


@dataclass
class _Touch:
    last_s: float
    is_hard: bool = False


class CollisionRule(Rule):
    """Contact forces and number of touches."""

    def __init__(self, requirement: CollisionRequirement) -> None:
        super().__init__(requirement)
        self.asked = requirement
        self.max_force_N = 0.0
        self.hard: Counter[str] = Counter()
        """Touches harder than allowed, by what was touched."""
        self._hardest = ""
        self._touches: dict[str, _Touch] = {}
        self._counts: dict[str, bool] = {}

    def update(self, time_s: float, forces: Mapping[str, float]) -> None:
        """Takes note of the normal force in N of everything that touches the robot now, by name."""
        for other, force in forces.items():
            if self._matters(other):
                self._note(time_s, other, force)

    def _note(self, time_s: float, other: str, force: float) -> None:
        if force > self.max_force_N:
            self.max_force_N, self._hardest = force, other
        touch = self._touches.get(other)
        if touch is None or time_s - touch.last_s > SEPARATION_S + _ROUNDING_S:
            touch = self._touches[other] = _Touch(time_s)
        touch.last_s = time_s
        if force > self.asked.max_force_N and not touch.is_hard:
            touch.is_hard = True
            self.hard[other] += 1
            if self.hard.total() > self.asked.max_count:
                self._violate(time_s)

    def _matters(self, other: str) -> bool:
        if other not in self._counts:
            self._counts[other] = is_meant(other, self.asked.others, self.asked.ignore)
        return self._counts[other]

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


class TimeLimitRule(Rule):
    """Whether the run ended in time."""

    def __init__(self, requirement: TimeLimitRequirement) -> None:
        super().__init__(requirement)
        self.asked = requirement

    def update(self, time_s: float) -> None:
        """Takes note of the time."""
        if time_s > self.asked.limit_s + _ROUNDING_S:
            self._violate(time_s)

    def _unjudgeable(self) -> str | None:
        self.update(self._end_s)
        if self.violated_s is None and self._ended_by == RunStop.DURATION_LIMIT:
            limit_s = self.asked.limit_s
            return f"it was not over when the job's duration limit ended it, at {self._end_s:.2f} of {limit_s:g} s"
        return None

    def _numbers(self) -> Numbers:
        return Numbers(self._end_s, self.asked.limit_s, "s")

    def _detail(self) -> str:
        return f"ended at {self._end_s:.2f} s by {self._ended_by}, {self.asked.limit_s:g} s allowed"


class ClearanceRule(Rule):
    """Smallest clearance of the robot."""

    def __init__(self, requirement: ClearanceRequirement) -> None:
        super().__init__(requirement)
        self.asked = requirement
        self.nearest_m = math.inf
        """The smallest distance so far."""
        self._other = ""

    def update(self, time_s: float, distance_m: float, other: str) -> None:
        """Takes note of the smallest distance now, and of what is so near."""
        if distance_m < self.nearest_m:
            self.nearest_m, self._other = distance_m, other
        if distance_m < self.asked.min_m:
            self._violate(time_s)

    def _numbers(self) -> Numbers:
        value = self.nearest_m if math.isfinite(self.nearest_m) else None
        return Numbers(value, self.asked.min_m, "m", at_least=True)

    def _detail(self) -> str:
        if not self._other:
            return "there was nothing to come near to"
        when = "" if self.violated_s is None else f", first at {self.violated_s:.2f} s"
        return f"{self.nearest_m:.3f} m from {self._other} at least, {self.asked.min_m:g} m asked for{when}"


@dataclass
class _Answer:
    reason: str = ""
    count: int = 0


class PredicateRule(Rule):
    """Answers of an application's predicate function."""

    def __init__(self, requirement: PredicateRequirement) -> None:
        super().__init__(requirement)
        self.asked = requirement
        self._bad = _Answer()
        self._checks = 0

    def update(self, time_s: float, holds: bool, reason: str = "") -> None:
        """Takes note of one answer; the reason of the first no is kept."""
        self._checks += 1
        if not holds:
            self._bad.count += 1
            if self.violated_s is None:
                self._bad.reason = reason[:_MAX_TEXT]
            self._violate(time_s)

    def _unjudgeable(self) -> str | None:
        return None if self._checks else f"{self.asked.attribute} was never asked"

    def _numbers(self) -> Numbers:
        return Numbers(float(self._bad.count), 0.0, "violations")

    def _detail(self) -> str:
        if self.violated_s is None:
            return f"{self.asked.attribute} held in all {self._checks} checks"
        reason = f": {self._bad.reason}" if self._bad.reason else ""
        return f"{self.asked.attribute} did not hold at {self.violated_s:.2f} s{reason}"


def is_meant(name: str, others: list[str] | None, ignore: list[str] | None) -> bool:
    """Whether a thing counts: its name fits one of `others`, if there are any, and none of `ignore`."""
    wanted = others is None or any(fnmatchcase(name, pattern) for pattern in others)
    return wanted and not any(fnmatchcase(name, pattern) for pattern in ignore or ())


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 6)
