"""Watches whether the Prefect server answers; while it does not, jobs wait."""

import logging
import os
import threading

from ...schemas.settings import Settings
from ..prefect_server.local_server import server_status

_GOOD_S = 10.0
_BAD_S = 1.0

_logger = logging.getLogger(__name__)


class PrefectWatch:
    """Thread that checks regularly whether the Prefect server answers."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._answers = True
        self._look = threading.Event()
        self.url = os.environ.get("PREFECT_API_URL", "").removesuffix("/api")

    def start(self) -> None:
        """Starts the thread that checks the Prefect server."""
        threading.Thread(target=self._watch, name="prefect watch", daemon=True).start()

    @property
    def answers(self) -> bool:
        """Whether the Prefect server answered at the last check."""
        return self._answers

    def look_now(self) -> None:
        """Makes the thread check the server at once, after a failed request."""
        self._look.set()

    def looked_at_now(self) -> bool:
        """Returns whether the Prefect server answers now; if it does not, the watch looks again at once."""
        answers = server_status(self._settings).running
        if not answers:
            self.look_now()
        return answers

    def _watch(self) -> None:
        while True:
            answers = server_status(self._settings).running
            if self._answers and not answers:
                _logger.warning(
                    "Prefect does not answer at %s; jobs wait until it does (robomaker server start)",
                    self.url,
                )
            elif answers and not self._answers:
                _logger.info("Prefect answers again at %s", self.url)
            self._answers = answers
            self._look.wait(_GOOD_S if answers else _BAD_S)
            self._look.clear()
