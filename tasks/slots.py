"""Slots of a batch: a Prefect global concurrency limit that belongs to one batch.

The limit holds across every machine that performs the batch, shows in Prefect's UI and can be
changed there while the batch runs. One performer takes its slots one request at a time: a SQLite
server answers a single request in about 12 ms, and several at once only after about 2 s.
"""

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from uuid import UUID

import httpx
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.exceptions import ObjectNotFound

_LEASE_S = 60.0  # the shortest lease the server grants
_RENEW_S = 20.0
_POLL_S = 0.5

_logger = logging.getLogger(__name__)


class Slots:
    """The slots of one batch; use as a context manager, which keeps the leases alive.

    Args:
      name: name of the global concurrency limit; equal on every machine that performs the batch.
      limit: how many slots there are.
    """

    def __init__(self, name: str, limit: int) -> None:
        self.name = name
        self.limit = limit
        self._leases: set[UUID] = set()
        self._one_request = threading.Lock()
        self._closed = threading.Event()
        self._client: SyncPrefectClient | None = None
        self._renewer = threading.Thread(target=self._renew_leases, name=f"slots {name}", daemon=True)

    def __enter__(self) -> "Slots":
        self._client = get_client(sync_client=True).__enter__()
        self._client.upsert_global_concurrency_limit_by_name(self.name, self.limit)
        self._renewer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._closed.set()
        self._renewer.join()
        self._connection.__exit__(kind, error, traceback)

    @property
    def _connection(self) -> SyncPrefectClient:
        if self._client is None:
            raise RuntimeError("slots are used inside a `with` block")
        return self._client

    @contextmanager
    def hold(self, should_stop: Callable[[], bool]) -> Iterator[bool]:
        """Holds one slot.

        Args:
          should_stop: asked while waiting; once true, waiting ends.

        Yields:
          Whether a slot is held; false only when `should_stop` ended the wait.
        """
        lease = self._acquire(should_stop)
        try:
            yield lease is not None
        finally:
            if lease is not None:
                self._release(lease)

    def remove(self) -> None:
        """Deletes the limit; called once, when the batch has ended."""
        try:
            with self._one_request:
                self._connection.delete_global_concurrency_limit_by_name(self.name)
        except ObjectNotFound:
            _logger.debug("limit %s was removed already", self.name)

    def _acquire(self, should_stop: Callable[[], bool]) -> UUID | None:
        while not should_stop():
            try:
                with self._one_request:
                    answer = self._connection.increment_concurrency_slots_with_lease(
                        names=[self.name], slots=1, mode="concurrency", lease_duration=_LEASE_S
                    )
                lease = UUID(answer.json()["lease_id"])
                self._leases.add(lease)
                return lease
            except httpx.HTTPStatusError as error:
                if error.response.status_code != httpx.codes.LOCKED:
                    raise
            time.sleep(_POLL_S)
        return None

    def _release(self, lease: UUID) -> None:
        self._leases.discard(lease)
        try:
            with self._one_request:
                self._connection.release_concurrency_slots_with_lease(lease_id=lease)
        except (httpx.HTTPError, ObjectNotFound) as error:
            # The lease runs out by itself; a finished job is not failed for it.
            _logger.warning("slot of %s not released at once: %s", self.name, error)

    def _renew_leases(self) -> None:
        while not self._closed.wait(_RENEW_S):
            for lease in tuple(self._leases):
                try:
                    with self._one_request:
                        self._connection.renew_concurrency_lease(lease_id=lease, lease_duration=_LEASE_S)
                except (httpx.HTTPError, ObjectNotFound) as error:
                    _logger.warning("lease on a slot of %s not renewed: %s", self.name, error)
