"""Requirements of a simulation run, as data: what the robot has to do, or must not do, for the verdict PASS.

A job's request has them as its member `requirements` or, for SDKs that do not know that member, as JSON in
the launch variable `ROBOMAKER_REQUIREMENTS`; an environment may have some of its own.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import AfterValidator, Field, model_validator

from ..wire.base import Model, Shape, ShapeName, optional
from ..wire.common import text, unique_names
from ..wire.errors import InvalidParameterException
from ..wire.job_configs import JobRequest, given_once, is_program, launches
from ..wire.json_values import is_list, is_mapping
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


REQUIREMENTS_VARIABLE = "ROBOMAKER_REQUIREMENTS"
"""Launch variable that holds requirements as JSON, for SDKs that do not know the member."""

_STARTS_ON_ORIGIN = "indoor-navigation"
"""The simulation application whose robots start on the origin."""

_WITHIN_M = 0.5
_MAKES_SENSE = ("after", "by_s", "body")
"""Members of a goal that another one counts from, or that is not about the place of the robot."""

_BEGINNING = "ROBOMAKER_"
_NEAR, _NEAR_AS_A_WHOLE = 0.8, 0.9
"""Likeness of two names from which on one is taken for the other: behind the beginning, and of all of it."""


def requirements_of(request: JobRequest) -> list[JobRequirement]:
    """The requirements that a request asks for.

    Raises:
        InvalidParameterException: the variable's text is no list of requirements, or they are given twice and differ.
    """
    return _placed_requirements(request)[1]


def rooms_asked(request: JobRequest) -> list[tuple[str, str]]:
    """The rooms that a request's goals ask for, each with the path of the member that does.

    Raises:
        InvalidParameterException: as `requirements_of`.
    """
    place, requirements = _placed_requirements(request)
    return [(f"{place}[{index}].room", room) for index, room in rooms_of(requirements)]


def _placed_requirements(request: JobRequest) -> tuple[str, list[JobRequirement]]:
    """The path of the member that holds a request's requirements, and these."""
    place, requirements = given_once(request, "requirements", REQUIREMENTS_VARIABLE, parse_requirements)
    return place, requirements or []


def check_requirements(request: JobRequest) -> None:
    """Finds out what of a request's requirements cannot be judged, as far as the request says it.

    Raises:
        ValueError: the launch variable is misspelt or cannot be understood, a room is asked for where there is no
            world, a goal is where the robot starts, or all applications are programs, so that there is no simulation
            to judge.
    """
    for place, name in _misspelt(request):
        raise ValueError(
            f"{place}.{name} is not known; did you mean {REQUIREMENTS_VARIABLE}? The job would be judged without it"
        )
    try:
        place, requirements = _placed_requirements(request)
        rooms = rooms_asked(request)
    except InvalidParameterException as error:
        raise ValueError(str(error)) from None
    if requirements and _has_only_programs(request):
        raise ValueError(
            f"{place}: they would not be judged, since the job has only programs; name a simulation application that "
            "makes an environment, or let the program write its verdict to result.json"
        )
    if _starts_on_origin(request):
        for index, member, problem in goals_at_start([each.to_wire() for each in requirements]):
            raise ValueError(f"{place}[{index}].{member}: {problem}")
    if _has_world(request):
        return
    for path, room in rooms:
        raise ValueError(
            f"{path} is {room!r}, but the job names no world; "
            "add simulationApplications[0].worldConfigs, or give the goal as x and y"
        )


def misspelt_requirements(variables: Iterable[str]) -> list[str]:
    """Names of variables that are clearly meant to hold requirements, and do not."""
    return [name for name in variables if name != REQUIREMENTS_VARIABLE and _is_meant(name)]


def doubtful_requirements(variables: Iterable[str]) -> list[str]:
    """Names of other variables that begin like the one with requirements."""
    return [
        name
        for name in variables
        if name.startswith(f"{_BEGINNING}REQ") and name != REQUIREMENTS_VARIABLE and not _is_meant(name)
    ]


def starts_on_origin(order: Mapping[str, Any]) -> bool:
    """Whether the robot of a job starts on the origin of its world, as far as the order for the job says it."""
    configs = order.get("simulationApplications")
    first = configs[0] if is_list(configs) and configs else None
    return is_mapping(first) and first.get("application") == _STARTS_ON_ORIGIN


def goals_at_start(requirements: Sequence[Any], start_room: str | None = None) -> Iterator[tuple[int, str, str]]:
    """Finds goals that are reached before the robot moves: index, member, and what is wrong with it.

    Goals that another one comes after are places to begin at, and goals with `by_s` say that they are meant so.

    Args:
        requirements: What an order asks for, as JSON; what is no goal is passed over.
        start_room: Name of the room that the origin is in; None: that is not known.
    """
    goals = [
        (index, each) for index, each in enumerate(requirements) if is_mapping(each) and each.get("kind") == "goal"
    ]
    begun = {each.get("after") for _, each in goals}
    for index, goal in goals:
        if goal.get("name") in begun or any(goal.get(key) is not None for key in _MAKES_SENSE):
            continue
        if start_room is not None and goal.get("room") == start_room:
            yield index, "room", _in_words(f"the robot starts in {start_room!r}")
        elif _is_near(goal):
            yield index, "x", _in_words("the robot starts at (0, 0)")


def unknown_room(asked: Sequence[tuple[str, str]], rooms: Sequence[str]) -> str | None:
    """Says which goal cannot be judged because the world has no such room; `None` if all can.

    Args:
        asked: see `rooms_asked`.
        rooms: names of the world's rooms.
    """
    for path, room in asked:
        if room not in rooms:
            return f"{path}: {no_such_room(room, rooms)}"
    return None


def no_such_room(room: str, rooms: Sequence[str]) -> str:
    """Says that a world has other rooms."""
    return f"the world has no room {room!r}; its rooms are {', '.join(rooms)}"


def _has_world(request: JobRequest) -> bool:
    return any(config.worldConfigs for config in request.simulationApplications or ())


def _starts_on_origin(request: JobRequest) -> bool:
    return any(config.application == _STARTS_ON_ORIGIN for config in request.simulationApplications or ())


def _has_only_programs(request: JobRequest) -> bool:
    """Whether no process steps an environment, as far as the request says it (see `RunPlan.has_episode`)."""
    configs = request.simulationApplications or request.robotApplications or ()
    return bool(configs) and all(is_program(config.launchConfig) for config in configs)


def _misspelt(request: JobRequest) -> Iterator[tuple[str, str]]:
    """The paths of members with a variable that is nearly called like the launch variable, each with its name."""
    for place, launch in launches(request):
        for name in misspelt_requirements(launch.environmentVariables or {}):
            yield f"{place}.environmentVariables", name


def _is_meant(name: str) -> bool:
    if name.startswith(_BEGINNING):
        return _likeness(name.removeprefix(_BEGINNING), REQUIREMENTS_VARIABLE.removeprefix(_BEGINNING)) >= _NEAR
    return _likeness(name, REQUIREMENTS_VARIABLE) >= _NEAR_AS_A_WHOLE


def _likeness(name: str, other: str) -> float:
    return SequenceMatcher(None, name, other).ratio()


def _is_near(goal: Mapping[str, Any]) -> bool:
    place = [goal.get("x"), goal.get("y"), goal.get("within_m") or _WITHIN_M]
    numbers = [each for each in place if isinstance(each, int | float)]
    return len(numbers) == 3 and math.hypot(numbers[0], numbers[1]) <= numbers[2]


def _in_words(start: str) -> str:
    return f"{start}, so the goal cannot be missed; `after` makes it one to come back to, `by_s` one to begin at"
