"""Base classes of kinds of axes: members in requests, and how a value is applied to a simulation.

This module does not use MuJoCo: an axis changes numbers through a `Rig`.
"""

import re
from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
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
"""Maximum number of values that an axis may list."""
BINS = 5
"""Number of equally likely parts of a range that a report shows: fifths (quintiles)."""
_LEAST_SHARE = 1e-12
"""Distance from 0 or 1 below which a probability is rounded to it: a normal distribution has no quantile there."""


_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
"""Pattern of numbers in JSON and YAML; Python itself would parse `1_0` as ten."""


class AxisError(LaunchError):
    """Raised when an axis cannot be applied to a job's environment or robot; the request is blamed."""


_REFUSED = re.compile(r"trials\.axes\.\w+: \w+ cannot be applied: (.+)")


def refusal(name: str, kind: str, why: object) -> str:
    """Makes the error text that an axis cannot be applied.

    Args:
        name: Name of the axis.
        kind: Kind of the axis.
        why: Reason.
    """
    return f"trials.axes.{name}: {kind} cannot be applied: {why}"


def why_not_applicable(reason: str) -> str:
    """Returns the reason why an axis could not be applied, from a job's failure reason; empty for other failures.

    Args:
        reason: Failure reason of the job.
    """
    found = _REFUSED.search(reason)
    return found[1] if found else ""


class LidarErrors(Protocol):
    """Interface to the errors of an environment's lidar, which take effect at the next episode."""

    noise_std_m: float
    bias_m: float
    dropout: float
    latency_s: float


class CommandDelay(Protocol):
    """Interface to the delay of an environment's motor commands, which takes effect at the next episode."""

    delay_s: float


class CommandGains(Protocol):
    """Interface to the factors on an environment's motor commands, which take effect at the next episode."""

    whole: float
    turn: float | None
    """Additional factor on turning rates; None: commands have no turning rate."""


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
        """Mask of the geoms of robot and floor whose contacts have friction, shape (ngeom,)."""
        ...

    @property
    def touching_pairs(self) -> Any:
        """Mask of the model's explicit contact pairs that have a geom of the robot, shape (npair,)."""
        ...

    @property
    def motors(self) -> Any:
        """Numbers of the actuators that move the robot, all with scalable forces."""
        ...

    @property
    def motor_joints(self) -> Any:
        """Numbers of the joints that the motors move and whose forces are limited."""
        ...

    @property
    def lidar(self) -> LidarErrors:
        """Noise, bias, dropout and latency of the robot's lidar."""
        ...

    @property
    def first_motor(self) -> Any:
        """Number of the first of `motors`, as a list, and of the joint of `motor_joints` that it moves, if any."""
        ...

    @property
    def commands(self) -> CommandDelay:
        """Delay between the agent's commands and the robot's motors."""
        ...

    @property
    def command_gains(self) -> CommandGains:
        """Factors by which the agent's commands to the robot are multiplied."""
        ...

    @property
    def wheels(self) -> WheelSlip:
        """Slip of the robot's wheels, which axes set: the share of their turning, below 1, that does not move it."""
        ...

    @property
    def odometry(self) -> OdometryErrors:
        """Errors of the pose that the robot is told."""
        ...

    def scale(self, field: str, where: Any, factor: float | None) -> None:
        """Sets numbers of a model field to a factor times the values that the model was built with.

        Args:
            field: Name of the field, such as `body_mass`.
            where: Mask or indices of the field's rows.
            factor: Factor; None: the original values.
        """
        ...

    def derive_constants(self) -> None:
        """Computes the model's constants that depend on masses."""
        ...


Setter = Callable[[float | None], None]
"""Function that applies a value of an axis; None: the original values."""


def _as_text(value: Any) -> Any:
    """Converts numbers to text, in which form SDKs send values."""
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def check_different(values: list[str]) -> list[str]:
    """Returns a list of values unless two of them are equal.

    Raises:
        ValueError: A value occurs twice.
    """
    if twice := sorted({value for value in values if values.count(value) > 1}):
        raise ValueError(repeated_words(map(repr, twice)))
    return values


def repeated_words(values: Iterable[str]) -> str:
    """Makes the error text for values of an axis, as a user writes them, that it has more than once."""
    return f"values have to differ; {', '.join(values)} appears more than once"


AxisValue = Annotated[str, BeforeValidator(_as_text, json_schema_input_type=str | float), ShapeName("AxisValue")]
"""Value of an axis in a request: text, or a number, which is converted to text."""
AxisText = Annotated[str, ShapeName("AxisValue")]
"""Value of an axis in a request that has to be text."""
AxisValues = Annotated[
    list[AxisValue],
    ShapeName("AxisValues"),
    Field(min_length=1, max_length=MAX_VALUES),
    AfterValidator(check_different),
]
AxisTexts = Annotated[
    list[AxisText], ShapeName("AxisValues"), Field(min_length=1, max_length=MAX_VALUES), AfterValidator(check_different)
]
AxisBound = Annotated[float, ShapeName("AxisBound"), Field(allow_inf_nan=False)]
AxisRange = Annotated[list[AxisBound], ShapeName("AxisRange"), Field(min_length=2, max_length=2)]
AxisSpread = Annotated[float, ShapeName("AxisSpread"), Field(gt=0, le=10_000, allow_inf_nan=False)]


class NormalDistribution(Shape):
    """Normal distribution truncated to two bounds."""

    mean: AxisBound = Field(description="Mean, in the unit of the axis.")
    std: AxisSpread = Field(description="Standard deviation, in the unit of the axis.")
    low: AxisBound | None = optional("Least value; absent: the least that is possible for the kind of axis.")
    high: AxisBound | None = optional("Largest value; absent: the largest that is possible for the kind of axis.")


class Axis(Shape):
    """Base class of kinds of axes: quantities that vary between the trials of a simulation job."""

    kind: Any = Field(description="Name of the axis's kind.")

    varies: ClassVar[str]
    """Description of the varied quantity for the table of kinds in `docs/trials.md`."""
    applies_to: ClassVar[str]
    """Environments and robots with that quantity, for the same table."""
    is_number: ClassVar[bool] = True

    @staticmethod
    def names(kind: "type[Axis]") -> tuple[str, ...]:
        """Returns the name of the kind in requests; empty for a base class."""
        return get_args(kind.model_fields["kind"].annotation)

    @property
    @abstractmethod
    def listed(self) -> Sequence[Value] | None:
        """Values that the axis lists; None: it has a range or a distribution."""

    @abstractmethod
    def parse(self, text: str) -> Value:
        """Converts a text to a value of the axis.

        Raises:
            ValueError: The text is not a possible value.
        """

    @abstractmethod
    def at(self, share: float) -> Value:
        """Returns the quantile of the axis's values at a probability, 0 to 1."""


class NumberAxis(Axis):
    """Base class of kinds of axes whose values are numbers."""

    unit: ClassVar[str]
    """Unit of the values for messages; the words `factor` and `share` mean no unit."""
    least: ClassVar[float]
    """Minimum possible value."""
    most: ClassVar[float]
    """Maximum possible value."""
    neutral: ClassVar[str]
    """Value that changes nothing, as text."""
    subject: ClassVar[str] = ""
    """Description of the changed quantity if other kinds change the same, so that a job can have only one of them;
    empty: none does.
    """

    values: AxisValues | None = optional("Its values, numbers in the unit of the kind; all or some of them are taken.")
    range: AxisRange | None = optional("Least and largest value; all between are equally likely.")
    normal: NormalDistribution | None = optional("Normal distribution of its values.")

    @classmethod
    @abstractmethod
    def bind(cls, rig: Rig) -> Setter:
        """Finds the quantity in the simulated robot, and returns a function that applies a value.

        Raises:
            AxisError: The robot or its environment does not have the quantity.
        """

    @classmethod
    def possible(cls) -> str:
        """Describes the possible values: `a factor from 0.1 to 10`."""
        bounds = f"from {cls.least:g} to {cls.most:g}"
        return f"a {cls.unit} {bounds}" if cls.unit in ("factor", "share") else f"{bounds} {cls.unit}"

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        given = [name for name in ("values", "range", "normal") if getattr(self, name) is not None]
        if len(given) != 1:
            has = f"{' and '.join(given)} are given" if given else "it has no values"
            raise ValueError(f"{has}; give one of values, range ([least, largest]) and normal (mean and std)")
        if self.values is not None:
            check_different([f"{number!r}" for number in self._numbers(self.values)])
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
        """Converts the texts of an axis's values to numbers.

        Raises ValueError, which names all texts that are invalid.
        """
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
        """Values that the axis lists, as numbers; None: it has a range or a distribution."""
        return None if self.values is None else [float(text) for text in self.values]

    def parse(self, text: str) -> float:
        """Converts a text to a number.

        Raises:
            ValueError: The text is not a number, or not a possible one.
        """
        if not _NUMBER.fullmatch(text):
            raise ValueError(f"{text!r} is no number; {self.kind} is {self.possible()}")
        return self._check(float(text))

    def at(self, share: float) -> float:
        """Returns the quantile of the axis's values at a probability, 0 to 1."""
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
        """Returns the bounds of `BINS` equally likely parts of a range or a distribution, in ascending order."""
        return [self.at(number / BINS) for number in range(BINS + 1)]

    @property
    def _bounds(self) -> tuple[float, float]:
        """Returns the minimum and maximum of a range or a distribution."""
        if self.range is not None:
            return self.range[0], self.range[1]
        assert self.normal is not None
        low, high = self.normal.low, self.normal.high
        return self.least if low is None else low, self.most if high is None else high


class LidarAxis(NumberAxis):
    """Base class of kinds of axes that change one of the errors of the robot's lidar."""

    applies_to = "`indoor-navigation` with a robot that has a lidar, and environments that have `lidar_errors`"
    error: ClassVar[str]
    """Name of the lidar error: an attribute of `LidarErrors`."""

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Returns a function that sets one of the errors of the robot's lidar; `None` is as built."""
        lidar = rig.lidar
        built = getattr(lidar, cls.error)

        def set_error(value: float | None) -> None:
            setattr(lidar, cls.error, built if value is None else value)

        return set_error
