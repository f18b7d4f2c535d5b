"""How many trials of a batch's jobs have finished, as the catalog has it."""

import time
from collections.abc import Callable, Sequence

from ...schemas.documents.base import Json
from ...schemas.documents.simulation_jobs import JobTrials
from ...schemas.runs.requested_trials import planned_trials
from ...schemas.runs.trials import TrialCounts
from ..catalog import Catalog, Resource
from .job_folders import KIND

_LOOK_EVERY_S = 2.0


class BatchTrials:
    """The trials of one batch.

    Args:
        batch: ARN of the batch.
        requests: the requests of its jobs, in order.
        catalog: where the jobs are, and how many of their trials have finished.
        clock: seconds on a clock that only runs forward.
    """

    def __init__(
        self, batch: str, requests: Sequence[Json], catalog: Catalog, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._batch, self._catalog, self._clock = batch, catalog, clock
        self._planned = [planned_trials(request) for request in requests]
        self._total = sum(self._planned)
        self._next_look_s = 0.0
        self.counts = TrialCounts(0, self._total) if self._total else None
        """As they were at the last look; None: no job has trials."""

    def look(self, *, now: bool = False) -> bool:
        """Counts again, if the last time was two seconds ago.

        Args:
            now: counts in any case.

        Returns:
            Whether more have finished.
        """
        if not self._total or (not now and self._clock() < self._next_look_s):
            return False
        self._next_look_s = self._clock() + _LOOK_EVERY_S
        before, self.counts = self.counts, TrialCounts(self._finished(), self._total)
        return self.counts != before

    def _finished(self) -> int:
        page = self._catalog.list(
            KIND, filters={"parent": [self._batch]}, limit=len(self._planned), members=JobTrials.members()
        )
        return sum(map(self._finished_of, page.resources))

    def _finished_of(self, job: Resource) -> int:
        told = JobTrials.of_members(job)
        planned = 0 if told.request_index is None else self._planned[told.request_index]
        # A job is asked now and then, so the last number of one that has ended well is mostly too small.
        return planned if job.status == "Completed" else min(planned, told.trials_finished or 0)
