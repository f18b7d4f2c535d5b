"""What a Prefect server's log says went wrong."""

import re

_TRACEBACK = re.compile(
    r"Traceback \(most recent call last\).*?^(?![ \t]|\s*$)(?P<error>[^\n]+)$", re.DOTALL | re.MULTILINE
)


def tracebacks(log: str) -> list[str]:
    """The last line of each traceback in a log."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", log)
    return [match["error"] for match in _TRACEBACK.finditer(plain)]


def where_it_was_stuck(log: str) -> str:
    """The stacks that a server wrote when it answered nothing for a while; none: an empty text."""
    found = re.search(r"^Timeout \(\d+:\d\d:\d\d\)!\n(?:Thread .*\n|  .*\n|\n)+", log, re.MULTILINE)
    return found[0].strip() if found else ""
