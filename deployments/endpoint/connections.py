"""Limits of connections: how many there are, and times for asking and for reading the answer."""

import asyncio
import resource
from dataclasses import dataclass, field
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

ENDS = "connection_ends"
"""Key of a request's state with the addresses of its connection: the client's, and this server's."""
HEAD_S = 15.0
ANSWER_S = 60.0
_MOST_CONNECTIONS = 8192
_OTHER_FILES = 128
"""Number of open files that are reserved for catalog, logs and job worker."""


def most_connections() -> int:
    """Returns how many connections the server can have while leaving files for everything else."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return _MOST_CONNECTIONS if soft < 0 else max(_OTHER_FILES, min(_MOST_CONNECTIONS, soft - _OTHER_FILES))


@dataclass(frozen=True)
class ConnectionLimits:
    """Limits on a client's connections and times, against slow or greedy clients."""

    connections: int = field(default_factory=most_connections)
    """Limit of client connections; a new one replaces the one that has been idle longest."""

    head_s: float = HEAD_S
    """Time limit for the head of a request, in seconds; for the first one from the connection's beginning."""

    answer_s: float = ANSWER_S
    """Time for which a client may stop reading its response, in seconds."""


def limited_protocol(limits: ConnectionLimits) -> type[asyncio.Protocol]:
    """Makes the uvicorn protocol class that enforces connection limits.

    Args:
        limits: Limits of each connection.
    """

    class Limited(_LimitedProtocol):
        """Protocol class of HTTP connections with the given limits."""

        def __init__(self, *arguments: Any, **named: Any) -> None:
            super().__init__(*arguments, **named)
            self.limits = limits

    return Limited


class _LimitedProtocol(H11Protocol):
    """HTTP connection of one client with limits; its methods are those that asyncio and uvicorn call."""

    limits: ConnectionLimits
    _asking: asyncio.TimerHandle | None = None
    """Timer that runs while a request's head is awaited."""
    _answering: asyncio.TimerHandle | None = None
    """Timer that runs while the client does not read its response."""
    _quiet_since = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        # `client` is what a trusted proxy says; these are the connection's own.
        self.app_state = {**self.app_state, ENDS: tuple(map(transport.get_extra_info, ("peername", "sockname")))}
        self._quiet_since = self.loop.time()
        self._asking = self.loop.call_later(self.limits.head_s, self._end)
        if len(self.connections) > self.limits.connections:
            _longest_quiet(self.connections).transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self._asking, self._answering = _ended(self._asking), _ended(self._answering)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if not self.is_quiet:
            self._asking = _ended(self._asking)
        elif self._asking is None and not self.transport.is_closing():
            self._asking = self.loop.call_later(self.limits.head_s, self._end)

    def on_response_complete(self) -> None:
        self._quiet_since = self.loop.time()
        super().on_response_complete()

    def timeout_keep_alive_handler(self) -> None:
        super().timeout_keep_alive_handler()
        self._end()

    def pause_writing(self) -> None:
        super().pause_writing()
        self._answering = self.loop.call_later(self.limits.answer_s, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()
        self._answering = _ended(self._answering)

    @property
    def is_quiet(self) -> bool:
        """Whether no request is being answered on the connection."""
        return self.cycle is None or self.cycle.response_complete

    @property
    def quiet_since(self) -> float:
        """Time since when no request is being answered on the connection."""
        return self._quiet_since

    def _end(self) -> None:
        """Closes the client's connection: after what was written, or at once if the client does not read it."""
        if self.transport.get_write_buffer_size():
            self.transport.abort()
        else:
            self.transport.close()


def _longest_quiet(connections: Any) -> _LimitedProtocol:
    """Returns the connection that is closed for a new one: the one that has been idle longest."""
    # Those that end already are still among them until the loop's next turn, and longer with TLS.
    quiet = (each for each in connections if each.is_quiet and not each.transport.is_closing())
    return min(quiet, key=lambda each: each.quiet_since)


def _ended(timer: asyncio.TimerHandle | None) -> None:
    if timer is not None:
        timer.cancel()
