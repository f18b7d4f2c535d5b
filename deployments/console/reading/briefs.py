"""Cache of batch summaries for lists: a batch holds all its requests, and reading a few members takes milliseconds."""

from collections.abc import Iterable, Sequence

from ....schemas.documents.simulation_job_batches import BatchInBrief
from ....tasks.catalog import Catalog, Resource

_MOST_KEPT = 5_000


class BatchBriefs:
    """Briefs of batches by ARN, good until the batch changes.

    Args:
        catalog: where the batches are.
    """

    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog
        self._kept: dict[str, tuple[int, BatchInBrief]] = {}

    def of(self, batches: Iterable[Resource]) -> Sequence[tuple[Resource, BatchInBrief]]:
        """Each batch, of whose document nothing has to be read, with its brief; one that is gone is left out."""
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
        while len(self._kept) > _MOST_KEPT:
            self._kept.pop(next(iter(self._kept)), None)
