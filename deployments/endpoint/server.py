"""Runs the endpoint on a port, over HTTP or HTTPS, until it is told to stop."""

import contextlib
import logging
import signal
import socket
import ssl
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Self

import uvicorn
from starlette.types import ASGIApp

from ...schemas.wire.errors import ConfigurationError
from .connections import ConnectionLimits, limited_protocol
from .origins import is_address, is_loopback


@dataclass(frozen=True)
class TlsFiles:
    """TLS certificate chain and private key of the server, as PEM files."""

    certificate: Path
    key: Path

    @classmethod
    def checked(cls, certificate: str | None, key: str | None) -> Self | None:
        """Checks the TLS files; `None` if none are given.

        Raises:
            ConfigurationError: Certificate or key is missing, cannot be read or used, or they do not belong together.
        """
        if certificate is None and key is None:
            return None
        if certificate is None or key is None:
            given, missing = ("key", "certificate") if certificate is None else ("certificate", "key")
            raise ConfigurationError(f"--tls-{given} is given, and --tls-{missing} is not; HTTPS needs both")
        files = cls(Path(certificate), Path(key))
        for option, path in (("--tls-certificate", files.certificate), ("--tls-key", files.key)):
            try:
                path.read_bytes()
            except OSError as error:
                raise ConfigurationError(f"{option} {path}: {error.strerror}") from error
        files._check()
        return files

    def _check(self) -> None:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        try:
            # Without this answer a key that has a password would be asked for at the terminal.
            context.load_cert_chain(self.certificate, self.key, password=lambda: "")
        except ssl.SSLError as error:
            if error.reason == "KEY_VALUES_MISMATCH":
                raise ConfigurationError(f"--tls-key {self.key} is not the key of {self.certificate}") from error
            raise ConfigurationError(
                f"--tls-certificate {self.certificate} and --tls-key {self.key} have to be PEM files, "
                f"the key without a password: {error.reason or error}"
            ) from error


LOGGER = logging.getLogger("robomaker.endpoint")

KEEP_ALIVE_S = 75
"""Time that an idle connection is kept open, in seconds.

It is longer than SDKs keep theirs, so that they do not meet a closed one.
"""

GRACE_S = 30
"""Time for requests in progress to finish after a signal to stop, in seconds."""

_BACKLOG = 512


def run_server(
    application: ASGIApp,
    host: str,
    port: int,
    *,
    ready: Callable[[int], None],
    stopping: Callable[[], None] = lambda: None,
    tls: TlsFiles | None = None,
    limits: ConnectionLimits | None = None,
    proxies: Sequence[str] = (),
) -> None:
    """Runs the HTTP server until SIGTERM or SIGINT.

    Args:
        application: The application to serve.
        host: Name or address to listen at.
        port: TCP port; 0: any free one.
        ready: Called with the port once requests are answered.
        stopping: Called at a signal to stop, before requests in progress are waited for, so that they end.
        tls: Certificate and key for HTTPS; `None`: HTTP.
        limits: Limits of connections and times; `None`: the default ones.
        proxies: Addresses and networks of proxies whose `X-Forwarded-For` and `X-Forwarded-Proto` are true.

    Raises:
        ConfigurationError: The address or port cannot be listened on.
        KeyboardInterrupt: SIGINT was received twice, and the requests in progress were not waited for.
    """
    with listening(host, port) as listener:
        if not is_loopback(host) and not getattr(application, "checks_signatures", False):
            LOGGER.warning(
                "%s can be reached from other machines, and requests need no signature: "
                "configure access keys, or listen at 127.0.0.1",
                host,
            )
        config = uvicorn.Config(
            application,
            # Always the same parser, and so the same answers to odd requests, whatever else is installed.
            http=limited_protocol(limits or ConnectionLimits()),
            ws="none",
            log_config=None,
            log_level=logging.WARNING,
            access_log=False,
            server_header=False,
            proxy_headers=bool(proxies),
            forwarded_allow_ips=list(proxies),
            timeout_keep_alive=KEEP_ALIVE_S,
            timeout_graceful_shutdown=GRACE_S,
            ssl_certfile=tls and tls.certificate,
            ssl_keyfile=tls and tls.key,
        )
        server = _Server(config, listener, ready, stopping)
        server.run(sockets=[listener])
    if server.force_exit:
        raise KeyboardInterrupt


@contextlib.contextmanager
def listening(host: str, port: int) -> Iterator[socket.socket]:
    """Opens a listening socket inside the `with` block.

    Raises:
        ConfigurationError: The address or port cannot be listened on.
    """
    family = socket.AF_INET6 if is_address(host) and ":" in host else socket.AF_INET
    try:
        listener = socket.create_server((host.strip("[]"), port), family=family, backlog=_BACKLOG)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ConfigurationError(f"cannot listen at {host} port {port}: {reason}; choose another") from error
    with listener:
        # Connections inherit it. asyncio sets it only on sockets that name their protocol, which this one does not;
        # without it every answer, head first and then the body, waits 40 ms for the client's acknowledgement.
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        yield listener


class _Server(uvicorn.Server):
    """uvicorn server that reports when it is ready, and returns when it is stopped."""

    def __init__(
        self,
        config: uvicorn.Config,
        listener: socket.socket,
        ready: Callable[[int], None],
        stopping: Callable[[], None],
    ) -> None:
        super().__init__(config)
        self._listener = listener
        self._ready = ready
        self._stopping = stopping

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Starts to answer HTTP requests, and then reports the port as ready."""
        await super().startup(sockets)
        self._ready(self._listener.getsockname()[1])

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Ends endless response streams, then waits for other responses."""
        self._stopping()
        await super().shutdown(sockets)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Stops the server on SIGINT and SIGTERM in the block, without passing them on to the caller as uvicorn does.

        The former handlers are set again at the end. Outside of the main thread it does nothing.
        """
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self._stop) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self.handle_exit(number, frame)
