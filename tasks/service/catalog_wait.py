"""Waits for a catalog whose database is unreachable when a job worker or a night begins."""

import logging
import math
import time
from collections.abc import Callable
from typing import TypeVar

from ...schemas.wire.errors import CatalogAwayError

_LOOK_S = 2.0

_logger = logging.getLogger(__name__)

Opened = TypeVar("Opened")


def once_catalog_answers(
    open_it: Callable[[], Opened],
    *,
    patience_s: float = math.inf,
    sleep: Callable[[float], None] = time.sleep,
    clock: Callable[[], float] = time.monotonic,
) -> Opened:
    """Calls a function that needs the catalog until its database answers.

    Args:
        open_it: Opens it.
        patience_s: Longest time of trying, in seconds.
        sleep: Waits, in seconds.
        clock: Function that returns seconds.

    Raises:
        CatalogAwayError: The database did not answer all the while.
        ConfigurationError: The catalog cannot be used, and waiting does not help, such as with a wrong password.
    """
    until_s, is_told = clock() + patience_s, False
    while True:
        try:
            opened = open_it()
        except CatalogAwayError as error:
            if clock() >= until_s:
                raise
            if not is_told:
                _logger.warning("waits for the catalog, which does not answer: %s", error)
                is_told = True
            sleep(_LOOK_S)
        else:
            if is_told:
                _logger.warning("the catalog answers")
            return opened
