"""Reads bodies of robots' requests: short ones, sent in time."""

import asyncio

from starlette.types import Receive

from .answers import DoorRefusal

MAX_BODY_BYTES = 64 * 1024
TIMEOUT_S = 15.0


class Disconnected(Exception):
    """The robot hung up; there is no one to answer."""


async def read_body(receive: Receive, declared: bytes | None) -> bytes:
    """Reads a body.

    Args:
        receive: where it comes from.
        declared: the header `Content-Length`.

    Raises:
        DoorRefusal: it is too long (413), or did not arrive in time (408).
        Disconnected: the robot hung up.
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
