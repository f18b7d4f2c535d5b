"""Note in a data home with the console's address, present while `robomaker serve` runs, for printing links."""

import json
import os
import socket
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

from .console.rendering import HOME

_NOTE = "console.json"
_PATIENCE_S = 0.3


def note_console(home: Path, url: str) -> None:
    """Records the URL of this process's web console in the data home."""
    part = home / f".{_NOTE}.{os.getpid()}.part"
    part.write_text(json.dumps({"url": url, "pid": os.getpid()}))
    part.replace(home / _NOTE)


def forget_console(home: Path) -> None:
    """Deletes the record of the web console's URL, unless it is another server's."""
    if _read(home).get("pid") == os.getpid():
        (home / _NOTE).unlink(missing_ok=True)


def console_of(home: Path) -> str:
    """Returns the URL of a data home's web console; empty while no server answers there."""
    url = _read(home).get("url")
    place = urlsplit(url) if isinstance(url, str) else None
    if place is None or place.hostname is None or place.port is None:
        return ""
    try:
        with socket.create_connection((place.hostname, place.port), _PATIENCE_S):
            return f"{url}{HOME}"
    except OSError:
        return ""


def _read(home: Path) -> dict[str, object]:
    with suppress(OSError, ValueError):
        note = json.loads((home / _NOTE).read_bytes())
        return note if isinstance(note, dict) else {}
    return {}
