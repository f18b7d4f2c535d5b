"""Parts of a kind of axis: a shape, which requests have, and how one of its values is applied to a simulation.

Nothing here knows of MuJoCo: an axis changes numbers of a `Rig`.
"""

import re
from abc import abstractmethod
from collections.abc import Callable, Sequence
from math import isfinite
from statistics import NormalDist
from typing import Annotated, Any, ClassVar, Protocol, Self, get_args

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from ...wire.base import Shape, ShapeName, optional
from ...wire.common import raise_all
from ...wire.errors import LaunchError

Value = str | float
"""Value of an axis: text for an environment variable, a number for all others."""

MAX_VALUES = 1000
"""Largest number of values that an axis may list."""
BINS = 5
"""Number of equally likely parts of a range that a report shows: fifths, as quintiles of a sample."""
_LEAST_SHARE = 1e-12
"""Shares nearer to 0 or 1 than this are taken for it: a normal distribution has no value for them."""


_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
"""Numbers as JSON and YAML write them; Python itself would take `1_0` for ten."""


class AxisError(LaunchError):
    """Raised when an axis cannot be applied to a job's environment or robot; the request is blamed."""


_REFUSED = re.compile(r"trials\.axes\.\w+: \w+ cannot be applied: (.+)")


def refusal(name: str, kind: str, why: object) -> str:
    """Says that an axis cannot be applied.

    Args:
        name: The axis.
        kind: Its kind.
        why: The reason.
    """
    return f"trials.axes.{name}: {kind} cannot be applied: {why}"


def why_not_applicable(reason: str) -> str:
    """Returns why an axis cannot be applied, if that is why a job failed; empty: it failed for another reason.

    Args:
        reason: The job's reason, in words.
    """
    found = _REFUSED.search(reason)
    return found[1] if found else ""


class LidarErrors(Protocol):
    """Interface to the errors of an environment's lidar, which its next episode begins with."""

    noise_std_m: float
    bias_m: float
    dropout: float
    latency_s: float


class CommandDelay(Protocol):
    """Interface to the delay of an environment's motor commands, which its next episode begins with."""

    delay_s: float


class CommandGains(Protocol):
    """Interface to the factors on an environment's motor commands, which its next episode begins with."""

    whole: float
    turn: float | None
    """Factor on turning rates besides; None: commands have none."""


class WheelSlip(Protocol):
    """Interface to the slip of an environment's wheels, which its next episode begins with."""

    slip: float


class OdometryErrors(Protocol):
    """Interface to the errors of the pose that an environment tells, which its next episode begins with."""

    drift_std_m: float


class Rig(Protocol):
    """Interface to a simulated robot with its sensors and its floor, as axes change them.

    Bodies, geoms and motors are given as masks or numbers of the compiled model.
    """

    @property
    def robot_bodies(self) -> Any:
        """Mask of the robot's bodies, shape (nbody,)."""
        ...

    @property
    def touching_geoms(self) -> Any:
        """Mask of the robot's geoms and the floor's, shape (ngeom,), where they can touch and rub."""
        ...

    @property
    def touching_pairs(self) -> Any:
        """Mask of the model's explicit contact pairs of a robot's geom, shape (npair,)."""
        ...

    @property
    def motors(self) -> Any:
        """Numbers of the actuators that move the robot, all of which have forces that can be scaled."""
        ...

    @property
    def motor_joints(self) -> Any:
        """Numbers of the joints that these move and whose forces are limited."""
        ...

    @property
    def lidar(self) -> LidarErrors:
        """Errors of the robot's lidar."""
        ...

    @property
    def first_motor(self) -> Any:
        """Number of the first one of `motors`, as a list, and of the joint of `motor_joints` that it moves, if any."""
        ...

    @property
    def commands(self) -> CommandDelay:
        """Delay of the robot's commands."""
        ...

    @property
    def command_gains(self) -> CommandGains:
        """Factors on the robot's commands."""
        ...

    @property
    def wheels(self) -> WheelSlip:
        """Slip of the robot's wheels."""
        ...

    @property
    def odometry(self) -> OdometryErrors:
        """Errors of the pose that the robot is told."""
        ...

    def scale(self, field: str, where: Any, factor: float | None) -> None:
        """Writes a factor times the numbers that a field of the model was built with.

        Args:
            field: The field's name, `body_mass`.
            where: Which of its rows.
            factor: The factor; None: as it was built.
        """
        ...

    def derive_constants(self) -> None:
        """Computes the model's constants that depend on masses."""
        ...


Setter = Callable[[float | None], None]
"""Applies a value of an axis; None: everything is as it was built."""


def _as_text(value: Any) -> Any:
    """Numbers as text, which SDKs give them as."""
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def differ(values: list[str]) -> list[str]:
    """Refuses a list that has a value twice.

    Raises:
        ValueError: It has.
    """
    if twice := sorted({value for value in values if values.count(value) > 1}):
        raise ValueError(f"values have to differ; {', '.join(map(repr, twice))} appears more than once")
    return values


AxisValue = Annotated[str, BeforeValidator(_as_text, json_schema_input_type=str | float), ShapeName("AxisValue")]
"""A value in a request: text, or a number, which becomes its text."""
AxisText = Annotated[str, ShapeName("AxisValue")]
"""A value in a request that has to be text."""
AxisValues = Annotated[
    list[AxisValue], ShapeName("AxisValues"), Field(min_length=1, max_length=MAX_VALUES), AfterValidator(differ)
]
AxisTexts = Annotated[
    list[AxisText], ShapeName("AxisValues"), Field(min_length=1, max_length=MAX_VALUES), AfterValidator(differ)
]
AxisBound = Annotated[float, ShapeName("AxisBound"), Field(allow_inf_nan=False)]
AxisRange = Annotated[list[AxisBound], ShapeName("AxisRange"), Field(min_length=2, max_length=2)]
AxisSpread = Annotated[float, ShapeName("AxisSpread"), Field(gt=0, le=10_000, allow_inf_nan=False)]


class NormalDistribution(Shape):
    """A normal distribution, of which only what lies between two bounds is taken."""

    mean: AxisBound = Field(description="Its mean, in the unit of the axis.")
    std: AxisSpread = Field(description="Its standard deviation, in the unit of the axis.")
    low: AxisBound | None = optional("Least value; absent: the least that is possible for the kind of axis.")
    high: AxisBound | None = optional("Largest value; absent: the largest that is possible for the kind of axis.")


class Axis(Shape):
    """Base class of kinds of axes."""

    kind: Any = Field(description="Name of its kind.")

    varies: ClassVar[str]
    """Words for the table of kinds in `docs/trials.md`."""
    applies_to: ClassVar[str]
    """Words for the same table: the environments and robots that have it."""
    is_number: ClassVar[bool] = True

    @staticmethod
    def names(kind: "type[Axis]") -> tuple[str, ...]:
        """Returns the name of the kind in requests; empty for a base class."""
        return get_args(kind.model_fields["kind"].annotation)

    @property
    @abstractmethod
    def listed(self) -> Sequence[Value] | None:
        """Its values, if it lists them; None: it has a range or a distribution."""

    @abstractmethod
    def parse(self, text: str) -> Value:
        """Returns the value that a text means.

        Raises:
            ValueError: It is no possible value.
        """

    @abstractmethod
    def at(self, share: float) -> Value:
        """Returns the value below which a share, 0 to 1, of its values lies."""


class NumberAxis(Axis):
    """Base class of kinds of axes whose values are numbers."""

    unit: ClassVar[str]
    """Unit of its values, as messages show it; `factor` and `share` are of none."""
    least: ClassVar[float]
    """Least possible value."""
    most: ClassVar[float]
    """Largest possible value."""
    neutral: ClassVar[str]
    """The value that changes nothing, in words."""
    subject: ClassVar[str] = ""
    """Words for what it changes, if other kinds change the same, so that a job has one of them; empty: none does."""

    values: AxisValues | None = optional("Its values, numbers in the unit of the kind; all or some of them are taken.")
    range: AxisRange | None = optional("Least and largest value; all between are equally likely.")
    normal: NormalDistribution | None = optional("Normal distribution of its values.")

    @classmethod
    @abstractmethod
    def bind(cls, rig: Rig) -> Setter:
        """Finds what the axis changes, and returns a function that applies a value.

        Raises:
            AxisError: The robot or its environment has nothing that it could change.
        """

    @classmethod
    def possible(cls) -> str:
        """Says in words which values are possible: `a factor from 0.1 to 10`."""
        bounds = f"from {cls.least:g} to {cls.most:g}"
        return f"a {cls.unit} {bounds}" if cls.unit in ("factor", "share") else f"{bounds} {cls.unit}"

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        given = [name for name in ("values", "range", "normal") if getattr(self, name) is not None]
        if len(given) != 1:
            has = f"{' and '.join(given)} are given" if given else "it has no values"
            raise ValueError(f"{has}; give one of values, range ([least, largest]) and normal (mean and std)")
        if self.values is not None:
            differ([f"{number!r}" for number in self._numbers(self.values)])
        elif self.range is not None:
            self._check_bounds("range", *self.range)
        else:
            assert self.normal is not None
            low, high = self._bounds
            self._check_bounds("normal", low, high)
            if not low <= self.normal.mean <= high:
                raise ValueError(f"normal.mean: {self.normal.mean:g} is not between the bounds {low:g} and {high:g}")
        return self

    def _numbers(self, values: Sequence[str]) -> list[float]:
        """The numbers that values mean; an error tells all that mean none."""
        numbers: list[float] = []
        wrong: list[str] = []
        for place, text in enumerate(values):
            try:
                numbers.append(self.parse(text))
            except ValueError as error:
                wrong.append(f"values[{place}]: {error}")
        raise_all(wrong)
        return numbers

    def _check_bounds(self, member: str, low: float, high: float) -> None:
        if low >= high:
            raise ValueError(f"{member}: {low:g} is not below {high:g}; the least value comes first")
        for bound in (low, high):
            self._check(bound, f"{member}: ")

    def _check(self, number: float, where: str = "") -> float:
        if not (isfinite(number) and self.least <= number <= self.most):
            raise ValueError(f"{where}{number:g} is not possible; {self.kind} is {self.possible()}")
        return number

    @property
    def listed(self) -> Sequence[float] | None:
        """Its values as numbers, if it lists them."""
        return None if self.values is None else [float(text) for text in self.values]

    def parse(self, text: str) -> float:
        """Returns the number that a text means.

        Raises:
            ValueError: It is no number, or none that is possible.
        """
        if not _NUMBER.fullmatch(text):
            raise ValueError(f"{text!r} is no number; {self.kind} is {self.possible()}")
        return self._check(float(text))

    def at(self, share: float) -> float:
        """Returns the value below which a share, 0 to 1, of its values lies."""
        if (listed := self.listed) is not None:
            return listed[min(int(share * len(listed)), len(listed) - 1)]
        low, high = self._bounds
        if self.normal is None:
            return low + share * (high - low)
        normal = NormalDist(self.normal.mean, self.normal.std)
        below, above = normal.cdf(low), normal.cdf(high)
        inside = min(max(below + share * (above - below), _LEAST_SHARE), 1 - _LEAST_SHARE)
        return min(max(normal.inv_cdf(inside), low), high)

    def edges(self) -> list[float]:
        """Returns the bounds of `BINS` equally likely parts of a range or a distribution, least first."""
        return [self.at(number / BINS) for number in range(BINS + 1)]

    @property
    def _bounds(self) -> tuple[float, float]:
        """Least and largest value of a range or a distribution."""
        if self.range is not None:
            return self.range[0], self.range[1]
        assert self.normal is not None
        low, high = self.normal.low, self.normal.high
        return self.least if low is None else low, self.most if high is None else high


class LidarAxis(NumberAxis):
    """Base class of kinds of axes that change one of the errors of the robot's lidar."""

    applies_to = "`indoor-navigation` with a robot that has a lidar, and environments that have `lidar_errors`"
    error: ClassVar[str]
    """Name of the error, an attribute of `LidarErrors`."""

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Finds the errors of the robot's lidar."""
        lidar = rig.lidar
        built = getattr(lidar, cls.error)

        def set_error(value: float | None) -> None:
            setattr(lidar, cls.error, built if value is None else value)

        return set_error
