"""The access log: one line per request, when it is switched on.

```
2026-01-31T12:00:00Z 127.0.0.1 POST /describeWorld 200 - 1.8 ms 0f7a…
```
"""

import logging
import os
import time
from pathlib import Path

from ..log_lines import log_formatter
from .messages import ServiceRequest

LOGGER = logging.getLogger("robomaker.access")
LOGGER.propagate = False  # nothing is written, and nothing costs time, until `write_access_log`


def write_access_log(path: Path | None = None) -> logging.Handler:
    """Begins to log requests.

    Args:
        path: file that lines are added to; `None`: standard error.

    Returns:
        The handler; closing it is the caller's.

    Raises:
        OSError: the file cannot be written.
    """
    handler = logging.StreamHandler() if path is None else logging.FileHandler(path, encoding="utf-8")
    formatter = log_formatter(os.environ, "%(asctime)s %(message)s", "%Y-%m-%dT%H:%M:%SZ")
    formatter.converter = time.gmtime
    handler.setFormatter(formatter)
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    return handler


def log_access(request: ServiceRequest, status: int, error: str, duration_s: float) -> None:
    """Logs one request, if the access log is on.

    Args:
        request: what was asked.
        status: HTTP status of the answer.
        error: name of the error that it tells of; `-`: of none.
        duration_s: how long it took.
    """
    if LOGGER.handlers:
        LOGGER.info(
            "%s %s %s %d %s %.1f ms %s",
            request.client.host if request.client else "-",
            ascii(request.method)[1:-1],
            ascii(request.raw_path)[1:-1][:500],
            status,
            error,
            duration_s * 1000,
            request.id,
            # What lines of JSON have besides.
            extra={
                "operation": request.operation,
                "status": status,
                "duration_ms": round(duration_s * 1000, 1),
                "request_id": request.id,
            },
        )
