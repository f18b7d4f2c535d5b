"""Base classes of kinds of requirements: members in requests, and a rule that judges a run.

This module does not use MuJoCo: rules measure in a `Scene`. Times are simulated seconds.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Annotated, Any, ClassVar, Generic, Protocol, TypeVar, get_args, get_origin

from pydantic import Field

from ...wire.base import Model, Shape, ShapeName, optional
from ...wire.common import text
from ...wire.errors import ConfigurationError, LaunchError
from ...wire.request_problems import nearest
from ...worlds.world import Point, World

Seconds = Annotated[float, ShapeName("Seconds"), Field(gt=0, allow_inf_nan=False)]
Metres = Annotated[float, ShapeName("Metres"), Field(gt=0, allow_inf_nan=False)]
Coordinate = Annotated[float, ShapeName("Coordinate"), Field(allow_inf_nan=False)]
MetresPerSecond = Annotated[float, ShapeName("MetresPerSecond"), Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, ShapeName("Share"), Field(gt=0, le=1, allow_inf_nan=False)]
Newtons = Annotated[float, ShapeName("Newtons"), Field(ge=0, allow_inf_nan=False)]
Count = Annotated[int, ShapeName("Count"), Field(ge=0)]
RequirementName = Annotated[str, ShapeName("RequirementName"), text(1, 64, r"[a-zA-Z0-9_\-]+")]
RoomName = Annotated[str, ShapeName("RoomName"), text(1, 255)]
DottedName = Annotated[str, ShapeName("DottedName"), text(1, 255, r"[a-zA-Z_][a-zA-Z0-9_]*(\.[a-zA-Z_][a-zA-Z0-9_]*)+")]
RosTopic = Annotated[str, ShapeName("RosTopic"), text(2, 255, r"(/[A-Za-z_][A-Za-z0-9_]*)+")]
BodyName = Annotated[str, ShapeName("BodyName"), text(1, 255)]
NamePatterns = Annotated[
    list[Annotated[str, ShapeName("NamePattern"), text(1, 255)]],
    ShapeName("NamePatterns"),
    Field(min_length=1, max_length=50),
]

ROUNDING_S = 1e-6
"""Tolerance in seconds within which times are equal, as sums of time steps have rounding errors."""
STOP = "Whether the run ends as soon as it is violated"
STOP_OR_REACHED = f"{STOP}, or once all goals that say so are reached; the verdict stands then."
COUNTS_IN_NO_TRIAL = "counts in no trial; "
"""Beginning of the detail of a requirement of a job with trials that counted in none: goals ended each before it."""
_MISSED_AT_START = "; it was missed before the robot moved, so nothing that it does could have met it here"
_MAX_TEXT = 300
"""Maximum number of characters of an error or a reason in results."""

Look = Callable[[float], None]
"""Function that measures at a simulated time and updates the rule."""


class Requirement(Model):
    """A requirement (pass criterion) of a run, with its outcome in the result."""

    name: str = Field(description="Short name of the requirement, `rooms_visited`.")
    satisfied: bool = Field(description="Whether the requirement is met.")
    detail: str = Field(description="Measured and required value, as text.")
    kind: str | None = optional("Kind of requirement; absent: the environment's own.")
    error: str | None = optional("Why it could not be judged; the verdict is ERROR then. Absent: it was judged.")
    counts: bool = Field(
        default=True,
        description=(
            "Whether the verdict depends on the requirement; not if goals of the job ended the run before the "
            "environment's own."
        ),
    )
    value: float | None = optional("The worst value found.")
    limit: float | None = optional("The value asked for.")
    unit: str | None = optional("Unit of value, limit and margin: `m`, `N`, `s`.")
    margin: float | None = optional("How far the value is on the right side of the limit; negative: on the wrong one.")
    trial: int | None = optional("Number of the trial with this value and margin; absent: of a single run.")
    first_violation_s: float | None = optional("Simulated time at which it was first found violated; absent: never.")
    room: str | None = optional("Room that the robot was in then; absent: in none, or it is not known.")
    other: str | None = optional("Thing that the robot touched then, or was too near to; absent: it is about none.")

    @property
    def margin_text(self) -> str:
        """Margin with two significant digits or more, and its unit: `0.029 m`; empty without a margin."""
        if self.margin is None or not math.isfinite(self.margin):
            return ""
        decimals = 1 - math.floor(math.log10(abs(self.margin))) if self.margin else 0
        return f"{self.margin:.{max(decimals, 0)}f} {self.unit or ''}".rstrip()

    def is_aside(self, *, of_trials: bool) -> bool:
        """Returns whether nothing depends on the requirement: it is switched off, or does not count.

        Args:
            of_trials: Whether it is an entry of a job with trials, of which only `trials` counts in the job and all
                others count in their trials, unless they are off or their detail says that they count in none.
        """
        counts = not self.detail.startswith(COUNTS_IN_NO_TRIAL) if of_trials else self.counts
        return self.error is None and (self.kind == "off" or not counts)


class RequirementError(LaunchError):
    """Raised for a requirement that cannot be checked; the request is blamed."""


class NotMeasuredError(RequirementError):
    """Raised when a scene lacks a quantity that a requirement measures, as a recording without its topic."""


NOT_READ = "it is judged by the topics that the run records, and there is no recording of a single run"
"""Error of a requirement that is judged by topics, until a simulation's recording has been read."""


class RequirementKind(Shape):
    """Base class of kinds of requirements (pass criteria of a simulation job)."""

    kind: Any = Field(description="Name of the requirement's kind.")
    name: RequirementName = Field(description="Name of the requirement, unique in the run.")
    stop: bool = Field(default=False, description=f"{STOP}.")

    violated_when: ClassVar[str]
    """Condition of a violation, for the table of kinds in `docs/verdicts.md`."""
    more_members: ClassVar[str] = ""
    """Text about further members, for the same table."""
    rule: ClassVar[type["Rule[Any]"]]
    """Class of the rule that judges the requirement."""
    margins_compare: ClassVar[bool] = True
    """Whether margins of different runs have one unit, so that the smallest is the worst."""
    unit_if_met: ClassVar[str | None] = None
    """Unit of the margins of trials that met it, where those of others have another unit."""

    @staticmethod
    def names(kind: "type[RequirementKind]") -> tuple[str, ...]:
        """Returns the name of the kind in requests; empty for a base class.

        Raises:
            ConfigurationError: The kind has no rule.
        """
        names = get_args(kind.model_fields["kind"].annotation)
        if names and "rule" not in vars(kind):  # its parent's would judge as if it had no members of its own
            raise ConfigurationError(f"{kind.__module__} has no class that is a Rule[{kind.__name__}]")
        return names

    needs_world: ClassVar[bool] = False
    """Whether the requirement can only be judged with a world."""
    without_world: ClassVar[str] = "leave out `room`"
    """Remedy in the error for a request that names a room but no world."""

    @classmethod
    def packages(cls, requirement: Mapping[str, Any]) -> Iterator[str]:  # noqa: ARG003 - for those who need it
        """Yields the Python packages whose code judges a requirement, other than this one."""
        own = cls.__module__.partition(".")[0]
        if own != __name__.partition(".")[0]:
            yield own

    @property
    def by_topics(self) -> bool:
        """Whether the requirement is measured by recorded topics only, after the run."""
        return False

    @property
    def asked_room(self) -> str | None:
        """Name of the world's room that the requirement is about; `None` for none."""
        return None

    def check_after(self, before: Sequence["RequirementKind"]) -> None:
        """Checks the requirement against those above it in the list.

        Raises:
            ValueError: The requirement and those above it contradict each other, or it refers to one that is not above
                it.
        """


class RobotRequirement(RequirementKind):
    """Base class of requirements about the robot's body."""

    body: BodyName | None = optional(
        "Body of the robot; absent: the environment's `robot_body`, else the first free body that has actuators."
    )


class ThingsRequirement(RobotRequirement):
    """Base class of requirements about the robot and the objects around it."""

    others: NamePatterns | None = optional(
        "Names of what counts, with `*` for any text: furniture ids, `wall`, bodies; absent: everything."
    )
    ignore: NamePatterns | None = optional(
        "Names of what may be touched all the same, with `*` for any text; the floor always may."
    )


class Floor(Protocol):
    """Free floor of a world from its map, as numbered grid cells."""

    @property
    def cell_m2(self) -> float:
        """Area of a grid cell of the floor, in m²."""
        ...

    def cells(self, polygon: Sequence[Point] | None, radius_m: float) -> Set[int]:
        """Returns the numbers of the cells inside a polygon that a disc of a radius can pass over.

        Lengths are in metres; `None` as polygon is the whole map.
        """
        ...

    def passed(self, start: Point, end: Point, radius_m: float) -> Set[int]:
        """Returns the cells that a disc of a radius passes over on a straight line."""
        ...

    def shortest_m(self, start: Point, target: Sequence[Point], radius_m: float) -> float | None:
        """Returns the length in metres of a disc's shortest path to a point, or into a polygon; `None`: no path."""
        ...


class Scene(Protocol):
    """Interface to a simulation for judging requirements: positions, contacts, distances."""

    @property
    def environment(self) -> Any:
        """The simulation's environment (dm_env)."""
        ...

    @property
    def world(self) -> World | None:
        """Description of the run's world; `None` if it has none."""
        ...

    def position(self, rule: "Rule[Any]") -> Sequence[float]:
        """Returns the robot's position x, y, z in metres, as an array that follows the simulation."""
        ...

    def orientation(self, rule: "Rule[Any]") -> Sequence[float]:
        """Returns the robot's orientation (quaternion, w first), as an array that follows the simulation."""
        ...

    def messages(self, rule: "Rule[Any]", topic: str) -> Iterator[tuple[float, Any]]:
        """Yields the messages that were recorded on a topic, each with its time in seconds, in recorded order.

        Raises:
            NotMeasuredError: The run has no recording, or the recording has no such topic.
        """
        ...

    def pose_pairs(self, rule: "Rule[Any]", estimate: str, truth: str) -> "Iterator[PosePair]":
        """Yields the estimated poses on a recorded topic, each with the true pose on another topic at the same time.

        Raises:
            NotMeasuredError: The run has no recording, or the recording lacks one of the topics.
        """
        ...

    def can_tilt(self, rule: "Rule[Any]") -> bool:
        """Returns whether the robot's body can tilt; some robots have no joint that lets it."""
        ...

    def can_rise(self, rule: "Rule[Any]") -> bool:
        """Returns whether the height of the robot's body can change; some robots have no joint that lets it."""
        ...

    def expect_end(self, rule: "Rule[Any]") -> None:
        """Registers a rule that is judged at the end of the run, which a recording may not contain."""
        ...

    def floor(self, rule: "Rule[Any]") -> Floor | None:
        """Returns the free floor of the world; `None`: there is no world.

        Raises:
            RequirementError: The world has no map.
        """
        ...

    def contacts(self, rule: "Rule[Any]") -> Callable[[], Mapping[str, float]]:
        """Returns a function that reads the contact force (N) of each object that touches the robot."""
        ...

    def clearance(self, rule: "Rule[Any]") -> Callable[[float], tuple[float, str] | None]:
        """Returns a function that measures the smallest distance to other objects, in metres.

        It gets a distance, and returns the distance and name of the nearest object; `None` if none is nearer than that.
        """
        ...

    def function(self, rule: "Rule[Any]", attribute: str) -> Callable[..., Any]:
        """Imports a predicate function of an application or installed package."""
        ...


@dataclass(frozen=True)
class Numbers:
    """Measured value and limit of a requirement."""

    value: float | None = None
    limit: float | None = None
    unit: str | None = None
    at_least: bool = False
    """Whether the limit is a minimum; else it is a maximum."""

    @property
    def margin(self) -> float | None:
        """Difference between value and limit, positive if the requirement is met; `None` if one is not known."""
        if self.value is None or self.limit is None:
            return None
        return self.value - self.limit if self.at_least else self.limit - self.value


PlanarPose = tuple[float, float, float]
"""Pose on the floor: x and y in m, yaw in rad."""


@dataclass(frozen=True)
class PosePair:
    """Estimated and true pose of a robot at one time."""

    time_s: float
    """Time in seconds since the run began."""
    estimate: PlanarPose
    truth: PlanarPose


@dataclass(frozen=True)
class Blind:
    """Distance from the robot's surface below which its sensor measures nothing."""

    below_m: float
    why: str
    """Text with the sensor and its minimum range."""


Asked = TypeVar("Asked", bound=RequirementKind)


class Rule(ABC, Generic[Asked]):
    """Judges one requirement during a run; its state can be saved in checkpoints."""

    looks_within_steps: ClassVar[bool] = False
    """Whether the rule is also checked between two environment steps, if the environment supports that."""
    is_reached: bool | None = None
    """Whether the requirement's goal is reached; `None`: the requirement has no goal."""
    blind: Blind | None = None
    """Distance below which the sensor measured nothing; `None`: there is no such distance."""
    missed_at_start: bool = False
    """Whether it was found violated before the robot moved."""

    def __init_subclass__(cls) -> None:
        kinds = [get_args(base)[0] for base in vars(cls).get("__orig_bases__", ()) if get_origin(base) is Rule]
        if not kinds:
            raise TypeError(f"{cls.__name__} does not say whose rule it is; add Rule[ItsShape] to its bases")
        kind = kinds[0]
        if "rule" in vars(kind):
            raise TypeError(f"{kind.__name__} has a rule, {kind.rule.__name__}; {cls.__name__} would replace it")
        kind.rule = cls

    def __init__(self, asked: Asked) -> None:
        self.asked = asked
        self.violated_s: float | None = None
        """Simulated time of the first violation in seconds; None: there was none."""
        self.room: str | None = None
        """Room that the robot was in when it was first found violated, or at the end; None: in none, or not known."""
        self.other: str | None = None
        """Thing that the robot touched then, or was too near to; None: it is about none."""
        self.error: str | None = None
        """Reason why the requirement cannot be judged; None: it can."""
        self._end_s = 0.0
        self._ended_by = ""

    @abstractmethod
    def bind(self, scene: Scene) -> Look:
        """Connects the rule to a simulation, and returns the function that checks it at a simulated time.

        Raises:
            RequirementError: The requirement cannot be judged in this simulation, such as for a body, room or function
                that it lacks.
        """

    def follow(self, before: Sequence["Rule[Any]"]) -> None:
        """Receives the rules of the requirements listed above, for a rule that depends on one of them."""

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds the figures that the rule has measured to the run's metrics."""

    @property
    def first_look_s(self) -> float:
        """Simulated time in seconds before which the rule need not be checked."""
        return 0.0

    @property
    def planned_s(self) -> float:
        """Longest simulated time in seconds that the requirement allows; 0 if it has no time limit."""
        return 0.0

    @property
    def is_over(self) -> bool:
        """Whether the run can end now, as far as this requirement is concerned."""
        return self.asked.stop and (self.violated_s is not None or self.error is not None)

    def fail(self, error: str) -> None:
        """Records that the requirement cannot be judged; the first reason is kept."""
        self.error = self.error or error[:_MAX_TEXT]

    def cannot(self, why: str) -> RequirementError:
        """Makes the error for a requirement that cannot be judged."""
        return RequirementError(f"requirement {self.asked.name} ({self.asked.kind}): {why}")

    def polygon(self, room: str, scene: Scene) -> Sequence[Point]:
        """Returns the outline of a room of the world.

        Raises:
            RequirementError: The simulation has no world, or the world has no room of this name.
        """
        if scene.world is None:
            raise self.cannot(f"it asks for the room {room!r}, but there is no world")
        rooms = {each.name: each.polygon for each in scene.world.floorplan.rooms}
        if room not in rooms:
            there = nearest(room, rooms) or f"; there are {', '.join(rooms)}"
            raise self.cannot(f"the world has no room {room!r}{there}")
        return rooms[room]

    def violate(self, time_s: float, other: str | None = None) -> bool:
        """Records a violation; returns whether it is the first.

        Args:
            time_s: Simulated time.
            other: Thing that the robot touched, or was too near to; None: it is about none.
        """
        is_first = self.violated_s is None
        if is_first:
            self.violated_s, self.other = time_s, other
        return is_first

    def judged(self, end_s: float, ended_by: str) -> Requirement:
        """Judges the requirement at the end of the run.

        Args:
            end_s: Simulated time at the end of the run.
            ended_by: Cause of the run's end.
        """
        self._end_s, self._ended_by = end_s, ended_by
        if (why := self._unjudgeable()) is not None:
            self.fail(why)
        name, kind = self.asked.name, self.asked.kind
        if self.error is not None:
            detail = f"could not be judged: {self.error}"
            return Requirement(name=name, kind=kind, satisfied=False, detail=detail, error=self.error)
        satisfied = self.violated_s is None and self.is_reached is not False
        if not satisfied:
            self.violate(end_s)
        numbers = self._numbers()
        return Requirement(
            name=name,
            kind=kind,
            satisfied=satisfied,
            detail=self._detail() + (_MISSED_AT_START if self.missed_at_start else ""),
            value=_rounded(numbers.value),
            limit=numbers.limit,
            unit=numbers.unit,
            margin=_rounded(numbers.margin),
            first_violation_s=_rounded(self.violated_s),
            room=None if satisfied else self.room,
            other=None if satisfied else self.other,
        )

    def margin_until(self, time_s: float) -> tuple[float, str | None] | None:  # noqa: ARG002 - for those who need it
        """Returns the margin, with its unit, that the requirement would have if the run ended now.

        Args:
            time_s: Simulated time.

        Returns:
            None where there is none: it cannot be judged, nothing was measured yet, or only the end says it.
        """
        if self.error is not None:
            return None
        numbers = self._numbers()
        return None if numbers.margin is None else (numbers.margin, numbers.unit)

    def _unjudgeable(self) -> str | None:
        """Returns the reason why the requirement cannot be judged after the run; None if it can."""
        return None

    def remark(self) -> str | None:
        """Returns a note to show with the verdict, or `None`."""
        return None

    def _until(self) -> str:
        """Returns a suffix for a description: `, first at 3.20 s`, the time of the first violation; empty if none."""
        return "" if self.violated_s is None else f", first at {self.violated_s:.2f} s"

    @abstractmethod
    def _numbers(self) -> Numbers: ...

    @abstractmethod
    def _detail(self) -> str:
        """Describes the measured and the required value."""


def is_meant(name: str, others: Sequence[str] | None, ignore: Sequence[str] | None) -> bool:
    """Returns whether an object counts for a requirement: its name matches `others` and none of `ignore`."""
    wanted = others is None or any(fnmatchcase(name, pattern) for pattern in others)
    return wanted and not any(fnmatchcase(name, pattern) for pattern in ignore or ())


def yaw_rad(orientation: Sequence[float]) -> float:
    """Returns the yaw of a quaternion with w first, in radians."""
    w, x, y, z = orientation
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 6)
