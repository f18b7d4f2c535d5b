"""Slots of a batch: a Prefect global concurrency limit that belongs to one batch.

Prefect's UI shows the limit, and users may lower it there while the batch runs. It belongs to the job worker that holds
the batch's lease; a worker that takes over from a dead one makes it anew. A slot is a lease on the Prefect server.
Taking one per job would make the jobs wait: a SQLite server takes up to two seconds for a write while it records task
runs. So a worker takes its slots when it starts, before task runs are recorded, and hands them from job to job. Every
few seconds it checks whether the limit has been lowered, and releases slots if so.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from http import HTTPStatus
from types import TracebackType
from uuid import UUID

import httpx
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.exceptions import ObjectNotFound

_LEASE_S = 60.0  # the shortest lease the server grants
_RENEW_S = 20.0
LOOK_S = 5.0
"""Interval between two checks whether the batch's limit was changed, in seconds."""
_WAIT_S = 0.25
_TURN_TIMEOUT_S = 5.0
"""Time after which a waiting job loses its turn to later ones that have asked for a slot, in seconds."""

_PREFIX = "robomaker-"
_PAGE = 50
"""Number of concurrency limits that are read with one request."""

_logger = logging.getLogger(__name__)


def limit_name(batch_id: str) -> str:
    """Returns the name of the Prefect global concurrency limit for a batch."""
    return f"{_PREFIX}{batch_id}"


def batches_with_limits(client: SyncPrefectClient) -> list[str]:
    """Lists ids of the batches that have a concurrency limit on a Prefect server; some may belong to other homes."""
    names: list[str] = []
    while page := client.read_global_concurrency_limits(limit=_PAGE, offset=len(names)):
        names += [limit.name for limit in page]
    return [name.removeprefix(_PREFIX) for name in names if name.startswith(f"{_PREFIX}batch-")]


class Slots:
    """Concurrency slots of a batch which this job worker holds, kept as a Prefect global concurrency limit.

    Use it as a context manager.

    Args:
        name: Name of the global concurrency limit, the batch's own.
        limit: Number of slots.
        wanted: Number of slots that this job worker can use at once.
        look_s: Seconds between two checks whether the limit was changed on the server.
        order: Places of those that will hold slots, in the order in which they shall get them; empty: in none.
    """

    def __init__(self, name: str, limit: int, wanted: int, look_s: float = LOOK_S, order: Iterable[int] = ()) -> None:
        self._queue = deque(order)  # those that have not held a slot
        self._came: set[int] = set()
        self.name = name
        self._limit = limit
        self._wanted = wanted
        self._look_s = look_s
        self._free: list[UUID] = []
        self._used: set[UUID] = set()
        self._changed = threading.Condition()
        self._closed = threading.Event()
        self._client: SyncPrefectClient | None = None
        self._keeper = threading.Thread(target=self._keep, name=f"slots {name}", daemon=True)

    def __enter__(self) -> "Slots":
        self._client = get_client(sync_client=True).__enter__()
        # One worker at a time works on a batch, so slots of an earlier one belong to a dead worker. Without this,
        # they would be free only after a minute.
        self._delete_limit()
        self._connection.upsert_global_concurrency_limit_by_name(self.name, self._limit)
        self._take_what_there_is()
        self._keeper.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._closed.set()
        self._keeper.join()
        for lease in (*self._free, *self._used):
            self._give_back(lease)
        self._connection.__exit__(kind, error, traceback)

    @contextmanager
    def hold(self, should_stop: Callable[[], bool], place: int | None = None) -> Generator[bool]:
        """Waits for a slot, so that a job of the batch may run, and holds it inside the `with` block.

        Args:
            should_stop: Called while waiting; once true, waiting ends.
            place: Place in the order; absent: no matter.

        Yields:
            Whether a slot is held; false only when `should_stop` ended the wait.
        """
        try:
            self._await_turn(should_stop, place)
            lease = self._borrow(should_stop)
        finally:
            self._pass_turn(place)
        try:
            yield lease is not None
        finally:
            if lease is not None:
                with self._changed:
                    self._used.discard(lease)
                    self._free.append(lease)
                    self._changed.notify_all()  # one that waits for its turn has no use for it

    @property
    def count(self) -> int:
        """Number of the batch's concurrency slots that this process holds, free ones and used ones."""
        with self._changed:
            return len(self._free) + len(self._used)

    def remove(self) -> None:
        """Deletes the batch's concurrency limit from the Prefect server; called once, after the batch has ended."""
        self._delete_limit()
        self._free.clear()
        self._used.clear()

    @property
    def _connection(self) -> SyncPrefectClient:
        if self._client is None:
            raise RuntimeError("slots are used inside a `with` block")
        return self._client

    def _borrow(self, should_stop: Callable[[], bool]) -> UUID | None:
        with self._changed:
            while not should_stop():
                if self._free:
                    lease = self._free.pop()
                    self._used.add(lease)
                    return lease
                self._changed.wait(_WAIT_S)
        return None

    def _await_turn(self, should_stop: Callable[[], bool], place: int | None) -> None:
        """Waits until all jobs that come before this one have had their turn to take a slot, so that the order is kept.

        Returns early if `should_stop` says so. A job that does not come for a long time is left out of the order.

        Args:
            should_stop: Called while waiting.
            place: Position of this job in the order; `None`: it does not wait.
        """
        with self._changed:
            late_s = time.monotonic() + _TURN_TIMEOUT_S
            if place is not None:
                self._came.add(place)
            while place is not None and self._queue and self._queue[0] < place and not should_stop():
                if self._queue[0] not in self._came and time.monotonic() >= late_s:
                    self._queue.popleft()  # its task broke before it came here
                else:
                    self._changed.wait(_WAIT_S)

    def _pass_turn(self, place: int | None) -> None:
        with self._changed:
            if place in self._queue:
                self._queue.remove(place)
            self._changed.notify_all()

    def _keep(self) -> None:
        """Renews the slots' leases at the Prefect server and follows changes of the limit, until the object is closed.

        A failure is logged and tried again; this is the body of a thread.
        """
        renewed_at = time.monotonic()
        while not self._closed.wait(self._look_s):
            try:
                if time.monotonic() - renewed_at >= _RENEW_S:
                    self._renew()
                    renewed_at = time.monotonic()
                self._follow_limit()
            except (httpx.HTTPError, ObjectNotFound) as error:
                _logger.warning("limit %s cannot be looked after: %s", self.name, error)

    def _renew(self) -> None:
        for lease in (*self._free, *self._used):
            try:
                self._connection.renew_concurrency_lease(lease_id=lease, lease_duration=_LEASE_S)
            except httpx.HTTPStatusError as error:
                if error.response.status_code != HTTPStatus.GONE:
                    raise
                self._forget(lease)  # it ran out, since the machine slept

    def _forget(self, lease: UUID) -> None:
        """Drops a free slot that the server no longer knows; a slot in use is dropped when its job has ended."""
        with self._changed:
            if lease in self._free:
                self._free.remove(lease)

    def _follow_limit(self) -> None:
        """Reads the batch's limit from the Prefect server, releases free slots above it, and takes slots up to it."""
        self._limit = self._connection.read_global_concurrency_limit_by_name(self.name).limit
        while surplus := self._surplus():
            self._give_back(surplus)
        self._take_what_there_is()

    def _surplus(self) -> UUID | None:
        """Takes a free slot that is above the limit out of the free ones, and returns it; `None` if there is none.

        Slots in use are released when their jobs have ended.
        """
        with self._changed:
            too_many = len(self._free) + len(self._used) > self._limit
            return self._free.pop() if too_many and self._free else None

    def _take_what_there_is(self) -> None:
        while len(self._free) + len(self._used) < min(self._wanted, self._limit):
            try:
                answer = self._connection.increment_concurrency_slots_with_lease(
                    names=[self.name], slots=1, mode="concurrency", lease_duration=_LEASE_S
                )
            except httpx.HTTPStatusError as error:
                if error.response.status_code == HTTPStatus.LOCKED:
                    return  # another worker has them, or a dead one whose leases have not run out
                raise
            with self._changed:
                self._free.append(UUID(answer.json()["lease_id"]))
                self._changed.notify()

    def _delete_limit(self) -> None:
        try:
            self._connection.delete_global_concurrency_limit_by_name(self.name)
        except ObjectNotFound:
            _logger.debug("there is no limit %s", self.name)
        except httpx.HTTPError as error:
            _logger.warning("limit %s cannot be removed: %s", self.name, error)

    def _give_back(self, lease: UUID) -> None:
        try:
            self._connection.release_concurrency_slots_with_lease(lease_id=lease)
        except (httpx.HTTPError, ObjectNotFound) as error:
            # The lease runs out by itself; nothing is failed for it.
            _logger.warning("a slot of %s is not released at once: %s", self.name, error)
