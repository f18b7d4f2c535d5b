"""Requirements of a simulation run: what the robot has to do, or must not do, for the verdict PASS.

A job's request has them in its member `requirements` or, for SDKs that do not know that member, as JSON in the launch
variable `ROBOMAKER_REQUIREMENTS`; an environment may have some of its own.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, Union

from pydantic import AfterValidator, Field

from ..discovery import classes_of
from ..wire.base import Model, ShapeName
from ..wire.common import raise_all, unique_names
from ..wire.errors import InvalidParameterException
from ..wire.job_configs import JobRequest, given_once, is_program, launches
from ..wire.json_values import is_list, is_mapping
from ..wire.request_problems import nearest_of, parsed_member
from . import requirement_kinds
from .requirement_kinds.goal import goals_at_start
from .requirement_kinds.kind import RequirementKind
from .requirement_kinds.off import OffRequirement
from .trials import trials_of

MAX_REQUIREMENTS = 50
"""Maximum number of requirements of a run."""


REQUIREMENT_KINDS: Mapping[str, type[RequirementKind]] = classes_of(
    RequirementKind, requirement_kinds.__name__, "requirements", RequirementKind.names
)
"""Kinds of requirements by name."""

if TYPE_CHECKING:
    JobRequirement: TypeAlias = RequirementKind
    """One requirement; `kind` says which."""
else:
    _ANY = Union[tuple(REQUIREMENT_KINDS.values())]  # noqa: UP007 - the kinds are known at run time only
    JobRequirement = Annotated[_ANY, ShapeName("JobRequirement"), Field(discriminator="kind")]


def _agreeing(requirements: list[RequirementKind]) -> list[RequirementKind]:
    raise_all(_disagreements(requirements))
    return requirements


def _disagreements(requirements: list[RequirementKind]) -> Iterator[str]:
    """Yields problems of names that occur twice, and of goals listed above the goal that they follow."""
    try:
        unique_names("requirements")(requirements)
    except ValueError as error:
        yield str(error)
    for index, requirement in enumerate(requirements):
        try:
            requirement.check_after(requirements[:index])
        except ValueError as error:
            yield f"[{index}]: {error}"


JobRequirements: TypeAlias = Annotated[
    list[JobRequirement],
    ShapeName("JobRequirements"),
    Field(max_length=MAX_REQUIREMENTS),
    AfterValidator(_agreeing),
]
"""Requirements of a run; names are unique, and a goal is listed below the one that it follows."""


class _Holder(Model):
    requirements: JobRequirements


def parse_requirements(data: object, what: str) -> list[JobRequirement]:
    """Parses requirements (pass criteria of a simulation job) from plain values.

    Args:
        data: A list of mappings or of requirements.
        what: Name of the source of the values, for error messages.

    Raises:
        InvalidParameterException: One line per problem: where, what, and what would be right.
    """
    return parsed_member(data, what, "requirements", _Holder)


def rooms_of(requirements: Sequence[JobRequirement]) -> list[tuple[int, str]]:
    """Returns the names of rooms that requirements mention, each with the index of its requirement."""
    return [
        (index, requirement.asked_room)
        for index, requirement in enumerate(requirements)
        if requirement.asked_room is not None
    ]


REQUIREMENTS_VARIABLE = "ROBOMAKER_REQUIREMENTS"
"""Launch variable that holds requirements as JSON, for SDKs that do not know the member."""

_STARTS_ON_ORIGIN = "indoor-navigation"
"""Name of the simulation application whose robots start at the origin."""

_BEGINNING = "ROBOMAKER_"
_MEANT = frozenset(
    f"{_BEGINNING}{ending}"
    for ending in (
        *("REQUIREMENTS", "TRIALS", "ROBOT", "POLICY", "ROS", "SEED", "SECRETS", "SIM_TIME_LIMIT_S", "APPEARANCE"),
        *("VIDEO_SIZE", "VIDEO_FPS", "VIDEO_CAMERA", "RECORD_CAMERA", "RECORD_CAMERA_HZ", "CHECKPOINT_EVERY_S"),
        *("OUTPUT_DIR", "DATA_DIR", "WORLD_DIR", "JOB_ROOT", "HOME", "MAP_YAML", "AGENT_SOCKET", "ROS1_SOCKET"),
        *("SOURCES", "AGENT_CONNECT_TIMEOUT_S"),
    )
)
"""Names of launch variables that mean something to runs."""
_NEAR_VARIABLE = 0.85
"""Minimum similarity, without the beginning: `ROBBOT` has 0.91 of `ROBOT`, `SIMTIME_LIMIT` 0.93; `CAMERA` has less."""
_NEAR, _NEAR_AS_A_WHOLE = 0.8, 0.9
"""Minimum similarity of two names to suggest one for the other: without their common prefix, and as a whole."""


def requirements_of(request: JobRequest) -> list[JobRequirement]:
    """Returns the requirements (pass criteria) of a simulation job request, from its member or its launch variable.

    Raises:
        InvalidParameterException: The variable's text is no list of requirements, or they are given twice and differ.
    """
    return _placed_requirements(request)[1]


def rooms_asked(request: JobRequest) -> list[tuple[str, str]]:
    """Returns the names of rooms that a request's goals mention, each with the path of the request member.

    Raises:
        InvalidParameterException: As `requirements_of`.
    """
    place, requirements = _placed_requirements(request)
    return [(f"{place}[{index}].room", room) for index, room in rooms_of(requirements)]


def _placed_requirements(request: JobRequest) -> tuple[str, list[JobRequirement]]:
    """Returns the path of the member that has a request's requirements, and the requirements; empty if there are none.

    Raises InvalidParameterException if a launch variable has no valid requirements, or others than the member.
    """
    place, requirements = given_once(request, "requirements", REQUIREMENTS_VARIABLE, parse_requirements)
    return place, requirements or []


def wrong_requirements(request: JobRequest) -> Iterator[str]:
    """Yields requirements of a request that can never be judged, as far as the request alone shows it.

    Reasons are: the launch variable is misspelt or invalid, a room is requested without a world, a goal is at the
    robot's start, a requirement is to be off that `indoor-navigation` has not, topics are requested in trials, or all
    applications are programs without recorded topics.
    """
    for place, name in _misspelt(request):
        yield f"{place}.{name} is not known; did you mean {REQUIREMENTS_VARIABLE}? The job would be judged without it"
    try:
        place, requirements = _placed_requirements(request)
    except InvalidParameterException as error:
        yield from str(error).splitlines()
        return
    if requirements and _has_only_programs(request) and not _records_topics(request):
        yield (
            f"{place}: they would not be judged, since the job has only programs; record their ROS topics "
            "(loggingConfig: {recordAllRosTopics: true}), by which they are judged then, name a simulation application "
            "that makes an environment, or let the program write its verdict to result.json"
        )
    if _has_trials(request):
        yield from _judged_by_topics(place, requirements)
    if _starts_on_origin(request):
        for index, member, problem in goals_at_start([each.to_wire() for each in requirements]):
            yield f"{place}[{index}].{member}: {problem}"
        for index, asked in enumerate(requirements):
            if isinstance(asked, OffRequirement) and (problem := asked.unknown_in_rooms()) is not None:
                yield f"{place}[{index}].name: {problem}"
    if not _has_world(request):
        yield from _without_world(place, requirements)


def _has_trials(request: JobRequest) -> bool:
    try:
        return trials_of(request) is not None
    except InvalidParameterException:
        return True  # they are wrong, which `wrong_trials` tells


def _judged_by_topics(place: str, requirements: Sequence[JobRequirement]) -> Iterator[str]:
    """Yields problems of requirements that are judged by recordings, in trials, which have none."""
    for index, asked in enumerate(requirements):
        if asked.by_topics:
            yield (
                f"{place}[{index}] ({asked.kind}) is judged by the recording of a single run, and the job has trials; "
                "order a job for each seed, or leave out the requirement"
            )


def _without_world(place: str, requirements: Sequence[JobRequirement]) -> Iterator[str]:
    """Yields problems of requirements that need a world, in a request without a world."""
    for index, asked in enumerate(requirements):
        if (room := asked.asked_room) is not None:
            said, remedy = f"{place}[{index}].room is {room!r}", f", or {asked.without_world}"
        elif asked.needs_world:
            said, remedy = f"{place}[{index}].kind is {asked.kind!r}, which needs a world", ""
        else:
            continue
        yield f"{said}, but the job names no world; add simulationApplications[0].worldConfigs{remedy}"


def misspelt_requirements(variables: Iterable[str]) -> list[str]:
    """Returns the names of launch variables that look like a misspelling of `ROBOMAKER_REQUIREMENTS`."""
    return [name for name in variables if name != REQUIREMENTS_VARIABLE and _is_meant(name)]


def doubtful_variables(variables: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yields names of launch variables that mean nothing, and are nearly those that set how a run goes.

    Args:
        variables: Names of launch variables. Applications may read others of their own, also with this beginning.

    Yields:
        The name, and the one that may be meant.
    """
    for name in variables:
        if not name.startswith(_BEGINNING) or name in _MEANT or _is_meant(name):
            continue
        if name.startswith(f"{_BEGINNING}REQ"):
            yield name, REQUIREMENTS_VARIABLE
        elif near := [each for each in _MEANT if _likeness(*(_ending(one) for one in (name, each))) >= _NEAR_VARIABLE]:
            yield name, max(near, key=lambda each: _likeness(name, each))


def starts_on_origin(order: Mapping[str, Any]) -> bool:
    """Returns whether a simulation job's robot starts at the origin of its world, as far as the request says it."""
    configs = order.get("simulationApplications")
    first = configs[0] if is_list(configs) and configs else None
    return is_mapping(first) and first.get("application") == _STARTS_ON_ORIGIN


def unknown_room(asked: Sequence[tuple[str, str]], rooms: Sequence[str]) -> str | None:
    """Explains which goal names a room that the world does not have; `None` if all rooms exist.

    Args:
        asked: Rooms with their paths, from `rooms_asked`.
        rooms: Names of the world's rooms.
    """
    for path, room in asked:
        if room not in rooms:
            return f"{path}: {no_such_room(room, rooms)}"
    return None


def no_such_room(room: str, rooms: Sequence[str]) -> str:
    """Makes the error text for a room name that is not in the world: the room that may be meant, and all there are."""
    return f"the world has no room {room!r}{nearest_of(room, rooms, 'its rooms are')}"


def _has_world(request: JobRequest) -> bool:
    return any(config.worldConfigs for config in request.simulationApplications or ())


def _starts_on_origin(request: JobRequest) -> bool:
    return any(config.application == _STARTS_ON_ORIGIN for config in request.simulationApplications or ())


def _has_only_programs(request: JobRequest) -> bool:
    """Returns whether no process steps an environment, as far as the request says it (see `RunPlan.has_episode`)."""
    configs = request.simulationApplications or request.robotApplications or ()
    return bool(configs) and all(is_program(config.launchConfig) for config in configs)


def _records_topics(request: JobRequest) -> bool:
    """Returns whether all ROS topics are recorded, by which a job of programs can be judged."""
    return bool(getattr(getattr(request, "loggingConfig", None), "recordAllRosTopics", None))


def _misspelt(request: JobRequest) -> Iterator[tuple[str, str]]:
    """Yields variables whose names are nearly that of the launch variable, each with its path in the request."""
    for place, launch in launches(request):
        for name in misspelt_requirements(launch.environmentVariables or {}):
            yield f"{place}.environmentVariables", name


def _is_meant(name: str) -> bool:
    if name.startswith(_BEGINNING):
        return _likeness(name.removeprefix(_BEGINNING), REQUIREMENTS_VARIABLE.removeprefix(_BEGINNING)) >= _NEAR
    return _likeness(name, REQUIREMENTS_VARIABLE) >= _NEAR_AS_A_WHOLE


def _ending(name: str) -> str:
    return name.removeprefix(_BEGINNING)


def _likeness(name: str, other: str) -> float:
    return SequenceMatcher(None, name, other).ratio()
