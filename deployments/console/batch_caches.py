"""Caches for pages of batches: summaries, rows of jobs, pictures; only changed resources are read again."""

from collections.abc import Callable, Iterable, Mapping, Sequence

from ...schemas.documents.simulation_jobs import BatchInBrief, JobInBrief
from ...schemas.documents.worlds import StoredPlace
from ...tasks.catalog import Catalog, Resource
from .job_states import JOB, JobLine, job_line

_MOST_BRIEFS = 5_000


class BatchBriefs:
    """Cache of batch summaries for the web console, each valid until its batch changes.

    Args:
        catalog: The catalog of the batches.
    """

    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog
        self._kept: dict[str, tuple[int, BatchInBrief]] = {}

    def of(self, batches: Iterable[Resource]) -> Sequence[tuple[Resource, BatchInBrief]]:
        """Returns the summaries of batches; deleted ones are left out."""
        listed = list(batches)
        unknown = [each.arn for each in listed if self._kept.get(each.arn, (0,))[0] != each.revision]
        if unknown:
            self._read(unknown)
        # A look of another visitor may have dropped one meanwhile.
        found = ((each, self._kept.get(each.arn)) for each in listed)
        return [(each, kept[1]) for each, kept in found if kept is not None]

    def _read(self, arns: Sequence[str]) -> None:
        for arn, batch in self._catalog.get_many(arns, BatchInBrief.members()).items():
            self._kept.pop(arn, None)
            self._kept[arn] = (batch.revision, BatchInBrief.of(batch))
        while len(self._kept) > _MOST_BRIEFS:
            self._kept.pop(next(iter(self._kept)), None)


_MOST_KEPT = 10_000
"""Limit of cached jobs, of some two kilobytes each. One batch may have more."""

Known = Mapping[str, tuple[Resource, JobLine]]
"""Job (with few members of its document) and its row, by ARN; the oldest first."""


class JobLines:
    """Cache of a batch's job rows for the web console, each valid until its job changes.

    Args:
        catalog: The catalog of the jobs.
    """

    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog
        self._kept: dict[str, Known] = {}

    def of(self, batch: str) -> Known:
        """Returns the job rows of a batch, by the jobs' ARNs, and reads only jobs that changed since the last call.

        If no job has changed, the very object of the last call is returned, so that `is` tells it.
        """
        revisions = self._catalog.child_revisions(batch, JOB)
        kept = self._kept.get(batch, {})
        changed = [arn for arn, revision in revisions.items() if arn not in kept or kept[arn][0].revision != revision]
        if kept and not changed and len(kept) == len(revisions):
            return kept
        read = self._catalog.get_many(changed, JobInBrief.members())
        fresh = {arn: (job, job_line(job)) for arn, job in read.items()}
        lines = {arn: known for arn in revisions if (known := fresh.get(arn) or kept.get(arn)) is not None}
        self._keep(batch, lines)
        return lines

    def _keep(self, batch: str, lines: Known) -> None:
        self._kept.pop(batch, None)
        self._kept[batch] = lines  # the last to go
        while len(self._kept) > 1 and sum(map(len, list(self._kept.values()))) > _MOST_KEPT:
            self._kept.pop(next(iter(self._kept)), None)


_MOST_POSTERS = 10_000


class Posters:
    """Cache of which jobs have a poster picture in their outputs.

    Args:
        published: Finds the names of the files of outputs.
    """

    def __init__(self, published: Callable[[StoredPlace], Mapping[str, int]]) -> None:
        self._published = published
        self._known: dict[tuple[str, str], None] = {}

    def of(self, jobs: Iterable[JobLine]) -> set[str]:
        """Returns the ids of the jobs that have a poster picture."""
        return {job.id for job in jobs if job.outputs is not None and self._has_one(job.outputs)}

    def _has_one(self, place: StoredPlace) -> bool:
        key = (place.bucket, place.prefix)
        if key in self._known:
            return True
        if "poster.png" not in self._published(place):
            return False
        while len(self._known) >= _MOST_POSTERS:
            self._known.pop(next(iter(self._known)), None)
        self._known[key] = None
        return True
