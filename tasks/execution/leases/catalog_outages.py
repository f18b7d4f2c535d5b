"""Outages of the catalog while a job or a run goes on: it waits, and calls again once the database answers."""

import logging
import time
from collections.abc import Callable
from typing import TypeVar

from ....schemas.wire.errors import ServiceUnavailableException
from ...service.service import Service
from .job_leases import Lease

Result = TypeVar("Result")
_logger = logging.getLogger(__name__)

_MOST_REFUSALS = 3
"""Number of calls in a row that a catalog which answers may refuse, before waiting is given up."""


class CatalogWait:
    """Waits and retries while the catalog's database is unreachable.

    A catalog that answers and still refuses a change is soon given up.

    Args:
        arn: ARN of the waiting job, for the log.
        look: Reads the catalog.
        is_over: Returns whether to stop waiting.
        pause_s: Seconds until the next try after the catalog did not answer.
    """

    def __init__(self, arn: str, look: Callable[[], object], is_over: Callable[[], bool], pause_s: float) -> None:
        self._arn, self._look, self._is_over, self._pause_s = arn, look, is_over, pause_s
        self._refusals = 0

    @classmethod
    def of(cls, lease: Lease, service: Service) -> "CatalogWait":
        """Makes the retry policy for work on a job, which reads the job again after an outage."""
        return cls(lease.job.arn, lease.refreshed, lambda: lease.lost, service.timing.after_outage_s)

    def outlasting(self, call: Callable[[], Result]) -> Result:
        """Calls a function, again after each outage of the catalog's database, and returns its result.

        Args:
            call: Does the same when it is called again, whether or not the catalog had done it.

        Raises:
            ServiceUnavailableException: As `outlast`.
        """
        while True:
            try:
                return call()
            except ServiceUnavailableException as error:
                self.outlast(error)

    def outlast(self, failure: ServiceUnavailableException) -> None:
        """Waits until the catalog's database answers again.

        Args:
            failure: Error by which the outage was noticed.

        Raises:
            ServiceUnavailableException: `failure`, when waiting is over, or when the catalog was never away the last
                times: its disk may be full.
        """
        _logger.warning("%s waits for the catalog: %s", self._arn, failure)
        was_away = False
        while not self._is_over():
            time.sleep(self._pause_s)
            try:
                self._look()
            except ServiceUnavailableException as still:
                was_away = True
                _logger.debug("the catalog is still away: %s", still)
                continue
            self._refusals = 0 if was_away else self._refusals + 1
            if self._refusals < _MOST_REFUSALS:
                return
            break
        raise failure
