"""Jobs that this process orders and carries out itself: it holds their leases from the transaction that stores them.

```
with OwnOrder(service) as own:
    answer = call("StartSimulationJobBatch", request, own.through("StartSimulationJobBatch", request))
    own.keep(answer["arn"])
    …                                    whatever carries the job out takes the lease that is held already
```

Without it a job worker on the same catalog would take the job between the two, into an environment of its own.
"""

import logging
import threading
from collections.abc import Mapping
from dataclasses import replace
from types import TracebackType
from typing import Any, Self

from ....schemas.wire.errors import ServiceUnavailableException
from ...catalog import FirstLease
from ...execution.held_leases import HELD, HeldLeases, new_owner
from ...service.service import Service
from .needed_environments import environment_needed

_logger = logging.getLogger(__name__)


class OwnOrder:
    """One order, whose job's lease is kept until the block ends.

    Args:
        service: where the job is stored.
        held: where this process notes the leases that it holds.
    """

    def __init__(self, service: Service, held: HeldLeases = HELD) -> None:
        self._service = service
        self._held = held
        self._owner = new_owner()
        self._arn: str | None = None
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        """Begins the order."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Gives the lease back, unless that has happened; an interruption (Ctrl-C, a signal) cancels the job."""
        self._ended.set()
        if self._arn is None:
            return
        try:
            if kind is not None and not issubclass(kind, Exception):
                self._service.catalog.request_cancel(self._arn)  # it may not have begun; one that has ended stays
            self._held.cancel_reservation(self._arn, self._service.catalog)
        except ServiceUnavailableException as unavailable:
            _logger.warning("the lease of %s runs out by itself: %s", self._arn, unavailable)

    def through(self, operation: str, request: Mapping[str, Any]) -> Service:
        """The service that stores the job with its lease; to carry it out is not its use, as parts are no orders.

        Args:
            operation: the operation that orders the job.
            request: the request's members, which have been checked.
        """
        needed = environment_needed(operation, request, self._service)
        lease = FirstLease(self._owner, self._service.timing.lease_s, needed.model_dump(mode="json"))
        return replace(self._service, first_lease=lease)

    def keep(self, arn: str) -> None:
        """Keeps the lease of the job that was stored.

        A job that an equal call had stored before may be another's; carrying it out here then waits for its lease.
        """
        if self._service.catalog.lease_of(arn)[0] != self._owner:
            return
        if not self._held.adopt(arn, self._owner):
            self._service.catalog.release(arn, self._owner)  # this process ends
        else:
            self._arn = arn
            threading.Thread(target=self._renew, args=(arn,), name=f"order of {arn}", daemon=True).start()

    def _renew(self, arn: str) -> None:
        timing = self._service.timing
        while not self._ended.wait(timing.renew_lease_every_s):
            try:
                self._held.renew_reservation(arn, self._service.catalog, timing.lease_s)
            except ServiceUnavailableException as error:
                _logger.warning("the lease of %s is not renewed: %s", arn, error)
