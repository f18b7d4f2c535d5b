"""Cache of the jobs that have a picture of their last moment (`poster.png`)."""

from collections.abc import Callable, Iterable, Mapping

from ....schemas.documents.worlds import StoredPlace
from ..standing import JobLine

_MOST_KEPT = 10_000


class Posters:
    """Remembers outputs with a picture: what is published does not change.

    Args:
        published: finds the names of the files of outputs.
    """

    def __init__(self, published: Callable[[StoredPlace], Mapping[str, int]]) -> None:
        self._published = published
        self._known: dict[tuple[str, str], None] = {}

    def of(self, jobs: Iterable[JobLine]) -> set[str]:
        """Ids of the jobs that have one."""
        return {job.id for job in jobs if job.outputs is not None and self._has_one(job.outputs)}

    def _has_one(self, place: StoredPlace) -> bool:
        key = (place.bucket, place.prefix)
        if key in self._known:
            return True
        if "poster.png" not in self._published(place):
            return False
        while len(self._known) >= _MOST_KEPT:
            self._known.pop(next(iter(self._known)), None)
        self._known[key] = None
        return True
