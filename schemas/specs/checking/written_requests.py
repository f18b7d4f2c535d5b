"""Requests for simulation jobs as a specification has them, before `forEach` and axes make the jobs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...wire.request_problems import Location
from ..references import ReferenceMistake, parse_template
from ..specification import FOR_EACH, CheckedStep, axes_of, for_each_of, variable_of
from ..step_axes import AXES, VALUE
from ..yaml_nodes import ListNode, MappingNode, Node, ScalarNode, child, node_at, plain

REQUESTS = "createSimulationJobRequests"
WORLD: Location = ("simulationApplications", 0, "worldConfigs", 0, "world")
"""Location of the world in a request."""

_FARTHEST_M = 1e9
"""Absolute coordinate beyond which a number is no position, and is reported elsewhere."""
_INCLUDE = "include"


@dataclass(frozen=True)
class WrittenRequest:
    """Request of a job, or of all jobs that a `forEach` or axes make, as written in the file."""

    node: MappingNode
    location: Location
    """Keys that lead to it in the step's input."""

    sources: Mapping[str, Sequence[Node]] = field(default_factory=dict[str, Sequence[Node]])
    """Source of the values of each variable: the written values, or the one reference to them."""

    def values(self, at: Location) -> Iterator[tuple[Mapping[str, Any], str]]:
        """Yields the texts that a member of the request has, as far as the file says them.

        Args:
            at: Keys that lead to the member in the request.

        Yields:
            The variables with which the member has the text, by name, and the text.
        """
        node = node_at(self.node, at)
        written = node.value if isinstance(node, ScalarNode) else None
        if not isinstance(written, str):
            return
        name = only_name(written)
        if name is None:
            yield from [({}, written)] if "${{" not in written else ()
            return
        for source in self.sources.get(name, ()):
            scope = {name: plain(source)}
            if isinstance(value := text_with(written, scope), str):
                yield scope, value


def only_name(text: str) -> str | None:
    """Returns the only step or variable to which a text refers; `None`: to none, or to several."""
    try:
        names = {name for reference in parse_template(text).references for name in reference.names()}
    except ReferenceMistake:
        return None
    return names.pop() if len(names) == 1 else None


def text_with(written: str, scope: Mapping[str, Any]) -> Any:
    """Returns the value of a text whose references are to some variables; `None`: it refers to something else.

    Args:
        written: The text, as in the file.
        scope: Values of variables by name, which may be references themselves.
    """
    try:
        value = parse_template(written).value(scope)
    except ReferenceMistake:
        return None
    return None if isinstance(value, str) and "${{" in value else value


def written_requests(step: CheckedStep) -> Iterator[WrittenRequest]:
    """Yields the requests for simulation jobs of a step, whose input may have problems."""
    if step.operation == "CreateSimulationJob" and isinstance(step.input, MappingNode):
        yield WrittenRequest(step.input, ())
    requests = child(step.input, REQUESTS) if step.operation == "StartSimulationJobBatch" else None
    if requests is None:
        return
    if (construct := for_each_of(requests) or axes_of(requests)) is not None:
        made = child(construct, VALUE)
        if isinstance(made, MappingNode):
            yield WrittenRequest(made, (REQUESTS, VALUE), _sources(construct))
    elif isinstance(requests, ListNode):
        for index, item in enumerate(requests.items):
            if isinstance(item, MappingNode):
                yield WrittenRequest(item, (REQUESTS, index))


def _sources(construct: MappingNode) -> dict[str, Sequence[Node]]:
    """Returns the values of the variables of a `forEach` or of axes, those of cells that are included too."""
    if (made := for_each_of(construct)) is not None:
        return {variable_of(made): _listed(made.entries[FOR_EACH])}
    axes, cells = child(construct, AXES), child(construct, _INCLUDE)
    named = axes.entries.items() if isinstance(axes, MappingNode) else ()
    sources = {name: _listed(values) for name, axis in named if (values := child(axis, "values")) is not None}
    for cell in cells.items if isinstance(cells, ListNode) else ():
        for name in sources:
            if (value := child(cell, name)) is not None:
                sources[name] = [*sources[name], value]
    return sources


def _listed(values: Node) -> Sequence[Node]:
    return values.items if isinstance(values, ListNode) else [values]


def is_sound(request: WrittenRequest) -> bool:
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


def asked_rooms(request: WrittenRequest) -> Iterator[tuple[Location, ScalarNode]]:
    """Yields the rooms that requirements name, each with its location in the request."""
    requirements = child(request.node, "requirements")
    for index, item in enumerate(requirements.items if isinstance(requirements, ListNode) else []):
        room = child(item, "room")
        if isinstance(room, ScalarNode) and isinstance(room.value, str):
            yield ("requirements", index, "room"), room
