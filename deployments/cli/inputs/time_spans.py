"""Spans of time as people write them: `30d`, `12h`, `1d12h`."""

import re
from datetime import timedelta

from ....schemas.wire.errors import ConfigurationError

_UNITS = {"w": "weeks", "d": "days", "h": "hours", "m": "minutes", "s": "seconds"}
_LONGEST = timedelta(days=36500)


def time_span(text: str, option: str) -> timedelta:
    """Reads a span of time.

    Args:
        text: numbers with units, the largest first: w, d, h, m, s.
        option: where it was given, for the error.

    Raises:
        ConfigurationError: it is none.
    """
    if re.fullmatch(r"(\d{1,5}w)?(\d{1,5}d)?(\d{1,5}h)?(\d{1,5}m)?(\d{1,5}s)?", text) and text:
        total = timedelta(**{_UNITS[unit]: int(number) for number, unit in re.findall(r"(\d+)([wdhms])", text)})
        if total <= _LONGEST:
            return total
    raise ConfigurationError(f"{option} is {text!r}; a time such as 30d, 12h or 1d12h would be right")
