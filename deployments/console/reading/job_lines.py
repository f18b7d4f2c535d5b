"""Cache of the job lines of batches: of a thousand jobs only those are read that changed."""

from collections.abc import Mapping

from ....schemas.documents.simulation_jobs import JobInBrief
from ....tasks.catalog import Catalog, Resource
from ..standing import JOB, JobLine, job_line

_MOST_KEPT = 10_000
"""Jobs; each takes some two kilobytes. One batch may have more."""

Known = Mapping[str, tuple[Resource, JobLine]]
"""Each job, of whose document little is read, and its line, by ARN; the oldest first."""


class JobLines:
    """Lines of the jobs of the batches that were looked at last, each good until its job changes.

    Args:
        catalog: where the jobs are.
    """

    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog
        self._kept: dict[str, Known] = {}

    def of(self, batch: str) -> Known:
        """The jobs of a batch; the same object again while none has changed."""
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
