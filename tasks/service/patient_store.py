"""An object store that waits while the one behind it is away."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal

from ..storage import ObjectInfo, ObjectStore, split_stored
from ..storage.base import Result, Stopped, StoreOver, Tell, never, tell_none
from .patience import Patience


class PatientStore(StoreOver):
    """An `ObjectStore` whose calls outlast that the store behind it does not answer, or is full.

    Of files that are stored together, only those are stored again that did not arrive.

    Args:
        store: the store behind it.
        patience: how long it is waited for.
    """

    def __init__(self, store: ObjectStore, patience: Patience) -> None:
        super().__init__(store)
        self.patience = patience

    def over(self, store: ObjectStore) -> "PatientStore":
        """Another store, with the same patience."""
        return PatientStore(store, self.patience)

    def do(
        self, access: Literal["read", "write"], bucket: str, keys: Iterable[str], call: Callable[[], Result]
    ) -> Result:
        """Calls the store behind this one, again until that answers; see `Patience.ask`."""
        del access, keys
        return self.patience.ask(call, lambda: self.behind.probe(bucket))

    def put_files(
        self, bucket: str, files: dict[str, Path], *, stopped: Stopped = never, tell: Tell = tell_none
    ) -> list[ObjectInfo]:
        """See `ObjectStore`."""
        stored: dict[str, ObjectInfo] = {}
        tries = 0

        def put() -> list[ObjectInfo]:
            nonlocal tries
            tries += 1
            left = files
            if tries > 1:
                there, left = split_stored(self.behind, bucket, files, stopped)
                stored.update(there)
                for key in there:
                    tell(key)
            infos = dict(zip(left, self.behind.put_files(bucket, left, stopped=stopped, tell=tell), strict=True))
            return [infos.get(key) or stored[key] for key in files]

        return self.do("write", bucket, files, put)


def at_once(store: ObjectStore) -> ObjectStore:
    """The same store without patience: for what must not be held for long, such as a lock that others wait for."""
    return store.behind if isinstance(store, PatientStore) else store


def patiently(store: ObjectStore, bucket: str, call: Callable[[], Result]) -> Result:
    """Does something that uses `at_once(store)`, with the patience that the store has; see `Patience.ask`.

    Args:
        store: the store, patient or not.
        bucket: which bucket it is about.
        call: what to do; safe to do again after half of it was done.
    """
    return store.do("write", bucket, (), call) if isinstance(store, PatientStore) else call()


def stopped_of(store: ObjectStore) -> Stopped:
    """Answer to whether those who use a store have been told to stop."""
    return store.patience.stopped if isinstance(store, PatientStore) else never
