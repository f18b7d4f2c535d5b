"""Requirement that a signal temporal logic formula holds for the run."""

import importlib.util
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from ...extras import how_to_install
from ...wire.base import ShapeName, optional
from ...wire.common import text
from ...wire.json_values import is_mapping
from ..formulas import FormulaError, bounds_of, in_words, off_grid, read_formula, signals_of
from ..robustness import Robustness, differs_below, robustness
from .kind import DottedName, Look, Numbers, Rule, Scene, Seconds, ThingsRequirement, yaw_rad
from .upright import tilt_deg

SIGNALS: Mapping[str, str] = {
    "speed": "m/s, mean since the last check",
    "turn_rate": "deg/s, likewise; around the vertical, positive or negative",
    "clearance": "m, from the robot's surface to the nearest thing",
    "tilt": "deg, of its body's z axis off the vertical",
    "x": "m", "y": "m", "z": "m, of its body",
    "yaw": "deg, -180 to 180",
    "time": "s",
}  # fmt: skip
"""Signals that every run has, with their units."""

_RATES = ("speed", "turn_rate")
"""Signals that are rates over the time since the last sample."""
_MAX_SAMPLES = 100_000
"""Maximum number of samples of a run: almost three hours at 0.1 s. Judging them takes some seconds per operator."""
_MAX_BOUND = 3000
"""Maximum number of samples that time bounds may span: five minutes at 0.1 s; judging time grows with it."""
_FAR_M = 1e6
"""Clearance in metres if nothing is near."""

Text = Annotated[str, ShapeName("FormulaText"), text(1, 500)]
SignalName = Annotated[str, ShapeName("SignalName"), text(1, 64, r"[a-zA-Z_][a-zA-Z0-9_]*")]
SignalFunctions = Annotated[dict[SignalName, DottedName], ShapeName("SignalFunctions"), Field(max_length=20)]


class ExpressionRequirement(ThingsRequirement):
    """Pass criterion: a signal temporal logic formula holds for the run."""

    violated_when = "`formula`, of signal temporal logic, does not hold"
    more_members = "`signals`: functions of the application by name; `others`, `ignore`: as for `clearance`"
    margins_compare = False  # the unit is that of the comparison that decides

    kind: Literal["expression"] = Field(description="`expression`.")
    formula: Text = Field(
        description="The formula, `always (clearance < 0.5 -> speed < 0.3)`: comparisons of signals and numbers, "
        "`not`, `and`, `or`, `->`, and `always`, `eventually`, `until`, which may have bounds in seconds from now, "
        "`eventually[0, 3]`. Signals: " + ", ".join(SIGNALS) + ", and those of `signals`."
    )
    signals: SignalFunctions | None = optional(
        "Further signals by name: dotted paths of functions in the simulation or robot application, "
        "`(environment, time_s)` gives a number."
    )
    period_s: Seconds = Field(
        default=0.1, description="Simulated seconds from one sample to the next; bounds are multiples of it."
    )

    @model_validator(mode="after")
    def _readable(self) -> Self:
        own = self.signals or {}
        if taken := sorted(own.keys() & SIGNALS.keys()):
            raise ValueError(f"signals: {taken[0]} is a signal of every run; call it otherwise")
        try:
            formula = read_formula(self.formula, [*SIGNALS, *own])
        except FormulaError as error:
            raise ValueError(f"formula: {error}") from None
        if unused := sorted(own.keys() - set(signals_of(formula))):
            raise ValueError(f"signals: {unused[0]} is not in the formula; use it there, or leave it out")
        if odd := off_grid(formula, self.period_s):
            raise ValueError(
                f"formula: the bound {odd[0]:g} is no multiple of period_s, {self.period_s:g}; "
                f"write {round(odd[0] / self.period_s) * self.period_s:g}, or give a period_s that divides it"
            )
        for _, last in bounds_of(formula):
            if last > _MAX_BOUND * self.period_s:
                raise ValueError(
                    f"formula: the bound {last:g} is more than {_MAX_BOUND} times period_s, {self.period_s:g}; "
                    f"give a period_s of {last / _MAX_BOUND:g} or more"
                )
        if self.stop:
            raise ValueError("stop: an expression is judged when the run is over; leave out stop")
        return self

    @classmethod
    def packages(cls, requirement: Mapping[str, Any]) -> Iterator[str]:
        """Returns the Python packages of the formula's functions."""
        signals = requirement.get("signals")
        for attribute in signals.values() if is_mapping(signals) else ():
            yield str(attribute).partition(".")[0]


class ExpressionRule(Rule[ExpressionRequirement]):
    """Samples the signals of a formula, and judges its requirement."""

    def __init__(self, asked: ExpressionRequirement) -> None:
        super().__init__(asked)
        self._formula = read_formula(asked.formula, [*SIGNALS, *(asked.signals or {})])
        self.samples: dict[str, list[float]] = {name: [] for name in dict.fromkeys(signals_of(self._formula))}
        """Values of the signals, one in each period; a period without a check repeats the last value."""
        self._last: tuple[float, tuple[float, ...], float] | None = None
        self._found: Robustness | None = None

    def bind(self, scene: Scene) -> Look:
        """Connects the rule to the signals that the formula uses.

        Raises:
            RequirementError: A function or body that the formula names does not exist, or rtamt is not installed.
        """
        if importlib.util.find_spec("rtamt") is None:
            raise self.cannot(f"rtamt, which judges formulas, is not installed: {how_to_install('stl')}")
        environment, names = scene.environment, self.samples.keys()
        functions = {name: scene.function(self, at) for name, at in (self.asked.signals or {}).items()}
        position, orientation = scene.position(self), scene.orientation(self)
        clearance = scene.clearance(self) if "clearance" in names else None
        if "tilt" in names and not scene.can_tilt(self):
            self.fail("no joint lets the robot's body tilt, so its tilt could not be missed")
        if "z" in names and not scene.can_rise(self):
            self.fail("no joint lets the robot's body rise or sink, so its z could not be missed")

        def look(time_s: float) -> None:
            if math.isnan(position[0]):  # a recording has no pose yet
                return
            here, yaw = tuple(map(float, position)), math.degrees(yaw_rad(orientation))
            speed, turn_rate = self._rates(time_s, here, yaw)
            values = dict(zip(("x", "y", "z"), here, strict=True)) | {
                "time": time_s, "yaw": yaw, "tilt": tilt_deg(orientation), "speed": speed, "turn_rate": turn_rate,
            }  # fmt: skip
            if clearance is not None:
                found = clearance(_FAR_M)
                values["clearance"] = _FAR_M if found is None else found[0]
            for name, function in functions.items():
                number = self._asked(name, function, environment, time_s)
                if number is None:
                    return
                values[name] = number
            self.update(time_s, {name: values[name] for name in names})

        return look

    def _asked(self, name: str, function: Any, environment: Any, time_s: float) -> float | None:
        attribute = (self.asked.signals or {})[name]
        try:
            number = function(environment, time_s)
            if getattr(number, "shape", None) == ():
                number = number.item()  # a number of NumPy
        except (Exception, SystemExit) as error:
            self.fail(f"{attribute} raised {type(error).__name__}: {error}")
            return None
        if isinstance(number, int | float) and math.isfinite(number):
            return float(number)
        self.fail(f"{attribute} returned {str(number)[:80]} at {time_s:.2f} s; a number would be right")
        return None

    def _rates(self, time_s: float, here: tuple[float, ...], yaw: float) -> tuple[float, float]:
        """Returns speed in m/s and turn rate in deg/s since the last sample; 0 and 0 for the first one."""
        last, self._last = self._last, (time_s, here, yaw)
        if last is None or time_s <= last[0]:
            return 0.0, 0.0
        passed_s = time_s - last[0]
        return math.dist(here, last[1]) / passed_s, math.remainder(yaw - last[2], 360.0) / passed_s

    def update(self, time_s: float, values: Mapping[str, float]) -> None:
        """Records a sample of all signals of the formula at a simulated time in seconds; fills periods without a look.

        With too many periods the requirement cannot be judged, which is recorded.
        """
        count = len(next(iter(self.samples.values())))
        # A look that came late is the sample of the next period; the last of a run may come before its time.
        number = max(count, math.ceil(time_s / self.asked.period_s - 1e-6))
        if number >= _MAX_SAMPLES:
            seconds = f"{_MAX_SAMPLES * self.asked.period_s:g} s"
            self.fail(f"the run takes more than {_MAX_SAMPLES} periods, {seconds}; give a larger period_s")
            return
        for name, samples in self.samples.items():
            value, is_rate = values[name], name in _RATES
            if is_rate and count == 1:
                samples[0] = value  # there is none before the second look
            samples.extend([value if is_rate or not samples else samples[-1]] * (number - count))
            samples.append(value)

    def _unjudgeable(self) -> str | None:
        if self.error is not None:
            return None
        count = len(next(iter(self.samples.values())))
        if count < 2:
            return "the run ended before a second look at its signals"
        try:
            if (
                self.blind is not None
                and (unseen := differs_below(self._formula, self.samples, "clearance", self.blind.below_m)) is not None
            ):
                return f"{self.blind.why}, so {in_words(unseen)} could not be told"
            self._found = found = robustness(self._formula, self.samples, self.asked.period_s)
        except OverflowError as error:
            return str(error)
        if found.most < 0:
            violated_at = (count - 1) if found.violated_at is None else found.violated_at
            self.violate(min(self._end_s, violated_at * self.asked.period_s))
            return None
        if found.least <= 0:
            return (
                f"the run ended at {self._end_s:.2f} s, before it was decided: the formula looks further ahead; let "
                "the run take longer, or give its outermost operator bounds that end earlier"
            )
        return None

    def remark(self) -> str | None:
        """Returns a note about conditions that were never true, so that nothing was tested; else `None`."""
        if self.error is not None or self._found is None or not self._found.idle:
            return None
        never = ", ".join(in_words(each) for each in self._found.idle)
        return f"{self.asked.name}: {never} never held, so what was to follow was not put to the test"

    def _numbers(self) -> Numbers:
        if self._found is None:
            return Numbers()
        return Numbers(self._found.least if self._found.least > 0 else self._found.most, 0.0, None, at_least=True)

    def _detail(self) -> str:
        said = "holds" if self.violated_s is None else "does not hold"
        return f"{self.asked.formula} {said}, robustness {self._numbers().value or 0:.3g}{self._until()}"
