"""Formats of log lines: text for people, or JSON for log collectors."""

import logging
from collections.abc import Mapping

from pythonjsonlogger.json import JsonFormatter

from ..schemas.wire.errors import ConfigurationError

VARIABLE = "ROBOMAKER_LOG_FORMAT"
_FIELDS = "%(asctime)s %(levelname)s %(name)s %(message)s"


def log_formatter(environ: Mapping[str, str], text: str, times: str | None = None) -> logging.Formatter:
    """Makes the log formatter for text or JSON lines, as `ROBOMAKER_LOG_FORMAT` says.

    Args:
        environ: Environment variables, of which `ROBOMAKER_LOG_FORMAT` is read.
        text: Format of lines for people.
        times: Format of their times.

    Raises:
        ConfigurationError: The variable has another value than `text` or `json`.
    """
    match environ.get(VARIABLE) or "text":
        case "text":
            return logging.Formatter(text, datefmt=times)
        case "json":
            renamed = {"asctime": "time", "levelname": "level", "name": "logger"}
            return JsonFormatter(_FIELDS, datefmt="%Y-%m-%dT%H:%M:%S%z", rename_fields=renamed)
        case other:
            raise ConfigurationError(f"{VARIABLE} is {other!r}; it has to be text or json")
