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
from ..specification import CheckedSpec, CheckedStep
from ..yaml_nodes import ListNode, MappingNode, Node, ScalarNode, child, node_at, plain, value_place
from .written_requests import WORLD, WrittenRequest, asked_rooms, is_sound, only_name, written_requests


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
        for request in written_requests(step):
            asked = {at: node for at, node in asked_rooms(request) if "${{" not in str(node.value)}
            wrong: dict[Location, str] = {}
            for rooms in _rooms(request, steps) if asked and is_sound(request) else ():
                names = rooms.names
                wrong |= {
                    at: no_such_room(str(node.value), names) for at, node in asked.items() if node.value not in names
                }
                wrong |= {} if rooms.start is None else _reached_at_start(request, rooms.start)
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


def _reached_at_start(request: WrittenRequest, start: str) -> dict[Location, str]:
    """Returns problems of goals in the room in which the robot starts, by location."""
    requirements = child(request.node, "requirements")
    if requirements is None or not starts_on_origin(plain(request.node)):
        return {}
    found = goals_at_start(plain(requirements), start)
    return {("requirements", index, member): words for index, member, words in found if member == "room"}


def _rooms(request: WrittenRequest, steps: Mapping[str, CheckedStep]) -> Iterator[_Rooms]:
    """Yields the rooms of the worlds that a request names, of each template that is written in the file."""
    world = node_at(request.node, WORLD)
    name = _referred(world)
    sources = request.sources.get(name or "", () if world is None else (world,))
    for generated in dict.fromkeys(map(_referred, sources)):
        generation = steps.get(generated or "")
        if generation is None or generation.operation != "CreateWorldGenerationJob":
            continue
        template = steps.get(_referred(child(generation.input, "template")) or "")
        if template is None or template.operation != "CreateWorldTemplate":
            continue
        if any(step.operation == "UpdateWorldTemplate" for step in steps.values()):
            continue  # what its body is by then is not asked
        if (rooms := _rooms_of_body(child(template.input, "templateBody"))) is not None:
            yield rooms


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
    """Returns the rooms of a template body with other problems; `None` if not each of them has a name of its own."""
    rooms = node_at(body, ("Buildings", 0, "Floors", 0, "Floorplan", "Rooms"))
    names = [child(room, "Name") for room in rooms.items] if isinstance(rooms, ListNode) else []
    if not names or not all(isinstance(name, ScalarNode) and isinstance(name.value, str) for name in names):
        return None
    known = [str(name.value) for name in names if isinstance(name, ScalarNode)]
    return _Rooms(known) if len({*known}) == len(known) else None


def _referred(node: Node | None) -> str | None:
    written = node.value if isinstance(node, ScalarNode) else None
    return only_name(written) if isinstance(written, str) else None


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
