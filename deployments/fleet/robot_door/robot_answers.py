"""HTTP responses to robots, and reading of request bodies.

Success is always 200: clients accept neither 201 nor 204.
"""

import asyncio
import json
from collections.abc import Iterable

from starlette.types import Receive, Send

from ....schemas.wire.errors import RobomakerError

HAL = b"application/hal+json"
"""Media type of documents that robots read."""

_JSON = b"application/json"
_CODES = {
    400: "request.invalid",
    401: "token.missing-or-wrong",
    404: "not-found",
    405: "not-allowed",
    408: "request.timeout",
    410: "action.gone",
    413: "request.too-large",
    416: "range.not-satisfiable",
    429: "quota.exceeded",
    503: "unavailable",
}

Headers = Iterable[tuple[bytes, bytes]]


class DoorRefusal(RobomakerError):
    """Raised for a robot's request that is refused, with HTTP status and reason."""

    def __init__(self, status: int, message: str, headers: Headers = ()) -> None:
        super().__init__(message)
        self.status = status
        """HTTP status of the response that refuses a robot's request."""

        self.headers = tuple(headers)
        """HTTP headers of the refusal in addition to the usual ones."""


async def send_document(send: Send, document: bytes) -> None:
    """Sends a JSON document (or an empty body) to a robot, as HAL JSON."""
    await _send(send, 200, document, HAL)


async def send_plain(send: Send, document: bytes) -> None:
    """Sends a plain JSON document to a robot."""
    await _send(send, 200, document, _JSON)


async def send_refusal(send: Send, refusal: DoorRefusal) -> None:
    """Sends an error response to a robot."""
    body = {"errorCode": f"robomaker.{_CODES[refusal.status]}", "message": str(refusal)}
    await _send(send, refusal.status, json.dumps(body).encode(), _JSON, refusal.headers)


async def _send(send: Send, status: int, body: bytes, media_type: bytes, headers: Headers = ()) -> None:
    await send(
        {
            "type": "http.response.start",
            "status": status,
            "headers": [
                (b"content-type", media_type),
                (b"content-length", b"%d" % len(body)),
                (b"cache-control", b"no-store"),
                *headers,
            ],
        }
    )
    await send({"type": "http.response.body", "body": body})


MAX_BODY_BYTES = 64 * 1024
TIMEOUT_S = 15.0


class Disconnected(Exception):
    """Raised when the robot has closed the connection."""


async def read_body(receive: Receive, declared: bytes | None) -> bytes:
    """Reads the body of a robot's request, with limits on size and time.

    Args:
        receive: Receives the ASGI messages of the body.
        declared: The header `Content-Length`.

    Raises:
        DoorRefusal: The body is too long (413), or did not arrive in time (408).
        Disconnected: The robot hung up.
    """
    if declared is not None and (len(declared) > 18 or not declared.isdigit() or int(declared) > MAX_BODY_BYTES):
        raise _too_long()
    body = bytearray()
    try:
        async with asyncio.timeout(TIMEOUT_S):
            while True:
                message = await receive()
                if message["type"] == "http.disconnect":
                    raise Disconnected
                body += message.get("body", b"")
                if len(body) > MAX_BODY_BYTES:
                    raise _too_long()
                if not message.get("more_body"):
                    return bytes(body)
    except TimeoutError:
        raise DoorRefusal(408, f"the body did not arrive within {TIMEOUT_S:g} s") from None


def _too_long() -> DoorRefusal:
    return DoorRefusal(413, f"the body may have at most {MAX_BODY_BYTES} bytes")
