"""Rollouts whose jobs have ended, and that are not over: robots that return get orders, robots go back to a version.

No run takes in what happens to them, so whatever serves robots does: time-outs, windows that open, the next job of a
rollback. Several servers may do so at once.
"""

import logging
from collections.abc import Iterable

from ....schemas.wire.errors import ResourceNotFoundException, ThrottlingException
from ...service.service import Service
from ..kept_rollouts import KeptRollout
from ..rollout.ledger import Ledger
from ..stored_rollouts import OpenRollout
from .rollbacks import roll_back

_KEEP_ALIVE_S = 30.0  # well below the gap that counts as an outage
_LOGGER = logging.getLogger("robomaker.robots")


class EndedRollouts:
    """Tends them, for one thread.

    Args:
        service: where they are stored.
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._wakes: dict[tuple[str, int], float | None] = {}
        self._alive_s: dict[str, float] = {}

    def tend(self, rollouts: Iterable[OpenRollout]) -> None:
        """Does what is due.

        Args:
            rollouts: those that are open; of jobs that have not ended, their runs take care.

        Raises:
            ServiceUnavailableException: the catalog does not answer; ask again.
        """
        ended = [each for each in rollouts if each.rollout.status != "InProgress"]
        known = {(each.job, each.revision) for each in ended}
        self._wakes = {key: wake_s for key, wake_s in self._wakes.items() if key in known}
        for each in ended:
            try:
                self._tend(each)
            except (ResourceNotFoundException, ThrottlingException) as error:
                _LOGGER.info("%s: %s", each.job, error)  # deleted meanwhile, or the fleet is being changed: next time

    def _tend(self, each: OpenRollout) -> None:
        now_s = self._service.clock().timestamp()
        if each.rollout.rollback_is_due:
            roll_back(each.job, self._service)
        wake_s = self._wake_s(each)
        if wake_s is None:
            self._alive_s.pop(each.job, None)
        elif wake_s <= now_s:
            self._kept(each).fold()
            self._alive_s[each.job] = now_s
        elif now_s - self._alive_s.setdefault(each.job, each.rollout.now_s) >= _KEEP_ALIVE_S:
            kept = self._kept(each)
            if not kept.fold():  # which also sees whether nothing was served meanwhile
                kept.keep_alive()
            self._alive_s[each.job] = now_s

    def _wake_s(self, each: OpenRollout) -> float | None:
        key = (each.job, each.revision)
        if key not in self._wakes:
            self._wakes[key] = Ledger(each.rollout).wake_s()
        return self._wakes[key]

    def _kept(self, each: OpenRollout) -> KeptRollout:
        return KeptRollout(self._service.catalog.get(each.job), self._service)
