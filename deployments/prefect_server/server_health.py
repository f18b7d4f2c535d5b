"""Whether a Prefect server answers, is only busy, or is not there."""

import logging
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from enum import Enum, auto

_TIMEOUT_S = 5.0
BUSY_PATIENCE_S = 90.0
"""How long a busy server is waited for: a machine with much to do may keep it from answering for a minute."""

_logger = logging.getLogger(__name__)


class Health(Enum):
    """How a server does."""

    HEALTHY = auto()
    BUSY = auto()
    """Something listens there, and does not answer in time."""

    AWAY = auto()
    """Nothing listens there, or something that is no Prefect server."""


def health_of(api_url: str) -> Health:
    """Asks a server once; takes 5 seconds at most.

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
    """Waits for a server that is busy, and says so.

    Args:
        ask: asks the server; takes its time where it is busy.
        what: the server, for the log.
        patience_s: how long.
        clock: gives seconds.

    Returns:
        How it does; busy only once patience has ended.
    """
    deadline = clock() + patience_s
    _logger.warning("%s is busy and does not answer; waiting for it, %g s at most", what, patience_s)
    while (health := ask()) is Health.BUSY and clock() < deadline:
        pass  # asking takes its time
    return health
