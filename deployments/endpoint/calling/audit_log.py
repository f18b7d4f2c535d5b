"""The audit log: who called which operation on which resources, when, and how it ended."""

import json
import logging
import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Self

from ....schemas.wire.errors import ConfigurationError
from .access_keys import AccessKey

MAX_RESOURCES = 20
"""Limit of the resources named in the log entry of a call; `resource_count` has the full number."""

LOGGER = logging.getLogger("robomaker.endpoint")


@dataclass
class Call:
    """Entry of an API call in the audit log."""

    request_id: str
    address: str | None
    key: AccessKey | None = None
    """Access key that signed the call; `None`: none was required, or the signature was refused."""

    operation: str | None = None
    resources: Sequence[str] = ()
    outcome: str = "ok"
    """Result of an API call in the audit log: `ok`, or the error's name."""

    job: str | None = None
    """ARN of the simulation job whose process sent the API call; `None`: another program did."""


class AuditLog:
    """Audit log file of API calls; several servers may share it.

    Args:
        path: The file; one that is made is its user's alone.
        clock: The time.

    Raises:
        ConfigurationError: The file cannot be written.
    """

    def __init__(self, path: Path, clock: Callable[[], datetime]) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        except OSError as error:
            raise ConfigurationError(
                f"--audit-log {path}: {error.strerror}; name a file that can be written"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)

    def write(self, call: Call) -> None:
        """Appends a call to the audit log; a failure to do so is only logged."""
        line = {
            "time": self._clock().isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "caller": call.key.name if call.key else call.job,
            "access_key": call.key and call.key.id,
            "address": call.address,
            "operation": call.operation,
            "resources": list(call.resources[:MAX_RESOURCES]),
            "resource_count": len(call.resources),
            "outcome": call.outcome,
            "request_id": call.request_id,
        }
        try:
            with self._lock:
                os.write(self._file, json.dumps(line).encode() + b"\n")
        except OSError as error:
            LOGGER.error("request %s is not in the audit log: %s", call.request_id, error.strerror)
