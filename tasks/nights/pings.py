"""Calls a monitoring URL when a night begins and ends, for services that raise an alarm if no call comes.

`ADDRESS/start` is called when a night begins, `ADDRESS` when it ended well, `ADDRESS/fail` when it did not, as
healthchecks.io and similar services expect. A notification, in contrast, can only come from a machine that is on.
"""

import logging
import threading
import urllib.error
import urllib.request
from collections.abc import Callable
from urllib.parse import quote, urlsplit, urlunsplit

from ...schemas.reports.run_record import RunRecord
from ...schemas.reports.run_states import shown_state

NAME = "{name}"
"""Placeholder in a monitoring URL for the name of the specification."""

_TIMEOUT_S = 10.0
"""Time limit of a call, in seconds; a night does not wait longer for a monitoring service."""

_logger = logging.getLogger(__name__)

Complain = Callable[[str], None]


def ping_start(address: str | None, name: str, run_id: str) -> threading.Thread | None:
    """Calls the monitoring URL at the start of a nightly run; returns at once.

    Args:
        address: Monitoring URL in the settings; `None`: there is none.
        name: Name of the specification.
        run_id: Id of the run.

    Returns:
        The thread that calls; `None`: there is no address.
    """
    if address is None:
        return None
    target = (address, name, "start", run_id, _logger.warning)
    thread = threading.Thread(target=_ping, args=target, name="ping", daemon=True)
    thread.start()
    return thread


def ping_end(address: str | None, record: RunRecord, complain: Complain) -> None:
    """Calls the monitoring URL at the end of a nightly run, with its result.

    Args:
        address: Monitoring URL in the settings; `None`: there is none.
        record: The run.
        complain: Called with an error text if nothing answers there.
    """
    if address is not None:
        last = "" if record.state == "succeeded" else "fail"
        _ping(address, record.name, last, f"{record.run_id}: {shown_state(record)}", complain)


def ping_address(address: str, name: str, last: str) -> str:
    """Makes the monitoring URL for a specification.

    Args:
        address: Monitoring URL in the settings.
        name: Name of the specification.
        last: The last part of the path; empty: none.
    """
    parts = urlsplit(address.replace(NAME, quote(name)))
    return urlunsplit(parts._replace(path=f"{parts.path.rstrip('/')}/{last}")) if last else urlunsplit(parts)


def _ping(address: str, name: str, last: str, words: str, complain: Complain) -> None:
    try:
        url, plain = ping_address(address, name, last), {"Content-Type": "text/plain; charset=utf-8"}
        request = urllib.request.Request(url, words.encode(), plain, method="POST")  # noqa: S310
        with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as answer:  # noqa: S310 - the setting allows http(s) only
            answer.read(1)
    except Exception as error:  # whatever breaks, a call is not worth a night; the path may be a secret
        why = f"status {error.code}" if isinstance(error, urllib.error.HTTPError) else type(error).__name__
        complain(f"the address of ROBOMAKER_PING_URL was not told {last or 'success'}: {why}")
