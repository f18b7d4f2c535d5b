"""Health of a Prefect server, and its outages: reported at once, waited for in one place."""

import logging
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Generator
from contextlib import contextmanager
from enum import Enum, auto

_TIMEOUT_S = 5.0
BUSY_PATIENCE_S = 90.0
"""Longest wait for a busy server, in seconds: a loaded machine may keep it from answering for a minute."""

_logger = logging.getLogger(__name__)


class Health(Enum):
    """Health of the Prefect server: it answers, is busy, or is away."""

    HEALTHY = auto()
    BUSY = auto()
    """The server is busy: something listens at its port, but does not answer in time."""

    AWAY = auto()
    """The server is away: nothing listens at its port, or something that is no Prefect server."""


def health_of(api_url: str) -> Health:
    """Checks the health of a Prefect server once; takes 5 seconds at most.

    Args:
        api_url: URL of its API.
    """
    try:
        with urllib.request.urlopen(f"{api_url}/health", timeout=_TIMEOUT_S) as answer:  # noqa: S310 - an http(s) URL
            return Health.HEALTHY if answer.status == 200 else Health.AWAY
    except urllib.error.HTTPError as error:  # it answers those who log in, as Prefect's client does
        return Health.HEALTHY if error.code in (401, 403) else Health.AWAY
    except TimeoutError:
        return Health.BUSY
    except urllib.error.URLError as error:
        return Health.BUSY if isinstance(error.reason, TimeoutError) else Health.AWAY
    except (OSError, ValueError):
        return Health.AWAY


def wait_while_busy(
    ask: Callable[[], Health],
    what: str,
    patience_s: float = BUSY_PATIENCE_S,
    clock: Callable[[], float] = time.monotonic,
) -> Health:
    """Waits while a Prefect server is busy.

    Args:
        ask: Checks the server's health; may take some seconds.
        what: Description of the server, for the log.
        patience_s: Longest wait, in seconds.
        clock: Function that returns seconds.

    Returns:
        The server's health; busy only after `patience_s` has passed.
    """
    deadline = clock() + patience_s
    _logger.warning("%s is busy and does not answer; waiting for it, %g s at most", what, patience_s)
    while (health := ask()) is Health.BUSY and clock() < deadline:
        pass  # asking takes its time
    return health


DEAD_PATIENCE_S = 5.0
"""Longest wait for the home's own server if nothing listens at its port, in seconds: only a person restarts it.

Other servers are restarted by their supervisor, such as systemd or a container engine, also on this machine.
"""

SILENCE_S = 5.0
"""Time without a response after which the Prefect server's health is checked, in seconds."""

_LOOK_S = 1.0


class Outage:
    """Tracks whether the Prefect server is away, and how long requests wait for it.

    Args:
        api_url: URL of its API.
        ask: Asks the server how it does; takes some seconds at most.
        tell: Tells the user a sentence; called from any thread.
        is_own: Whether the home's own server is there, which nothing starts again by itself.
        clock: Function that returns seconds.
        look_s: Seconds between two polls of a server that is away, and of the requests that wait for an answer.
    """

    def __init__(
        self,
        api_url: str,
        ask: Callable[[], Health],
        tell: Callable[[str], None],
        is_own: bool,
        clock: Callable[[], float] = time.monotonic,
        look_s: float = _LOOK_S,
    ) -> None:
        self._name = f"the Prefect server at {api_url}"
        self._is_own = is_own
        self._ask = ask
        self._tell = tell
        self._clock = clock
        self._look_s = look_s
        self._changed = threading.Condition()
        self._health = Health.HEALTHY
        self._since = 0.0
        self._has_told_end = False
        self.has_been = False
        """Whether the Prefect server was ever away, so that it may not know how runs ended."""
        self._open_requests: dict[object, float] = {}
        self._closed = threading.Event()

    @contextmanager
    def watched(self) -> Generator[None]:
        """Watches in a thread, inside the block, whether the Prefect server answers."""
        watch = threading.Thread(target=self._watch, name="prefect outage", daemon=True)
        watch.start()
        try:
            yield
        finally:
            self._closed.set()

    @property
    def is_on(self) -> bool:
        """Whether the Prefect server was not healthy at the last check: it is away, or does not answer."""
        return self._health is not Health.HEALTHY

    @property
    def is_waited_for(self) -> bool:
        """Whether the Prefect server is away and requests still wait for it."""
        return self.is_on and self._clock() < self._since + self._patience_s()

    @property
    def in_words(self) -> str:
        """Says that the Prefect server, which is away, is not there, and how it comes back."""
        if self._is_own and self._health is Health.AWAY:
            return f"{self._name} was stopped; the next `robomaker run` starts it again"
        return f"{self._name} does not answer"

    def wait(self) -> bool:
        """Waits until the server answers, or waiting time is over.

        Returns:
            Whether it answers.
        """
        with self._changed:
            while self.is_waited_for:
                self._changed.wait(self._look_s)
            self._tell_end()
            return not self.is_on

    @contextmanager
    def asking(self) -> Generator[float]:
        """Counts a request to the Prefect server as open inside the block; yields the time (s) at which it began."""
        request, began = object(), self._clock()
        self._open_requests[request] = began
        try:
            yield began
        finally:
            del self._open_requests[request]

    def look(self, since: float) -> bool:
        """Checks the server's health after an unanswered request.

        Args:
            since: Start of that request.

        Returns:
            Whether the server is away.
        """
        health = self._ask()
        with self._changed:
            was, self._health = self._health, health
            if self.is_on and was is Health.HEALTHY:
                self._since, self._has_told_end, self.has_been = since, False, True
                self._tell(
                    f"{self._name} does not answer: {_WHY[health]}; what runs goes on, and is not shown there; "
                    f"waiting for it where it is needed, {self._patience_s():g} s at most in all"
                )
            elif was is not Health.HEALTHY and not self.is_on:
                self._tell(f"{self._name} answers again, after {self._clock() - self._since:.0f} s")
            self._tell_end()
            self._changed.notify_all()
        return self.is_on

    def _tell_end(self) -> None:
        """Reports once that the Prefect server, which is away, is not waited for any longer."""
        if self.is_on and not self.is_waited_for and not self._has_told_end:
            self._has_told_end = True
            self._tell(f"{self._name} is not waited for any longer; what runs goes on without it")

    def _patience_s(self) -> float:
        return DEAD_PATIENCE_S if self._health is Health.AWAY and self._is_own else BUSY_PATIENCE_S

    def _watch(self) -> None:
        while not self._closed.wait(self._look_s):
            oldest = min(list(self._open_requests.values()), default=None)
            if self.is_on:
                self.look(self._since)
            elif oldest is not None and self._clock() - oldest >= SILENCE_S:
                self.look(oldest)


_WHY = {Health.BUSY: "it is silent", Health.AWAY: "it does not run, or cannot be reached"}
