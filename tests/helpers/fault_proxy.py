"""Stands between a client and an S3 server and makes trouble on demand."""

import re
import socket
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_REFUSAL = b"<?xml version='1.0'?><Error><Code>%s</Code><Message>not now</Message></Error>"
_REQUEST = re.compile(rb"(?:^|\r\n)(GET|PUT|HEAD|POST|DELETE) (\S+) HTTP/1\.1\r\n")


class FaultProxy:
    """Passes requests on, until it is told otherwise; one thread for each direction of a connection.

    Args:
        endpoint: Of the server behind it.
    """

    def __init__(self, endpoint: str) -> None:
        self._target = ("127.0.0.1", int(endpoint.rpartition(":")[2]))
        self._lock = threading.Lock()
        self._open: set[socket.socket] = set()
        self._status: tuple[int, bytes] | None = None
        self._after_puts: int | None = None
        self.puts: Counter[str] = Counter()
        """How often the content of each path was passed on to the server."""
        self.refused = 0
        """How many requests were answered with an error."""
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def answer(self, status: int, code: str, *, after_puts: int | None = None) -> None:
        """Answers every request with an error from now on, or once that many more files were passed on."""
        with self._lock:
            trouble = (status, code.encode())
            if after_puts is None:
                self._status = trouble
            else:
                self._later, self._after_puts = trouble, self.puts.total() + after_puts
        if after_puts is None:
            self.cut()

    def pass_on(self) -> None:
        """Makes no trouble any more."""
        with self._lock:
            self._status = self._after_puts = None

    def cut(self) -> None:
        """Breaks all connections; new ones are taken."""
        with self._lock:
            held, self._open = self._open, set()
        for one in held:
            _close(one)

    def close(self) -> None:
        """Ends it."""
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.cut()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        """One connection: its requests are looked at, their answers passed on as they come."""
        with suppress(OSError), client:
            first = client.recv(65536)
            if self._refuses(client, first):
                return
            with socket.create_connection(self._target) as server:
                with self._lock:
                    self._open |= {client, server}
                threading.Thread(target=_pump, args=(server, client), daemon=True).start()
                data = first
                while data:
                    server.sendall(data)
                    data = client.recv(65536)
                    if data and self._refuses(client, data):
                        break

    def _refuses(self, client: socket.socket, data: bytes) -> bool:
        """Whether a request was answered here, with an error; else what it stores is counted."""
        requests = _REQUEST.findall(data)
        if not requests:
            return False
        with self._lock:
            puts = [path.decode().partition("?")[0] for method, path in requests if method == b"PUT"]
            if self._after_puts is not None and self.puts.total() + len(puts) > self._after_puts:
                self._status, self._after_puts = self._later, None
            if self._status is None:
                self.puts.update(puts)
                return False
            self.refused += 1
            status, code = self._status
        body = b"" if requests[0][0] == b"HEAD" else _REFUSAL % code
        head = f"HTTP/1.1 {status} {code.decode()}\r\nContent-Type: application/xml\r\nConnection: close\r\n"
        client.sendall(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)
        return True


@contextmanager
def in_between(endpoint: str) -> Iterator[FaultProxy]:
    """A proxy for the time of a block."""
    proxy = FaultProxy(endpoint)
    try:
        yield proxy
    finally:
        proxy.close()


def _pump(source: socket.socket, target: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(65536):
            target.sendall(data)
    _close(target)


def _close(one: socket.socket) -> None:
    with suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)
