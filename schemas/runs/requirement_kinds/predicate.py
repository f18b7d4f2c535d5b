"""Requirement that a function of the application returns true."""

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from pydantic import Field

from .kind import DottedName, Look, Numbers, RequirementKind, Rule, Scene, Seconds


class PredicateRequirement(RequirementKind):
    """Pass criterion: a function of the application returns true whenever it is called."""

    violated_when = "a function of the application, `attribute`, says no"
    margins_compare = False  # it says yes or no

    kind: Literal["predicate"] = Field(description="`predicate`.")
    attribute: DottedName = Field(
        description="Dotted path of the function in the simulation or robot application, `my_nav.rules.keeps_left`: "
        "`(environment, time_s)` gives a bool, or a bool and a reason."
    )
    period_s: Seconds = Field(default=0.5, description="Simulated seconds from one check to the next.")

    @classmethod
    def packages(cls, requirement: Mapping[str, Any]) -> Iterator[str]:
        """Returns the Python package of the predicate function."""
        yield str(requirement.get("attribute", "")).partition(".")[0]


class PredicateRule(Rule[PredicateRequirement]):
    """Calls an application's predicate function, and judges its requirement."""

    def __init__(self, asked: PredicateRequirement) -> None:
        super().__init__(asked)
        self._reason = ""
        self._violations = self._checks = 0

    def bind(self, scene: Scene) -> Look:
        """Connects the rule to a function of the simulation; returns the check that calls it.

        After an error of the function, or a wrong result, the requirement cannot be judged.
        """
        attribute, environment = self.asked.attribute, scene.environment
        function = scene.function(self, attribute)

        def look(time_s: float) -> None:
            try:
                answer = function(environment, time_s)
            except (Exception, SystemExit) as error:
                self.fail(f"{attribute} raised {type(error).__name__}: {error}")
                return
            is_pair = issubclass(type(answer), tuple) and len(answer) == 2
            holds, reason = answer if is_pair else (answer, "")
            if getattr(holds, "shape", None) == ():
                holds = holds.item()  # a bool of NumPy
            if isinstance(holds, bool) and isinstance(reason, str):
                self.update(time_s, holds, reason)
            else:
                self.fail(f"{attribute} returned {str(answer)[:80]}; a bool, or a bool and a text, would be right")

        return look

    def update(self, time_s: float, holds: bool, reason: str = "") -> None:
        """Records one answer of the function; a false one is a violation, of which the first keeps its reason."""
        self._checks += 1
        if not holds:
            self._violations += 1
            if self.violate(time_s):
                self._reason = reason[:300]

    def _unjudgeable(self) -> str | None:
        return None if self._checks else f"{self.asked.attribute} was never asked"

    def _numbers(self) -> Numbers:
        return Numbers(float(self._violations), 0.0, "violations")

    def _detail(self) -> str:
        if self.violated_s is None:
            return f"{self.asked.attribute} held in all {self._checks} checks"
        reason = f": {self._reason}" if self._reason else ""
        return f"{self.asked.attribute} did not hold at {self.violated_s:.2f} s{reason}"
