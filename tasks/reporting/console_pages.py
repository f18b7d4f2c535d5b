"""URLs of the web console's pages, for messages, reports and summaries.

`robomaker serve` stores its console's URL in the data home while it runs. `ROBOMAKER_CONSOLE_URL` is the URL for other
machines, and takes precedence.
"""

import ipaddress
import json
import os
import socket
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote, urlsplit

from ...schemas.settings import Settings
from ..files.whole_files import write_whole

_NOTE = "console.json"
_PATIENCE_S = 0.3
"""Seconds that a console on this machine has to accept a connection; a lost console must not delay a summary."""


class ConsolePages(NamedTuple):
    """URLs of the pages of a web console."""

    url: str = ""
    """URL of the console, without a trailing slash; empty: no console is known, and all page URLs are empty."""

    def run(self, run_id: str) -> str:
        """Returns the URL of a run's page; empty if no console is known."""
        return f"{self.url}/runs/{quote(run_id)}" if self.url else ""

    def job(self, arn: str | None) -> str:
        """Returns the URL of a simulation job's page; empty if no console or no job is known."""
        return f"{self.url}/jobs/{quote(arn.rpartition('/')[2])}" if self.url and arn else ""


NO_CONSOLE = ConsolePages()
"""Console pages whose URLs are all empty, as no console is known."""


def pages_here(settings: Settings) -> ConsolePages:
    """Returns the console pages that a browser on this machine can open, possibly pages of this machine only."""
    return ConsolePages(settings.console_url or _running(settings.home))


def pages_elsewhere(settings: Settings) -> ConsolePages:
    """Returns the console pages that a browser on another machine can open."""
    url = settings.console_url or _running(settings.home)
    return ConsolePages("" if _is_of_this_machine(url) and not settings.console_url else url)


def note_console(home: Path, url: str, prefect_url: str | None = None) -> None:
    """Stores the URL of this process's console in the data home, in place of any other one.

    Args:
        home: Data home.
        url: URL of the console.
        prefect_url: URL of the Prefect server by which this process carries out jobs; None: it carries out none.
    """
    note = {"url": url, "pid": os.getpid(), "home": str(home), "prefect_url": prefect_url}
    write_whole(home / _NOTE, json.dumps(note))


def served_with(home: Path, prefect_url: str) -> str:
    """Describes the `robomaker serve` of a data home that carries out jobs by a Prefect server; empty: none runs.

    Args:
        home: Data home.
        prefect_url: URL of the Prefect server.
    """
    note, url = _read(home), _running(home)
    return (
        f"robomaker serve at {url}, process {note.get('pid')}" if url and note.get("prefect_url") == prefect_url else ""
    )


def forget_console(home: Path) -> None:
    """Deletes the stored URL of the console, unless another server stored it."""
    if _read(home).get("pid") == os.getpid():
        (home / _NOTE).unlink(missing_ok=True)


def _running(home: Path) -> str:
    """Returns the console's URL that `robomaker serve` has stored; empty if no server answers there."""
    url = str(_read(home).get("url"))
    try:
        place = urlsplit(url)
        if place.hostname is not None and place.port is not None:
            with socket.create_connection((place.hostname, place.port), _PATIENCE_S):
                return url
    except (OSError, ValueError):  # no server listens, or the note is damaged
        pass
    return ""


def _is_of_this_machine(url: str) -> bool:
    host = urlsplit(url).hostname or "localhost"
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost" or host.endswith(".localhost")


def _read(home: Path) -> dict[str, object]:
    with suppress(OSError, ValueError):
        note = json.loads((home / _NOTE).read_bytes())
        # A copied home has the note of the home that it was copied from.
        return note if isinstance(note, dict) and note.get("home", str(home)) == str(home) else {}
    return {}
