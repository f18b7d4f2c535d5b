"""Keeping the credentials of a job's role fresh in the files that its code reads, while it runs."""

import logging
import threading
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ....schemas.wire.errors import RobomakerError
from ...service.service import Service
from .role_access import role_keys, write_store_files
from .run_environment import run_sandbox

EVERY_S = 60.0
"""Credentials of an assumed role are had again when half of their time is over, which is 15 minutes at least."""

_logger = logging.getLogger(__name__)


@contextmanager
def fresh_keys(request: Mapping[str, Any], service: Service, folder: Path, every_s: float = EVERY_S) -> Generator[None]:
    """Writes the role's credentials as they are now, and again as often as they change; does nothing without any.

    Args:
        request: the job's.
        service: where it is stored.
        folder: the run's own.
        every_s: how often it is looked whether they have changed, in seconds.

    Raises:
        LaunchError: they cannot be had.
        StorageUnavailableError: the server does not answer.
    """
    keys = role_keys(request, service)
    if keys is None:
        yield
        return
    sandbox, over = run_sandbox(folder), threading.Event()
    write_store_files(sandbox, service.settings, keys)
    if keys.expires_at is None:
        yield
        return

    def look() -> None:
        last = keys
        while not over.wait(every_s):
            try:
                now = role_keys(request, service)
                if now is not None and now != last:
                    write_store_files(sandbox, service.settings, now)
                    last = now
            except (RobomakerError, OSError) as error:  # those that are there may be good for a while
                _logger.warning("the credentials of %s cannot be had again: %s", request.get("iamRole"), error)

    thread = threading.Thread(target=look, name="fresh-keys", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
