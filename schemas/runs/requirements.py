"""Requirements of a simulation run, as data: what the robot has to do, or must not do, for the verdict PASS.

A job's request has them as its member `requirements` or, for SDKs that do not know that member, as JSON in
the launch variable `ROBOMAKER_REQUIREMENTS`; an environment may have some of its own.
"""

from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from ..wire.base import Model, Shape, ShapeName, optional
from ..wire.common import text, unique_names
from ..wire.request_problems import parsed_member

MAX_REQUIREMENTS = 50
"""How many requirements a run may have."""
FLOOR_REACH_M = 0.012
"""Fixed things whose top is no higher are floor: ground, rugs, thresholds."""

Seconds = Annotated[float, ShapeName("Seconds"), Field(gt=0, allow_inf_nan=False)]
Metres = Annotated[float, ShapeName("Metres"), Field(gt=0, allow_inf_nan=False)]
Coordinate = Annotated[float, ShapeName("Coordinate"), Field(allow_inf_nan=False)]
Newtons = Annotated[float, ShapeName("Newtons"), Field(ge=0, allow_inf_nan=False)]
Count = Annotated[int, ShapeName("Count"), Field(ge=0)]
RequirementName = Annotated[str, ShapeName("RequirementName"), text(1, 64, r"[a-zA-Z0-9_\-]+")]
BodyName = Annotated[str, ShapeName("BodyName"), text(1, 255)]
NamePatterns = Annotated[
    list[Annotated[str, ShapeName("NamePattern"), text(1, 255)]],
    ShapeName("NamePatterns"),
    Field(min_length=1, max_length=50),
]
DottedName = Annotated[str, ShapeName("DottedName"), text(1, 255, r"[a-zA-Z_][a-zA-Z0-9_]*(\.[a-zA-Z_][a-zA-Z0-9_]*)+")]

_STOP = "Whether the run ends as soon as it is violated"
_BODY = "Body of the robot; absent: the environment's `robot_body`, else the first free body that has actuators."
_OTHERS = "Names of what counts, with `*` for any text: furniture ids, `wall`, bodies; absent: everything."
_IGNORE = "Names of what may be touched all the same, with `*` for any text; the floor always may."


class GoalRequirement(Shape):
    """The robot has to get somewhere: into a room of the world, or near a point."""

    kind: Literal["goal"] = Field(description="`goal`.")
    name: RequirementName = Field(description="Its name, unique in the run.")
    room: Annotated[str, ShapeName("RoomName"), text(1, 255)] | None = optional(
        "Room of the world that the robot's body has to be in."
    )
    x: Coordinate | None = optional("Point to get to, in metres.")
    y: Coordinate | None = optional("Point to get to, in metres.")
    within_m: Metres = Field(default=0.5, description="How near to the point is there, in metres.")
    by_s: Seconds | None = optional("Simulated time at which it has to be there at the latest.")
    after: RequirementName | None = optional(
        "Name of the goal that has to be reached before; only then this one counts."
    )
    body: BodyName | None = optional(_BODY)
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")
    stop: bool = Field(
        default=False, description=f"{_STOP}, or once all goals that say so are reached; the verdict stands then."
    )

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        has_point = self.x is not None and self.y is not None
        if (self.x is None) != (self.y is None):
            raise ValueError("a point needs both x and y")
        if has_point == (self.room is not None):
            raise ValueError(f"{'both' if has_point else 'neither'} room and x, y; a goal is one of them")
        return self


class CollisionRequirement(Shape):
    """The robot must not touch anything but the floor harder than so."""

    kind: Literal["no_collision"] = Field(description="`no_collision`.")
    name: RequirementName = Field(description="Its name, unique in the run.")
    max_force_N: Newtons = Field(description="Largest normal force that is no collision yet, in newtons.")
    max_count: Count = Field(default=0, description="How many harder touches are allowed.")
    others: NamePatterns | None = optional(_OTHERS)
    ignore: NamePatterns | None = optional(_IGNORE)
    body: BodyName | None = optional(_BODY)
    period_s: Seconds = Field(
        default=0.01, description="Simulated seconds from one check to the next, if the environment is asked so often."
    )
    stop: bool = Field(default=False, description=f"{_STOP}.")


class TimeLimitRequirement(Shape):
    """The run has to be over in time."""

    kind: Literal["time_limit"] = Field(description="`time_limit`.")
    name: RequirementName = Field(description="Its name, unique in the run.")
    limit_s: Seconds = Field(description="Simulated time at which the run has to be over.")
    stop: bool = Field(default=False, description=f"{_STOP}.")


class ClearanceRequirement(Shape):
    """The robot has to keep its distance from everything but the floor."""

    kind: Literal["clearance"] = Field(description="`clearance`.")
    name: RequirementName = Field(description="Its name, unique in the run.")
    min_m: Metres = Field(description="Smallest distance between the robot's surface and another, in metres.")
    others: NamePatterns | None = optional(_OTHERS)
    ignore: NamePatterns | None = optional(_IGNORE)
    body: BodyName | None = optional(_BODY)
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")
    stop: bool = Field(default=False, description=f"{_STOP}.")


class PredicateRequirement(Shape):
    """A function of the application has to say yes each time."""

    kind: Literal["predicate"] = Field(description="`predicate`.")
    name: RequirementName = Field(description="Its name, unique in the run.")
    attribute: DottedName = Field(
        description="Dotted path of the function in the simulation or robot application, `my_nav.rules.keeps_left`: "
        "`(environment, time_s)` gives a bool, or a bool and a reason."
    )
    period_s: Seconds = Field(default=0.5, description="Simulated seconds from one check to the next.")
    stop: bool = Field(default=False, description=f"{_STOP}.")


JobRequirement: TypeAlias = Annotated[
    GoalRequirement | CollisionRequirement | TimeLimitRequirement | ClearanceRequirement | PredicateRequirement,
    ShapeName("JobRequirement"),
    Field(discriminator="kind"),
]
"""One requirement; `kind` says which."""


def _goals_in_order(requirements: list[Any]) -> list[Any]:
    goals: list[str] = []
    for requirement in requirements:
        if isinstance(requirement, GoalRequirement):
            if requirement.after is not None and requirement.after not in goals:
                there = f"those before it are {', '.join(goals)}" if goals else "there is none before it"
                raise ValueError(f"{requirement.name}: after is {requirement.after!r}, no goal further up; {there}")
            goals.append(requirement.name)
    return requirements


JobRequirements: TypeAlias = Annotated[
    list[JobRequirement],
    ShapeName("JobRequirements"),
    Field(max_length=MAX_REQUIREMENTS),
    AfterValidator(unique_names("requirements")),
    AfterValidator(_goals_in_order),
]
"""The requirements of a run: names differ, and a goal stands below the one it comes after."""


class _Holder(Model):
    requirements: JobRequirements


def parse_requirements(data: object, what: str) -> list[JobRequirement]:
    """Makes requirements from plain values.

    Args:
        data: a list of mappings or of requirements.
        what: where the values come from, for messages.

    Raises:
        InvalidParameterException: one line per problem: where, what, and what would be right.
    """
    return parsed_member(data, what, "requirements", _Holder)


def rooms_of(requirements: Sequence[JobRequirement]) -> list[tuple[int, str]]:
    """The rooms that goals ask for, each with the place of its goal."""
    return [
        (index, requirement.room)
        for index, requirement in enumerate(requirements)
        if isinstance(requirement, GoalRequirement) and requirement.room is not None
    ]
