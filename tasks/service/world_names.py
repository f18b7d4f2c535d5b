"""Worlds that a specification names as people do: their ARNs replace the names before a run."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from ...schemas.specs.specification import CheckedSpec, CheckedStep
from ...schemas.specs.yaml_nodes import ListNode, MappingNode, Node, ScalarNode
from ...schemas.wire.errors import (
    ConfigurationError,
    InvalidParameterException,
    Problem,
    ResourceNotFoundException,
    SpecError,
)
from ...schemas.wire.operation_shape import CHANGES
from ...schemas.wire.request_problems import Location
from .references import find_only_world, find_world
from .service import Service


def with_worlds_found(
    spec: CheckedSpec, service: Service, tell: Callable[[str, str], None] = lambda _name, _arn: None
) -> CheckedSpec:
    """Returns a specification in which all worlds are named by their ARNs, looked up as the command line does.

    Args:
        spec: The specification.
        service: The service, with its catalog.
        tell: Called with each name and the ARN of the world that it means, once all are known.

    Raises:
        SpecError: Names that mean no world, or any of several, with their places. For steps that change or delete
            worlds, a name means several also where these are the same to the letter.
    """
    return with_world_arns(
        spec, lambda name: find_world(name, service).arn, lambda name: find_only_world(name, service).arn, tell
    )


def with_world_arns(
    spec: CheckedSpec,
    find: Callable[[str], str],
    find_only: Callable[[str], str],
    tell: Callable[[str, str], None] = lambda _name, _arn: None,
) -> CheckedSpec:
    """Returns a specification in which all worlds are named by their ARNs; it records which name became which ARN.

    Args:
        spec: The specification; one that names no world otherwise is returned as it is.
        find: Returns the ARN of the world that a name means, or raises a `RobomakerError` that says what is wrong.
        find_only: Does the same for steps that change or delete worlds.
        tell: Called with each name and the ARN of the world that it means, once all are known.

    Raises:
        SpecError: Names that mean no world, or any of several, with their places.
    """
    arns: dict[tuple[str, bool], str] = {}
    wrong: dict[tuple[str, bool], str] = {}
    named = [(each, step.operation.startswith(CHANGES)) for step in spec.steps.values() for each in step.worlds]
    for name, is_changed in dict.fromkeys((each.name, is_changed) for each, is_changed in named):
        try:
            arns[name, is_changed] = (find_only if is_changed else find)(name)
        except (ConfigurationError, InvalidParameterException, ResourceNotFoundException) as error:
            wrong[name, is_changed] = str(error)
    if wrong:
        problems = [
            Problem(each.place, each.path, wrong[key])
            for each, is_changed in named
            if (key := (each.name, is_changed)) in wrong
        ]
        raise SpecError(problems, spec.notes)
    for name, arn in dict.fromkeys((name, arn) for (name, _), arn in arns.items()):
        tell(name, arn)
    return _with_arns(spec, arns)


def with_known_worlds(spec: CheckedSpec, arns: Mapping[str, str]) -> CheckedSpec:
    """Returns a specification with the worlds that were found before, so that a resumed run keeps its worlds.

    Args:
        spec: The specification; names that are not known stay.
        arns: ARNs of the worlds by name, from the run's record.
    """
    return _with_arns(spec, {(name, is_changed): arn for name, arn in arns.items() for is_changed in (False, True)})


def _with_arns(spec: CheckedSpec, arns: Mapping[tuple[str, bool], str]) -> CheckedSpec:
    if not arns:
        return spec
    steps = {name: _step_with_arns(step, arns) if step.worlds else step for name, step in spec.steps.items()}
    # What changes worlds finds the same one or is refused, so that a name has one ARN.
    found = {name: arn for (name, _), arn in arns.items()}
    return replace(spec, steps=steps, found_worlds={**spec.found_worlds, **found})


def _step_with_arns(step: CheckedStep, arns: Mapping[tuple[str, bool], str]) -> CheckedStep:
    is_changed = step.operation.startswith(CHANGES)
    texts = {each.location: arns[key] for each in step.worlds if (key := (each.name, is_changed)) in arns}
    unknown = tuple(each for each in step.worlds if each.location not in texts)
    return replace(step, input=_replaced(step.input, (), texts), worlds=unknown)


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
