"""Request of a step during a run: references become values, and too large batches are divided into several parts."""

import hashlib
import json
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, NoReturn

from pydantic import ValidationError

from ..operations.registry import STEPS
from ..runs.trial_designs import Cells
from ..runs.trials import TrialCounts, planned_trials
from ..wire.errors import Place, Problem, SpecError
from ..wire.json_values import is_list, is_object
from ..wire.request_problems import Location, path_text, problems_of
from .model import FOR_EACH, INDEX, CheckedStep, axes_of, for_each_of, place_of, variable_of
from .references import PARAMETERS, ReferenceMistake, parse_template
from .step_axes import VALUE, axes_problems, cells_of, clashing_axes, clashing_words, job_of_cell, points_seed
from .text import ListNode, MappingNode, Node, child, key_place, plain, value_place

_OPERATION = "StartSimulationJobBatch"
_REQUESTS = "createSimulationJobRequests"
_CLIENT_TOKEN = "clientRequestToken"  # noqa: S105 - a member's name
_LISTS = frozenset({"createdRequests", "failedRequests", "pendingRequests"})
MOST_REQUESTS = 1000
"""Maximum number of requests in one batch."""


class Part(NamedTuple):
    """The part of a step that is sent as one request: the whole step, or one of the batches it is split into."""

    request: dict[str, Any]
    number: int = 1
    """Number of the part in its step, from 1."""

    of: int = 1
    """Number of parts of the step."""

    total: int = 0
    """Number of requests of the whole step; 0: the step is not divided."""

    trials: int = 0
    """Number of trials of all those requests; 0: none, or the step is not divided."""

    def name(self, step: str) -> str:
        """Returns the part's name: the step's, or `simulate_2_of_3` for a part of a divided step."""
        return step if self.of == 1 else f"{step}_{self.number}_of_{self.of}"

    def location(self, inside: Location) -> Location:
        """Converts a location in this part's request to the location in the whole step's request."""
        if len(inside) > 1 and inside[0] == _REQUESTS and isinstance(place := inside[1], int):
            return (_REQUESTS, place + (self.number - 1) * MOST_REQUESTS, *inside[2:])
        return inside


def with_client_token(operation: str, request: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Adds a client token to a part's request, if the operation has one, so that the request can be repeated safely.

    Args:
        operation: Operation of the step.
        request: Request of the part; a token in it is kept.
        place: Text that is unique for this part in all runs.
    """
    if _CLIENT_TOKEN not in STEPS[operation].request.model_fields:
        return dict(request)
    return {_CLIENT_TOKEN: hashlib.sha256(place.encode()).hexdigest(), **request}


def step_of(part: str) -> str:
    """Returns the step that a part's name belongs to; a step that is not divided has one part of its own name."""
    return re.sub(r"_\d+_of_\d+$", "", part)


def parts_of(operation: str, request: Mapping[str, Any]) -> list[Part]:
    """Splits a step's request into several batches if it has more jobs than one batch may have.

    Args:
        operation: Operation of the step.
        request: Resolved request, not yet checked.

    Returns:
        The parts, in order; each job request is in one of them.
    """
    requests = request.get(_REQUESTS)
    if operation != _OPERATION or not is_list(requests) or len(requests) <= MOST_REQUESTS:
        return [Part(dict(request))]
    starts = range(0, len(requests), MOST_REQUESTS)
    parts: list[Part] = []
    trials = sum(planned_trials(each) for each in requests if is_object(each))
    for number, start in enumerate(starts, 1):
        members: dict[str, Any] = {**request, _REQUESTS: requests[start : start + MOST_REQUESTS]}
        if isinstance(token := request.get(_CLIENT_TOKEN), str) and number > 1:  # each batch is a request of its own
            members[_CLIENT_TOKEN] = hashlib.sha256(f"{token}/{number}".encode()).hexdigest()
        parts.append(Part(members, number, len(starts), len(requests), trials))
    return parts


@dataclass(frozen=True)
class EarlierParts:
    """Combined results of the finished parts of a step that is divided into several batches."""

    output: dict[str, Any] = field(default_factory=dict[str, Any])
    """Combined response for references: the jobs of all finished batches, under the ARN of the last."""

    counts: Mapping[str, int] = field(default_factory=dict[str, int])
    """Number of requests by state, of the batches that have ended."""

    trials_finished: int = 0
    """Number of finished trials of their jobs."""

    def followed_by(
        self, output: Mapping[str, Any], counts: Mapping[str, int], trials: TrialCounts | None = None
    ) -> "EarlierParts":
        """Returns these combined results with those of one more finished part added.

        Args:
            output: Final description of the finished part.
            counts: Number of its requests by state.
            trials: Trial counts of its jobs at its end; None: there were none.
        """
        lists = {
            name: [*self.output.get(name, []), *entries]
            for name, entries in output.items()
            if name in _LISTS and is_list(entries)
        }
        return EarlierParts({**output, **lists}, self.with_counts(counts), self._finished(trials))

    def with_counts(self, counts: Mapping[str, int]) -> dict[str, int]:
        """Adds the job counts of the running part to those of the finished parts."""
        return dict(Counter(self.counts) + Counter(counts))

    def with_trials(self, trials: TrialCounts | None, total: int) -> TrialCounts | None:
        """Adds the trial counts of the running part to those of the finished parts; `None` if there are no trials.

        Args:
            trials: Trial counts of the running part.
            total: Number of trials of the whole step; 0: not divided, or none.
        """
        return TrialCounts(self._finished(trials), total) if total else trials

    def _finished(self, trials: TrialCounts | None) -> int:
        return self.trials_finished + (trials.finished if trials else 0)


def resolve_input(step: CheckedStep, outputs: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Makes a step's final request: replaces references, expands `forEach`, converts template bodies to JSON text.

    One that is for more jobs than a batch may have is run in parts, see `parts_of`.

    Args:
        step: a checked step.
        outputs: Output of each step that it needs, by step name.

    Raises:
        SpecError: a reference gives nothing or something that does not fit, with its place.
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
    """The job requests of all cells: those of one cell after each other, with one seed after the other."""
    cells = written_cells(construct, scope, location)
    value = construct.entries[VALUE]
    seed = child(value, "seed")
    requests: list[dict[str, Any]] = []
    for cell in cells_of(cells, points_seed(plain(seed) if seed else None)):
        request = _resolve(value, {**scope, **cell}, (*location, VALUE))
        if not is_object(request):
            _fail(value.place, (*location, VALUE), f"is {str(request)[:80]!r}; it has to be a mapping")
        if clashing := clashing_axes(cell, request):
            _fail(value.place, (*location, VALUE, "trials", "axes", clashing[0]), clashing_words(clashing[0]))
        requests += [job_of_cell(request, cell, number) for number in range(cells.seeds)]
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
