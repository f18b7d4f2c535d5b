"""Asks an ASGI application without a server in between, byte for byte what a test wants."""

import asyncio
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

JSON = "application/json"


@dataclass(frozen=True)
class Answer:
    """What an application answered."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        """The body as JSON."""
        return json.loads(self.body)

    @property
    def error(self) -> str:
        """Name of the error, in the header and in the body."""
        assert self.headers["x-amzn-errortype"] == self.json["__type"]
        return self.json["__type"]


async def exchange(
    application: Any,
    method: str,
    target: bytes,
    headers: Sequence[tuple[bytes, bytes]],
    body: Sequence[bytes],
) -> Answer:
    """Sends a request, its body in parts, and gathers the answer."""
    raw_path, _, query = target.partition(b"?")
    scope = {
        "type": "http",
        "method": method,
        "path": raw_path.decode("latin-1"),
        "raw_path": raw_path,
        "query_string": query,
        "headers": list(headers),
        "client": ("127.0.0.1", 50000),
    }
    waiting = list(body) or [b""]
    sent: list[Any] = []

    async def receive() -> dict[str, Any]:
        part = waiting.pop(0)
        return {"type": "http.request", "body": part, "more_body": bool(waiting)}

    async def send(message: Any) -> None:
        sent.append(message)

    await application(scope, receive, send)
    start, content = sent
    names = {name.decode("latin-1"): value.decode("latin-1") for name, value in start["headers"]}
    assert int(names["content-length"]) == len(content["body"]) or method == "HEAD"
    return Answer(start["status"], names, content["body"])


class Client:
    """Sends requests to an application, one after the other."""

    def __init__(self, application: Any) -> None:
        self.application = application
        self._runner = asyncio.Runner()

    def close(self) -> None:
        """Ends the loop."""
        self._runner.close()

    def send(
        self,
        method: str,
        target: str | bytes,
        body: bytes | Sequence[bytes] = b"",
        headers: Mapping[str, str] | Sequence[tuple[bytes, bytes]] | None = None,
    ) -> Answer:
        """Sends a request exactly as given; without headers, with those of an SDK."""
        if not isinstance(headers, Sequence):
            chosen = {"host": "localhost:8080", "content-type": JSON, **(headers or {})}
            headers = [(name.lower().encode(), value.encode("latin-1")) for name, value in chosen.items() if value]
        target = target.encode("latin-1") if isinstance(target, str) else target
        parts = [body] if isinstance(body, bytes) else body
        return self._runner.run(exchange(self.application, method, target, headers, parts))

    def call(self, operation: str, **members: Any) -> Answer:
        """Calls an operation that has all members in its body."""
        return self.send("POST", f"/{operation[0].lower()}{operation[1:]}", json.dumps(members).encode())
