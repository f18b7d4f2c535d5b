"""Problems of goals that can never be reached or never be missed, as far as the specification shows it.

This is possible if the world comes from a template whose body is in the file: the rooms are known, and often the room
in which robots start.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ...operations.world_generation_jobs import too_many_worlds
from ...runs.requirement_kinds.goal import goals_at_start
from ...runs.requirements import no_such_room, starts_on_origin
from ...templates.body import TemplateRoom
from ...templates.parsing import parse_template_body
from ...wire.errors import InvalidParameterException, Problem, SpecError
from ...wire.request_problems import Location, path_text
from ..references import ReferenceMistake, parse_template
from ..specification import FOR_EACH, CheckedSpec, CheckedStep, axes_of, for_each_of, variable_of
from ..step_axes import AXES, VALUE
from ..yaml_nodes import ListNode, MappingNode, Node, ScalarNode, child, node_at, plain, value_place

_REQUESTS = "createSimulationJobRequests"
_FARTHEST_M = 1e9
"""Absolute coordinate beyond which a number is no position, and is reported elsewhere."""
_WORLD: Location = ("simulationApplications", 0, "worldConfigs", 0, "world")


@dataclass(frozen=True)
class _Request:
    """Request of a job, as written in the file."""

    node: MappingNode
    location: Location
    sources: Mapping[str, Node]
    """Source of the values of each variable, as written in the file."""


@dataclass(frozen=True)
class _Rooms:
    """Rooms of each world of a template."""

    names: Sequence[str]
    start: str | None = None
    """Name of the room in which robots start; `None`: unknown."""


def room_problems(steps: Mapping[str, CheckedStep]) -> Iterator[Problem]:
    """Yields problems of goals in rooms that no world of the template has, or in the room where robots start.

    Args:
        steps: Steps, whose inputs may have other problems.
    """
    for step in steps.values():
        for request in _requests(step):
            asked = dict(_asked(request))
            rooms = _rooms(request, steps) if asked and _is_sound(request) else None
            if rooms is None:
                continue
            names, start = rooms.names, rooms.start
            wrong = {at: no_such_room(str(node.value), names) for at, node in asked.items() if node.value not in names}
            if start is not None:
                wrong |= _reached_at_start(request, start)
            for location, words in wrong.items():
                yield Problem(asked[location].place, path_text((*step.location, *request.location, *location)), words)


def start_room(rooms: Sequence[TemplateRoom]) -> str | None:
    """Returns the room in which robots start in every world of a template; `None` if that depends on the floor plan.

    The origin of a floor plan is in its largest living room or hallway; a living room is always wide enough.
    """
    public = [room for room in rooms if room.Type in ("Living", "Hallway")]
    if len(rooms) == 1 or (len(public) == 1 and public[0].Type == "Living"):
        return (public or rooms)[0].Name
    return None


def _requests(step: CheckedStep) -> Iterator[_Request]:
    if step.operation == "CreateSimulationJob" and isinstance(step.input, MappingNode):
        yield _Request(step.input, (), {})
    requests = child(step.input, _REQUESTS) if step.operation == "StartSimulationJobBatch" else None
    if requests is not None and (construct := for_each_of(requests)) is not None:
        made = child(construct, "value")
        if isinstance(made, MappingNode):
            yield _Request(made, (_REQUESTS, "value"), {variable_of(construct): construct.entries[FOR_EACH]})
    elif requests is not None and (construct := axes_of(requests)) is not None:
        made, axes = child(construct, VALUE), child(construct, AXES)
        named = axes.entries.items() if isinstance(axes, MappingNode) else ()
        sources = {name: values for name, axis in named if (values := child(axis, "values")) is not None}
        if isinstance(made, MappingNode):
            yield _Request(made, (_REQUESTS, VALUE), sources)
    elif isinstance(requests, ListNode):
        for index, item in enumerate(requests.items):
            if isinstance(item, MappingNode):
                yield _Request(item, (_REQUESTS, index), {})


def _asked(request: _Request) -> Iterator[tuple[Location, ScalarNode]]:
    """Yields the rooms that goals name, each with its location in the request."""
    requirements = child(request.node, "requirements")
    for index, item in enumerate(requirements.items if isinstance(requirements, ListNode) else []):
        room = child(item, "room")
        if isinstance(room, ScalarNode) and isinstance(room.value, str) and "${{" not in room.value:
            yield ("requirements", index, "room"), room


def _is_sound(request: _Request) -> bool:
    """Returns whether all names and numbers in a request's requirements are valid; others are reported elsewhere."""
    requirements = child(request.node, "requirements")
    items = requirements.items if isinstance(requirements, ListNode) else ()
    names = (child(item, member) for item in items for member in ("name", "after"))
    numbers = (child(item, member) for item in items for member in ("x", "y", "within_m"))
    return all(
        each is None or (isinstance(each, ScalarNode) and isinstance(each.value, str)) for each in names
    ) and all(each is None or (isinstance(each, ScalarNode) and abs(_number(each)) <= _FARTHEST_M) for each in numbers)


def _number(node: ScalarNode) -> float:
    return node.value if isinstance(node.value, int | float) else 0.0


def _reached_at_start(request: _Request, start: str) -> dict[Location, str]:
    """Returns problems of goals in the room in which the robot starts, by location."""
    requirements = child(request.node, "requirements")
    if requirements is None or not starts_on_origin(plain(request.node)):
        return {}
    found = goals_at_start(plain(requirements), start)
    return {("requirements", index, member): words for index, member, words in found if member == "room"}


def _rooms(request: _Request, steps: Mapping[str, CheckedStep]) -> _Rooms | None:
    """Returns the rooms of the world that a request names; `None` if they cannot be determined from the file."""
    world = node_at(request.node, _WORLD)
    name = _referred(world) or ""
    if name in request.sources:
        name = _referred(request.sources[name]) or ""
    generation = steps.get(name)
    if generation is None or generation.operation != "CreateWorldGenerationJob":
        return None
    template = steps.get(_referred(child(generation.input, "template")) or "")
    if template is None or template.operation != "CreateWorldTemplate":
        return None
    if any(step.operation == "UpdateWorldTemplate" for step in steps.values()):
        return None  # what its body is by then is not asked
    return _rooms_of_body(child(template.input, "templateBody"))


def _rooms_of_body(body: Node | None) -> _Rooms | None:
    if body is None:
        return None
    text = str(body.value) if isinstance(body, ScalarNode) else json.dumps(plain(body))
    if "${{" in text:
        return None
    try:
        rooms = parse_template_body(text).floorplan.Rooms
        return _Rooms([room.Name for room in rooms], start_room(rooms))
    except InvalidParameterException:
        return _rooms_as_written(body)


def _rooms_as_written(body: Node) -> _Rooms | None:
    """Returns the rooms of a template body with other problems; `None` if not all of them are named."""
    rooms = node_at(body, ("Buildings", 0, "Floors", 0, "Floorplan", "Rooms"))
    names = [child(room, "Name") for room in rooms.items] if isinstance(rooms, ListNode) else []
    if not names or not all(isinstance(name, ScalarNode) and isinstance(name.value, str) for name in names):
        return None
    return _Rooms([str(name.value) for name in names if isinstance(name, ScalarNode)])


def _referred(node: Node | None) -> str | None:
    """Returns the single step or variable to which a text refers; `None` otherwise."""
    if not isinstance(node, ScalarNode) or not isinstance(node.value, str):
        return None
    try:
        names = {name for reference in parse_template(node.value).references for name in reference.names()}
    except ReferenceMistake:
        return None
    return names.pop() if len(names) == 1 else None


_COUNT = "worldCount"
_MEMBERS = ("floorplanCount", "interiorCountPerFloorplan")


def check_world_counts(spec: CheckedSpec, most: int) -> None:
    """Raises an error if a generation step asks for more worlds than allowed, as far as known before the run.

    Args:
        spec: The specification.
        most: Maximum number of worlds of one job, see `ROBOMAKER_MAX_WORLDS_PER_JOB`.

    Raises:
        SpecError: A job asks for more.
    """
    if problems := [*world_count_problems(spec.steps, most)]:
        raise SpecError(problems)


def world_count_problems(steps: Mapping[str, CheckedStep], most: int) -> Iterator[Problem]:
    """Finds generation steps that ask for more worlds than allowed, as far as known before the run.

    Args:
        steps: Steps, whose inputs may have other problems.
        most: Maximum number of worlds of one job.
    """
    for step in steps.values():
        if problem := _problem(step, most):
            yield problem


def _problem(step: CheckedStep, most: int) -> Problem | None:
    count = step.input.entries.get(_COUNT) if isinstance(step.input, MappingNode) else None
    if step.operation != "CreateWorldGenerationJob" or not isinstance(count, MappingNode):
        return None
    members = [count.entries.get(member) for member in _MEMBERS]
    floorplans, interiors = (node.value if isinstance(node, ScalarNode) else None for node in members)
    if not isinstance(floorplans, int) or not isinstance(interiors, int):
        return None
    reason = too_many_worlds(floorplans, interiors, most)
    place = value_place(step.input, (_COUNT,))
    return Problem(place, path_text((*step.location, _COUNT)), reason) if reason else None
