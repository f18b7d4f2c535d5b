"""Servers that take notifications: a webhook and a mail server, on this machine; both keep what they got."""

import email
import email.policy
import json
import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from email.message import EmailMessage
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest


@dataclass
class Webhook:
    """Takes JSON; answers `status`."""

    address: str = ""
    """Host and port."""

    status: int = 200
    wait: threading.Event | None = None
    """Answers only when it is set."""

    got: list[dict[str, Any]] = field(default_factory=list)
    """Messages that were sent; plain text as `text`."""

    paths: list[str] = field(default_factory=list)


@dataclass
class MailServer:
    """Takes mail from anybody."""

    address: str = ""
    got: list[EmailMessage] = field(default_factory=list)


@pytest.fixture
def webhook() -> Iterator[Webhook]:
    """A webhook at `webhook.address`."""
    hook = Webhook()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            content = self.rfile.read(int(self.headers["Content-Length"]))
            is_text = not self.headers["Content-Type"].endswith("json")
            hook.paths.append(self.path)
            hook.got.append({"text": content.decode()} if is_text else json.loads(content))
            if hook.wait is not None:
                hook.wait.wait(200)
            self.send_response(hook.status)
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - as the library calls it
            """Says nothing."""

    with _serving(ThreadingHTTPServer(("127.0.0.1", 0), Handler)) as hook.address:
        yield hook


@pytest.fixture
def mail_server() -> Iterator[MailServer]:
    """A mail server at `mail_server.address`, without login and TLS."""
    server = MailServer()

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            self._say("220 test")
            while line := self.rfile.readline().decode().strip():
                word = line.partition(" ")[0].upper()
                if word == "DATA":
                    self._say("354 go on")
                    server.got.append(self._message())
                self._say("221 bye" if word == "QUIT" else "250 ok")
                if word == "QUIT":
                    return

        def _say(self, line: str) -> None:
            self.wfile.write(f"{line}\r\n".encode())

        def _message(self) -> EmailMessage:
            lines = list(iter(self.rfile.readline, b".\r\n"))
            content = b"".join(line.removeprefix(b".") if line.startswith(b"..") else line for line in lines)
            return email.message_from_bytes(content, policy=email.policy.default)  # type: ignore[return-value]

    with _serving(socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler)) as server.address:
        yield server


@contextmanager
def _serving(server: socketserver.TCPServer) -> Iterator[str]:
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
