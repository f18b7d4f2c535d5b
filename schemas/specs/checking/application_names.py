"""Finds possibly misspelt application names in jobs: neither built in, nor created by a step."""

from collections.abc import Iterator, Mapping

from ...runs.recording_sources import RECORDED_RUN
from ...wire.errors import Problem
from ...wire.request_problems import Location, nearest, path_text
from ..specification import CheckedStep, for_each_of
from ..yaml_nodes import ListNode, MappingNode, Node, ScalarNode, child

BUILT_IN: Mapping[str, tuple[str, ...]] = {
    "robot": ("scout", "walker"),
    "simulation": ("indoor-navigation", RECORDED_RUN),
}
"""Names of the built-in applications, by role."""

_MAKERS = {"CreateRobotApplication": "robot", "CreateSimulationApplication": "simulation"}
_OPENING = "${{"


def application_notes(steps: Mapping[str, CheckedStep]) -> Iterator[Problem]:
    """Yields names of applications that only the catalog may know, which is asked when the specification runs.

    Args:
        steps: The steps, whose inputs may have problems.
    """
    known = {kind: [*names] for kind, names in BUILT_IN.items()}
    for step in steps.values():
        if kind := _MAKERS.get(step.operation):
            name = child(step.input, "name")
            known[kind].append(str(name.value) if isinstance(name, ScalarNode) else _OPENING)
    for step in steps.values():
        for location, kind, name in _named(step.input, ()):
            if name.value in known[kind] or any(_OPENING in each for each in known[kind]):
                continue
            words = f"there is no built-in {kind} application {name.value!r}, and no step makes one"
            hint = nearest(str(name.value), known[kind])
            words += f"{hint} If" if hint else "; if"
            words += " it is in the catalog, a run finds it"
            yield Problem(name.place, path_text((*step.location, *location)), words)


def _named(node: Node, location: Location) -> Iterator[tuple[Location, str, ScalarNode]]:
    """Yields the names of applications in a request, each with its location and role."""
    if isinstance(node, ListNode):
        for index, item in enumerate(node.items):
            yield from _named(item, (*location, index))
    if not isinstance(node, MappingNode):
        return
    for key, value in node.entries.items():
        kind = key.removesuffix("Applications")
        if kind == key or kind not in BUILT_IN:
            yield from _named(value, (*location, key))
            continue
        made = for_each_of(value)
        items = value.items if isinstance(value, ListNode) else (child(made, "value"),) if made else ()
        for index, item in enumerate(items):
            name = None if item is None else child(item, "application")
            if isinstance(name, ScalarNode) and isinstance(name.value, str) and _is_name(name.value):
                yield (*location, key, "value" if made else index, "application"), kind, name


def _is_name(text: str) -> bool:
    """Returns whether a text is a plain name, and no ARN or reference."""
    return bool(text) and ":" not in text and _OPENING not in text
