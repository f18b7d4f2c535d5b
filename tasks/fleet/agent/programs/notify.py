"""Tells systemd that the agent is ready and alive (`Type=notify`, `WatchdogSec`), by one datagram each."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress


class Notifier:
    """Tells systemd, where the agent is one of its services; else nothing.

    Args:
        environ: the variables that systemd sets.
    """

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        self._address = environ.get("NOTIFY_SOCKET", "").replace("@", "\0", 1)
        watchdog_us = environ.get("WATCHDOG_USEC", "")
        self.interval_s: float | None = int(watchdog_us) / 2e6 if watchdog_us.isdigit() else None
        """How often `alive` has to be told; `None`: not at all."""

    def ready(self) -> None:
        """The agent runs."""
        self._send(b"READY=1")

    def alive(self) -> None:
        """It is not stuck."""
        self._send(b"WATCHDOG=1")

    def _send(self, message: bytes) -> None:
        if self._address:
            with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
                sender.sendto(message, self._address)
