"""Retry policy for an unreachable object store, and a store wrapper that repeats calls until they work."""

import contextvars
import logging
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ...schemas.wire.errors import ServiceUnavailableException, StorageUnavailableError
from ..storage import ObjectInfo, ObjectStore, split_stored
from ..storage.object_store import Result, Stopped, StoreOver, Tell, never, tell_none

_LISTEN_EVERY_S = 0.5
"""Interval between two checks whether to give up, during a pause or a call, in seconds."""
_PART_OF_WAIT = 8
_LONGEST_PAUSE_S = 30.0
_LOOK_EVERY_S = 15.0
"""Interval between two checks whether the store answers at all, during a call, in seconds."""

_logger = logging.getLogger(__name__)


def _say_nothing(text: str) -> None:
    """Does nothing: the default listener."""


@dataclass(frozen=True)
class Patience:
    """Repeats calls to an object store that does not answer, for a limited time.

    `note` is told once when a call begins to wait, and once when the store answers again.
    """

    patience_s: float
    """Seconds after which a failing call is not repeated any more."""

    first_pause_s: float = 1.0
    """Time until the first retry after an object store failed, in seconds."""

    stopped: Stopped = never
    """Function that returns whether to stop waiting for an object store."""

    note: Callable[[str], None] = _say_nothing
    """Function that is told in words that calls wait for a store, and that it answers again."""

    sleep: Callable[[float], None] = time.sleep
    clock: Callable[[], float] = time.monotonic
    """Clock that only runs forward, in seconds."""

    def ask(self, call: Callable[[], Result], probe: Callable[[], None]) -> Result:
        """Calls a function until the object store answers, and returns its result; gives up when waiting is over.

        Args:
            call: The operation; it can be repeated after it was interrupted.
            probe: Checks with a quick request whether the store answers.

        Raises:
            StorageUnavailableError: The store did not answer all the while.
        """
        began, waits = self.clock(), _Waits(self)
        while True:
            try:
                result = self._attended(call, probe, waits)
            except StorageUnavailableError as error:
                self._outlast(error, probe, began, waits)
            else:
                waits.end(self.clock() - began)
                return result

    def _outlast(
        self, failure: StorageUnavailableError, probe: Callable[[], None], began: float, waits: "_Waits"
    ) -> None:
        """Waits until the object store answers a probe, with pauses that grow to a maximum.

        Raises the last `StorageUnavailableError` when the time is over or the caller wants to stop.
        """
        while True:
            waited_s = self.clock() - began
            pause_s = min(_LONGEST_PAUSE_S, max(self.first_pause_s, waited_s / _PART_OF_WAIT))
            if waited_s + pause_s > self.patience_s or self._is_stopped():
                raise failure
            waits.begin(str(failure))
            if not self._pause(pause_s):
                raise failure
            try:
                probe()
            except StorageUnavailableError as error:
                failure = error
            else:
                return

    def _is_stopped(self) -> bool:
        """Whether the caller wants to stop waiting for the object store.

        If the catalog, which knows whether a job was cancelled, does not answer either, it is asked again at once.
        """
        try:
            return self.stopped()
        except ServiceUnavailableException as error:
            _logger.warning("whether to wait for the object store any more is not known: %s", error)
            return False

    def _pause(self, pause_s: float) -> bool:
        """Pauses before a retry; returns early, and false, if waiting should stop."""
        left_s = pause_s
        while left_s > 0.0 and not self._is_stopped():
            self.sleep(min(left_s, _LISTEN_EVERY_S))
            left_s -= _LISTEN_EVERY_S
        return left_s <= 0.0

    def _attended(self, call: Callable[[], Result], probe: Callable[[], None], waits: "_Waits") -> Result:
        """Runs a call in a thread and returns its result; abandons the thread if the store hangs and waiting is over.

        While the store answers probes it is at work, however long the call takes, also when waiting should stop. Raises
        the call's own error, or `StorageUnavailableError` when waiting is over.
        """
        outcome, heard = _in_thread(call), False
        silent_since: float | None = None
        look_at = self.clock() + _LOOK_EVERY_S
        while True:
            try:
                return outcome.result(_LISTEN_EVERY_S)
            except TimeoutError:
                if outcome.done():
                    raise  # it is the call's own
            now = self.clock()
            if not heard and (heard := self._is_stopped()):
                look_at = now
            if now < look_at:
                continue
            try:
                probe()
            except StorageUnavailableError as error:
                silent_since = now if silent_since is None else silent_since
                if heard or now - silent_since > self.patience_s:
                    raise
                waits.begin(str(error))
                look_at = now + self.first_pause_s
            else:
                silent_since, look_at = None, now + _LOOK_EVERY_S


class _Waits:
    """Teller that says once that a call waits for the store, and once that the store answers again."""

    def __init__(self, patience: Patience) -> None:
        self._patience = patience
        self._told = False

    def begin(self, why: str) -> None:
        if not self._told:
            self._told = True
            most = f"{self._patience.patience_s / 60.0:.3g} min"
            self._say(logging.WARNING, f"waits for the object store, at most {most}: {why}")

    def end(self, waited_s: float) -> None:
        if self._told:
            self._say(logging.INFO, f"the object store answers again, after {waited_s:.0f} s")

    def _say(self, level: int, text: str) -> None:
        _logger.log(level, "%s", text)
        self._patience.note(text)


def _in_thread(call: Callable[[], Result]) -> "Future[Result]":
    """Runs a call in a daemon thread, for which the process does not wait at its end.

    Returns the future of its result.
    """
    outcome: Future[Result] = Future()
    context = contextvars.copy_context()

    def run() -> None:
        try:
            outcome.set_result(context.run(call))
        except BaseException as error:  # whatever it is, the one who waits gets it
            outcome.set_exception(error)

    threading.Thread(target=run, name="object store", daemon=True).start()
    return outcome


class PatientStore(StoreOver):
    """Object store wrapper that waits and retries while the store does not answer or is full.

    If files are stored together, a retry stores only the missing ones.

    Args:
        store: The store behind it.
        patience: The retry policy.
    """

    def __init__(self, store: ObjectStore, patience: Patience) -> None:
        super().__init__(store)
        self.patience = patience

    def over(self, store: ObjectStore) -> "PatientStore":
        """Returns a store that wraps another object store with the same retry policy."""
        return PatientStore(store, self.patience)

    def do(
        self, access: Literal["read", "write"], bucket: str, keys: Iterable[str], call: Callable[[], Result]
    ) -> Result:
        """Calls the wrapped store, again after each outage until it answers, and returns the result.

        Raises `StorageUnavailableError` when the time for waiting is over; see `Patience.ask`.
        """
        del access, keys
        return self.patience.ask(call, lambda: self.behind.probe(bucket))

    def put_files(
        self, bucket: str, files: dict[str, Path], *, stopped: Stopped = never, tell: Tell = tell_none
    ) -> list[ObjectInfo]:
        """Uploads files as `ObjectStore.put_files`, and repeats the upload while the object store is away.

        A repetition leaves out files that were stored before; `tell` gets their keys too. Returns the stored objects in
        the order of the files. Raises `StorageUnavailableError` when the time for waiting is over.
        """
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
    """Returns the object store without its retries, if it has any, for use while holding a lock."""
    return store.behind if isinstance(store, PatientStore) else store


def patiently(store: ObjectStore, bucket: str, call: Callable[[], Result]) -> Result:
    """Calls a function that uses `at_once(store)`, with the store's retry policy, and returns its result.

    Args:
        store: The store, patient or not.
        bucket: Name of the bucket.
        call: The operation; it can be repeated after it was interrupted.
    """
    return store.do("write", bucket, (), call) if isinstance(store, PatientStore) else call()


def stopped_of(store: ObjectStore) -> Stopped:
    """Returns the function that says whether calls of a store have to stop; for stores without retries, never."""
    return store.patience.stopped if isinstance(store, PatientStore) else never
