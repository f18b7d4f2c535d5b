"""A step's request during a run: references become values, `forEach` a list, and template bodies JSON text."""

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NoReturn

from pydantic import ValidationError

from ..operations.registry import STEPS
from ..runs.trial_designs import Cells
from ..wire.errors import Place, Problem, SpecError
from ..wire.json_values import is_list, is_object
from ..wire.request_problems import Location, path_text, problems_of
from .batch_splitting import Part, parts_of
from .references import PARAMETERS, ReferenceMistake, parse_template
from .specification import FOR_EACH, INDEX, CheckedStep, axes_of, for_each_of, place_of, variable_of
from .step_axes import VALUE, axes_problems, cells_of, clashing_axes, clashing_words, job_of_cell, points_seed
from .yaml_nodes import ListNode, MappingNode, Node, child, key_place, plain, value_place

_REQUESTS = "createSimulationJobRequests"


def resolve_input(step: CheckedStep, outputs: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Makes a step's final request: replaces references, expands `forEach`, converts template bodies to JSON text.

    One that is for more jobs than a batch may have is run in parts, see `parts_of`.

    Args:
        step: A checked step.
        outputs: Output of each step that it needs, by step name.

    Raises:
        SpecError: A reference gives nothing or something that does not fit, with its place.
    """
    scope = {**outputs, PARAMETERS: step.parameters} if step.parameters else outputs
    resolved: dict[str, Any] = _resolve(step.input, scope, step.location)
    body = resolved.get("templateBody")
    if isinstance(body, dict):
        resolved["templateBody"] = json.dumps(body, ensure_ascii=False)
    for part in parts_of(step.operation, resolved):
        _check(part, step)
    return resolved


def _check(part: Part, step: CheckedStep) -> None:
    model = STEPS[step.operation].request
    try:
        model.model_validate(part.request)
    except ValidationError as error:
        problems = [replace(problem, location=part.location(problem.location)) for problem in problems_of(error, model)]
        raise SpecError(
            [
                Problem(
                    place_of(problem, step.input, step.place),
                    path_text((*step.location, *problem.location)),
                    problem.message,
                )
                for problem in problems
            ]
        ) from error


def _resolve(node: Node, scope: Mapping[str, Any], location: Location) -> Any:
    if construct := for_each_of(node):
        return _resolve_for_each(construct, scope, location)
    if location[-1:] == (_REQUESTS,) and (construct := axes_of(node)):
        return _resolve_axes(construct, scope, location)
    if isinstance(node, MappingNode):
        return {key: _resolve(value, scope, (*location, key)) for key, value in node.entries.items()}
    if isinstance(node, ListNode):
        return [_resolve(item, scope, (*location, position)) for position, item in enumerate(node.items)]
    if not isinstance(node.value, str):
        return node.value
    try:
        return parse_template(node.value).value(scope)
    except ReferenceMistake as mistake:
        _fail(node.place, location, str(mistake))


def _resolve_for_each(construct: MappingNode, scope: Mapping[str, Any], location: Location) -> list[Any]:
    source = construct.entries[FOR_EACH]
    entries = _resolve(source, scope, (*location, FOR_EACH))
    if not is_list(entries):
        _fail(source.place, (*location, FOR_EACH), f"is {str(entries)[:80]!r}; it has to be a list")
    variable, value = variable_of(construct), construct.entries["value"]
    return [
        _resolve(value, {**scope, variable: entry, INDEX: index}, (*location, "value"))
        for index, entry in enumerate(entries)
    ]


def _resolve_axes(construct: MappingNode, scope: Mapping[str, Any], location: Location) -> list[Any]:
    """Makes the job requests of all cells (combinations of the axes' values), for each cell one of each seed.

    Raises SpecError if the value is no mapping, or if its own trials vary one of the axes.
    """
    cells = written_cells(construct, scope, location)
    value = construct.entries[VALUE]
    seed = child(value, "seed")
    requests: list[dict[str, Any]] = []
    for cell, repeats in cells_of(cells, points_seed(plain(seed) if seed else None)):
        request = _resolve(value, {**scope, **cell}, (*location, VALUE))
        if not is_object(request):
            _fail(value.place, (*location, VALUE), f"is {str(request)[:80]!r}; it has to be a mapping")
        if clashing := clashing_axes(cell, request):
            _fail(value.place, (*location, VALUE, "trials", "axes", clashing[0]), clashing_words(clashing[0]))
        first = repeats * cells.seeds
        requests += [job_of_cell(request, cell, number) for number in range(first, first + cells.seeds)]
    return requests


def written_cells(construct: MappingNode, scope: Mapping[str, Any], location: Location = ()) -> Cells:
    """Returns the cells that axes of a step have.

    Args:
        construct: The axes, as they are written.
        scope: What references give.
        location: Where they are in the file.

    Raises:
        SpecError: A reference gives nothing, or something that does not fit.
    """
    written = {key: _resolve(node, scope, (*location, key)) for key, node in construct.entries.items() if key != VALUE}
    cells, problems = axes_problems(written)
    if cells is None:
        raise SpecError(
            [
                Problem(
                    (key_place if each.about_key else value_place)(construct, each.location),
                    path_text((*location, *each.location)),
                    each.message,
                )
                for each in problems
            ]
        )
    return cells


def _fail(place: Place, location: Location, message: str) -> NoReturn:
    raise SpecError([Problem(place, path_text(location), message)])
