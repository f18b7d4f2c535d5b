"""Splitting of a batch with more than 1,000 requests into several batches, and their combined results."""

import hashlib
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from ..operations.registry import STEPS
from ..runs.trials import TrialCounts, planned_trials
from ..wire.json_values import is_list, is_object
from ..wire.request_problems import Location

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
        """Returns the job counts of the running part added to those of the finished parts."""
        return dict(Counter(self.counts) + Counter(counts))

    def with_trials(self, trials: TrialCounts | None, total: int) -> TrialCounts | None:
        """Adds the trial counts of the running part to those of the finished parts; `None` if there are no trials.

        Args:
            trials: Trial counts of the running part.
            total: Number of trials of the whole step; 0: not divided, or none.
        """
        if not total:
            return trials
        return replace(trials or TrialCounts(0, 0), finished=self._finished(trials), total=total)

    def _finished(self, trials: TrialCounts | None) -> int:
        return self.trials_finished + (trials.finished if trials else 0)
