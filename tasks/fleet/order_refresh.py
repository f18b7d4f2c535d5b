"""Refreshes the robots and orders in memory from the catalog, again and again.

It also completes the rollouts of ended jobs, as no run does.
"""

import logging
import threading
import time
from collections.abc import Callable, Mapping

from ...schemas.wire.errors import RobomakerError
from ..service.service import Service
from .bundle_files import BundleFiles
from .fleet_records import KnownRobots
from .kept_rollouts import OpenRollout
from .order_keeping import OrderKeeper

LOGGER = logging.getLogger("robomaker.robots")

BUSY_S = 0.25
"""Interval between two polls of the catalog while a rollout is open or about to be, in seconds.

A robot's place in the wave stays empty for as long.
"""

IDLE_S = 2.0
"""Interval between two polls of the catalog while no rollout is open, in seconds."""

AWAKE_S = 60.0
"""Time after a deployment was created here during which the catalog is polled often, in seconds.

A rollout may open soon.
"""

# A look that costs much, in a large fleet, is followed by a pause ten times as long. Time in which it only waits, for a
# processor or a lock, does not count: a busy machine would make each robot's turn come seconds later.
_SHARE = 10
_ROBOTS_SHARE = 30  # robots are enrolled rarely, and reading ten thousand takes a quarter of a second


ReadRollouts = Callable[[Service, Mapping[str, OpenRollout]], list[OpenRollout]]
"""Function that reads the open rollouts; known ones that have not changed need not be read again."""


class OrderWatch:
    """Thread that watches robots and rollouts in the catalog and updates the table of orders.

    Args:
        service: The service, with its catalog and object store.
        robots: The enrolled robots.
        keeper: Keeps the orders.
        files: Files of the orders.
        rollouts: Reads the open rollouts: `kept_rollouts.open_rollouts`.
        tend: Does what is due of those whose jobs have ended: `EndedRollouts.tend`.
    """

    def __init__(
        self,
        service: Service,
        robots: KnownRobots,
        keeper: OrderKeeper,
        files: BundleFiles,
        rollouts: ReadRollouts,
        tend: Callable[[list[OpenRollout]], None],
    ) -> None:
        self._service = service
        self._robots = robots
        self._keeper = keeper
        self._files = files
        self._rollouts = rollouts
        self._tend = tend
        self._known: dict[str, OpenRollout] = {}
        self._woken = threading.Event()
        self._awake_until_s = 0.0
        self._is_stopped = False
        self._problem = ""
        self._robots_due_s = 0.0
        self._thread = threading.Thread(target=self._watch, name="robot-orders", daemon=True)

    def start(self) -> None:
        """Starts the thread that watches robots and rollouts."""
        self._thread.start()

    def wake(self) -> None:
        """Makes the thread poll at once, and often for a minute, because a deployment was ordered."""
        self._awake_until_s = time.monotonic() + AWAKE_S
        self._woken.set()

    def wake_for_robots(self) -> None:
        """Makes the thread poll at once, also for newly enrolled robots."""
        self._robots_due_s = 0.0
        self._woken.set()

    def stop(self) -> None:
        """Stops the thread that watches robots and rollouts, and waits until its current look has ended."""
        self._is_stopped = True
        self._woken.set()
        self._thread.join()

    def look(self) -> bool:
        """Updates the table of robots and their orders from the catalog; returns whether a deployment is open.

        Raises:
            RobomakerError: The catalog does not answer.
        """
        self._refresh_robots()
        rollouts = self._rollouts(self._service, self._known)
        self._known = {rollout.job: rollout for rollout in rollouts}
        self._keeper.sync(rollouts)
        self._files.remove_others()
        self._tend(rollouts)
        return bool(rollouts)

    def _refresh_robots(self) -> None:
        if time.monotonic() >= self._robots_due_s:
            began_s = time.thread_time()
            self._robots.refresh(self._service)
            cost_s = time.thread_time() - began_s
            self._robots_due_s = time.monotonic() + max(IDLE_S, _ROBOTS_SHARE * cost_s)

    def _watch(self) -> None:
        while not self._is_stopped:
            began_s = time.thread_time()
            is_busy = self._tried() or time.monotonic() < self._awake_until_s
            cost_s = time.thread_time() - began_s
            self._woken.wait(max(BUSY_S if is_busy else IDLE_S, _SHARE * cost_s))
            self._woken.clear()

    def _tried(self) -> bool:
        try:
            is_busy = self.look()
        except RobomakerError as error:
            self._tell(f"robots get no new orders: {error}")
            return True
        except Exception:
            LOGGER.exception("robots get no new orders")
            return True
        self._tell("")
        return is_busy

    def _tell(self, problem: str) -> None:
        """Logs a problem of the orders' refresh once, and once that it is over."""
        if problem != self._problem:
            LOGGER.warning("%s", problem or "robots get orders again")
        self._problem = problem
