"""Goals of a specification's jobs in rooms that their worlds will not have, as far as the file itself says it.

It does where the world comes from a template whose body is written out: its rooms are those of its worlds.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ..runs.requested_requirements import no_such_room
from ..templates.parsing import parse_template_body
from ..wire.errors import InvalidParameterException, Problem
from .model import FOR_EACH, CheckedStep, for_each_of, variable_of
from .references import ReferenceMistake, parse_template
from .text import ListNode, Location, MappingNode, Node, ScalarNode, child, path_text, plain

_REQUESTS = "createSimulationJobRequests"
_WORLD: Location = ("simulationApplications", 0, "worldConfigs", 0, "world")


@dataclass(frozen=True)
class _Request:
    """The request for a job, as it is written."""

    node: MappingNode
    location: Location
    sources: Mapping[str, Node]
    """What a variable goes through."""


def room_problems(steps: Mapping[str, CheckedStep]) -> Iterator[Problem]:
    """Finds goals in rooms that no world of the template has.

    Args:
        steps: the steps, whose inputs have no other problems.
    """
    for step in steps.values():
        for request in _requests(step):
            asked = list(_asked(request))
            rooms = _rooms(request, steps) if asked else None
            for location, node in asked:
                if rooms is not None and str(node.value) not in rooms:
                    path = path_text((*step.location, *request.location, *location))
                    yield Problem(node.place, path, no_such_room(str(node.value), rooms))


def _requests(step: CheckedStep) -> Iterator[_Request]:
    if step.operation == "CreateSimulationJob" and isinstance(step.input, MappingNode):
        yield _Request(step.input, (), {})
    requests = child(step.input, _REQUESTS) if step.operation == "StartSimulationJobBatch" else None
    if requests is not None and (construct := for_each_of(requests)) is not None:
        made = child(construct, "value")
        if isinstance(made, MappingNode):
            yield _Request(made, (_REQUESTS, "value"), {variable_of(construct): construct.entries[FOR_EACH]})
    elif isinstance(requests, ListNode):
        for index, item in enumerate(requests.items):
            if isinstance(item, MappingNode):
                yield _Request(item, (_REQUESTS, index), {})


def _asked(request: _Request) -> Iterator[tuple[Location, ScalarNode]]:
    """Where goals name rooms."""
    requirements = child(request.node, "requirements")
    for index, item in enumerate(requirements.items if isinstance(requirements, ListNode) else []):
        room = child(item, "room")
        if isinstance(room, ScalarNode) and isinstance(room.value, str) and "${{" not in room.value:
            yield ("requirements", index, "room"), room


def _rooms(request: _Request, steps: Mapping[str, CheckedStep]) -> list[str] | None:
    """The rooms of the world that a request names; `None` if the file does not say."""
    world = _below(request.node, _WORLD)
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


def _rooms_of_body(body: Node | None) -> list[str] | None:
    if body is None:
        return None
    text = str(body.value) if isinstance(body, ScalarNode) else json.dumps(plain(body))
    try:
        return None if "${{" in text else [room.Name for room in parse_template_body(text).floorplan.Rooms]
    except InvalidParameterException:
        return None


def _referred(node: Node | None) -> str | None:
    """The one step or variable that a text refers to."""
    if not isinstance(node, ScalarNode) or not isinstance(node.value, str):
        return None
    try:
        names = {name for reference in parse_template(node.value).references for name in reference.names()}
    except ReferenceMistake:
        return None
    return names.pop() if len(names) == 1 else None


def _below(node: Node | None, location: Location) -> Node | None:
    for key in location:
        node = child(node, key) if node is not None else None
    return node
