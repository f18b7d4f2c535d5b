"""Bounds on what one client can take from the others: the length of bodies, and how long they may take."""

import asyncio

from .messages import ASGIReceive, RequestEntityTooLargeException, RequestTimeoutException

BODY_TIMEOUT_S = 60.0


class ClientGone(Exception):
    """The client hung up before it had sent everything."""


async def read_body(receive: ASGIReceive, declared: str | None, max_bytes: int) -> bytes:
    """Reads a request's body.

    Args:
      receive: gives the next part.
      declared: the header `Content-Length`.
      max_bytes: how much is taken at most.

    Raises:
      RequestEntityTooLargeException: the body is longer; the rest is left unread.
      RequestTimeoutException: it did not arrive in time.
      ClientGone: nobody waits for an answer any more.
    """
    if declared is not None and declared.isdecimal() and (len(declared) > 18 or int(declared) > max_bytes):
        raise _too_large(max_bytes)
    try:
        async with asyncio.timeout(BODY_TIMEOUT_S):
            return await _read(receive, max_bytes)
    except TimeoutError:
        raise RequestTimeoutException(f"the body did not arrive within {BODY_TIMEOUT_S:g} seconds") from None


async def _read(receive: ASGIReceive, max_bytes: int) -> bytes:
    parts: list[bytes] = []
    length = 0
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise ClientGone
        part = message.get("body", b"")
        length += len(part)
        if length > max_bytes:
            raise _too_large(max_bytes)
        parts.append(part)
        if not message.get("more_body", False):
            return b"".join(parts)


def _too_large(max_bytes: int) -> RequestEntityTooLargeException:
    return RequestEntityTooLargeException(f"the body may have at most {max_bytes} bytes")
