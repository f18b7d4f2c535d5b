"""Signs what would expire of the repository again, while `robomaker serve` runs where the keys are."""

import logging
import threading

from ...schemas.wire.errors import RobomakerError
from ...tasks.service.service import Service

LOGGER = logging.getLogger("robomaker.robots")

PAUSE_S = 600.0
"""Between two looks; the timestamp is signed again every six hours."""


class TrustUpkeep:
    """Looks, in a thread of its own.

    Args:
        service: where the repository is stored.
        pause_s: between two looks, in seconds.
    """

    def __init__(self, service: Service, pause_s: float = PAUSE_S) -> None:
        self._service = service
        self._pause_s = pause_s
        self._stopped = threading.Event()
        self._problem = ""
        self._thread = threading.Thread(target=self._keep_up, name="trust-upkeep", daemon=True)

    def start(self) -> None:
        """Begins to look."""
        self._thread.start()

    def stop(self) -> None:
        """Ends; returns when the last look is over."""
        self._stopped.set()
        self._thread.join()

    def _keep_up(self) -> None:
        while not self._stopped.is_set():
            self._tell(self._problem_now())
            self._stopped.wait(self._pause_s)

    def _problem_now(self) -> str:
        if not (self._service.settings.home / "robots" / "trust" / "root.json").exists():
            return ""  # no agent has been enrolled from here
        try:
            from ...tasks.fleet.trust.publishing import publisher_of  # it needs the extra `fleet`

            publisher_of(self._service).keep_up()
        except (RobomakerError, ImportError) as error:
            return f"the robots' repository is not signed again: {error}"
        except Exception as error:
            LOGGER.exception("the robots' repository is not signed again")
            return str(error)
        return ""

    def _tell(self, problem: str) -> None:
        """Logs a problem once, and that it is over."""
        if problem != self._problem:
            LOGGER.warning("%s", problem or "the robots' repository is signed again")
        self._problem = problem
