"""Worlds that a specification names as people do: their ARNs are put in place of the names before a run."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from ...schemas.specs.specification import CheckedSpec
from ...schemas.specs.yaml_nodes import ListNode, MappingNode, Node, ScalarNode
from ...schemas.wire.errors import Problem, RobomakerError, SpecError
from ...schemas.wire.request_problems import Location
from .references import find_world
from .service import Service


def with_worlds_found(spec: CheckedSpec, service: Service) -> CheckedSpec:
    """Returns a specification in which all worlds are named by their ARNs, looked up as the command line does.

    Args:
        spec: The specification.
        service: The service, with its catalog.

    Raises:
        SpecError: Names that mean no world, or any of several, with their places.
    """
    return with_world_arns(spec, lambda name: find_world(name, service).arn)


def with_world_arns(spec: CheckedSpec, find: Callable[[str], str]) -> CheckedSpec:
    """Returns a specification in which all worlds are named by their ARNs.

    Args:
        spec: The specification; one that names no world otherwise is returned as it is.
        find: Returns the ARN of the world that a name means, or raises a `RobomakerError` that says what is wrong.

    Raises:
        SpecError: Names that mean no world, or any of several, with their places.
    """
    arns: dict[str, str] = {}
    wrong: dict[str, str] = {}
    for name in dict.fromkeys(each.name for step in spec.steps.values() for each in step.worlds):
        try:
            arns[name] = find(name)
        except RobomakerError as error:
            wrong[name] = str(error)
    if wrong:
        named = (each for step in spec.steps.values() for each in step.worlds if each.name in wrong)
        raise SpecError([Problem(each.place, each.path, wrong[each.name]) for each in named], spec.notes)
    steps = {
        name: replace(
            step,
            input=_replaced(step.input, (), {each.location: arns[each.name] for each in step.worlds}),
            worlds=(),
        )
        if step.worlds
        else step
        for name, step in spec.steps.items()
    }
    return replace(spec, steps=steps) if arns else spec


def _replaced(node: Node, location: Location, texts: Mapping[Location, str]) -> Node:
    """Returns a node with other texts at some locations."""
    if isinstance(node, MappingNode):
        return replace(
            node, entries={key: _replaced(each, (*location, key), texts) for key, each in node.entries.items()}
        )
    if isinstance(node, ListNode):
        return replace(
            node, items=tuple(_replaced(each, (*location, index), texts) for index, each in enumerate(node.items))
        )
    text = texts.get(location)
    return node if text is None else ScalarNode(node.place, text, node.source)
