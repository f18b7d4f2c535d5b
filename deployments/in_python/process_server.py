"""Prefect server of a Python process that runs specifications; Prefect may be imported before it is chosen."""

import logging
import os
import sys
from collections.abc import Generator
from contextlib import contextmanager

from ...schemas.settings import Settings
from ..cli.prefect_server import use_server

_API_URL, _AUTH = "PREFECT_API_URL", "PREFECT_API_AUTH_STRING"
_chosen: set[str] = set()
"""Addresses of servers that this process has set in its own environment variables."""


def server_of_process(settings: Settings) -> str:
    """Returns the Prefect server that this process uses; starts the data home's own if it uses none.

    Operations that are called later use the same one.

    Args:
        settings: The data home's.

    Raises:
        LocalServerError: A local server did not start.
        ConfigurationError: The configured server does not answer.
    """
    known = _known_to_prefect()
    if known and known not in _chosen:
        return known
    if os.environ.get(_API_URL) in _chosen:  # it may have ended since, so that it is looked for anew
        for name in (_API_URL, _AUTH):
            os.environ.pop(name, None)
    url = use_server(settings, for_runs=True)
    _chosen.add(url)
    return url


def _known_to_prefect() -> str | None:
    """Returns the server in the settings of a loaded Prefect; `None` if it is not loaded, or names none."""
    if "prefect" not in sys.modules:
        return None
    from prefect.settings import PREFECT_API_URL

    return PREFECT_API_URL.value()


@contextmanager
def quiet_prefect() -> Generator[None]:
    """Hides Prefect's log lines about runs on standard error inside the `with` block; its server still gets them.

    If Prefect was imported before the server was chosen, it has not read the settings that do this.
    """
    from prefect.logging.configuration import ensure_logging_setup
    from prefect.logging.handlers import PrefectConsoleHandler

    ensure_logging_setup()  # else the first run does it, and adds what is looked for here
    handlers = [each for each in logging.getLogger().handlers if isinstance(each, PrefectConsoleHandler)]
    if "PREFECT_LOGGING_LEVEL" in os.environ:  # who sets it wants to see them
        handlers = []
    for handler in handlers:
        handler.addFilter(_is_not_of_prefect)
    try:
        yield
    finally:
        for handler in handlers:
            handler.removeFilter(_is_not_of_prefect)


def _is_not_of_prefect(record: logging.LogRecord) -> bool:
    return record.name.partition(".")[0] != "prefect"
