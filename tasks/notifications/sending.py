"""Sends a message to notification channels through apprise."""

import logging
import re
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from .notification_texts import Message

if TYPE_CHECKING:
    from apprise import AppriseAttachment
    from apprise.attachment.base import AttachBase
    from apprise.plugins.base import NotifyBase

_logger = logging.getLogger(__name__)

TIMEOUT_S = 60.0
"""Time limit for sending a notification to all channels together, in seconds."""


def send(
    urls: Sequence[str], message: Message, pictures: Mapping[str, bytes], timeout_s: float = TIMEOUT_S
) -> list[str]:
    """Sends a message to every notification channel at once; returns the errors.

    Args:
        urls: Apprise's addresses, such as `json://host/path`, `mailtos://user:password@host` or `slack://…`.
        message: The message.
        pictures: PNG files by name, for channels that can attach.
        timeout_s: Time limit for all channels, in seconds.

    Returns:
        For each channel that did not take it, which it is and why; without its secrets.
    """
    problems: dict[int, str] = {}
    channels = _channels(urls)
    # Not daemons of an executor: a channel that hangs must not keep the program from ending.
    threads = [
        threading.Thread(target=_send_to, args=(place, channel, message, pictures, problems), daemon=True)
        for place, channel in enumerate(channels)
    ]
    for place, thread in enumerate(threads):
        problems[place] = f"{_named(place)}: no answer within {timeout_s:g} s"
        thread.start()
    left_s = timeout_s
    for thread in threads:
        began = time.monotonic()
        thread.join(left_s)
        left_s = max(left_s - (time.monotonic() - began), 0.0)
    return [problem for _, problem in sorted(problems.copy().items()) if problem]


def unknown_channels(urls: Sequence[str]) -> list[str]:
    """Lists invalid notification URLs by position, not by content, because they may hold secrets."""
    return [_unknown(place) for place, channel in enumerate(_channels(urls)) if channel is None]


def _channels(urls: Sequence[str]) -> "list[NotifyBase | None]":
    """Converts URLs to apprise's channels; `None` for URLs that apprise does not understand."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # one of its modules imports what Python 3.13 has not
        import apprise

        return [apprise.Apprise.instantiate(url, suppress_exceptions=True) or None for url in urls]


def _send_to(
    place: int,
    channel: "NotifyBase | None",
    message: Message,
    pictures: Mapping[str, bytes],
    problems: dict[int, str],
) -> None:
    import apprise

    if channel is None:
        problems[place] = _unknown(place)
        return
    try:
        with tempfile.TemporaryDirectory(prefix="robomaker-notify-") as folder:
            kind = apprise.NotifyType.SUCCESS if message.good else apprise.NotifyType.FAILURE
            paths = _written(pictures, Path(folder)) if channel.attachment_support else []
            told = apprise.Apprise()
            told.add(channel)
            with _complaints() as said:
                sent = told.notify(
                    body=message.body, title=message.title, notify_type=kind, attach=apprise.AppriseAttachment(paths)
                )
        problems[place] = "" if sent else f"{_named(place)}, {_shown(channel)}: {' '.join(said) or 'refused'}"
    except Exception as error:  # whatever a channel's code raises: the run has ended, and goes on to say so
        _logger.debug("a channel of apprise broke", exc_info=True)
        problems[place] = f"{_named(place)}, {_shown(channel)}: {type(error).__name__}"  # its text may hold secrets


def _unknown(place: int) -> str:
    return f"{_named(place)} is no address that apprise knows"


def _named(place: int) -> str:
    return f"channel {place + 1} of ROBOMAKER_NOTIFY"


@contextmanager
def _complaints() -> Iterator[list[str]]:
    """Collects the warnings of the library that sends messages, in this thread and inside the block."""
    said: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.addFilter(lambda record: record.thread == threading.get_ident())
    handler.emit = lambda record: said.append(record.getMessage())  # type: ignore[method-assign]
    logger = logging.getLogger("apprise")
    logger.addHandler(handler)
    try:
        yield said
    finally:
        logger.removeHandler(handler)


def _shown(channel: "NotifyBase") -> str:
    """Describes a channel by service and host only, `mailto://host`, as user and path may be secrets."""
    service, _, rest = str(channel.url(privacy=True)).partition("://")
    return f"{service}://{re.split('[/?]', rest)[0].rpartition('@')[2]}"


def _written(pictures: Mapping[str, bytes], folder: Path) -> "list[str | AttachBase | AppriseAttachment]":
    paths: list[str | AttachBase | AppriseAttachment] = []
    for name, content in pictures.items():
        path = folder / name
        path.write_bytes(content)
        paths.append(str(path))
    return paths
