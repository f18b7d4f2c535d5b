"""Bodies of requests: how many are received at once, and limits on the size and the time of each."""

import asyncio
from collections.abc import Iterator
from contextlib import aclosing, contextmanager

from ...schemas.wire.errors import ThrottlingException
from .protocol_errors import RequestEntityTooLargeException, RequestTimeoutException
from .service_requests import ServiceRequest

SMALL_BODY_BYTES = 64 * 1024
"""Size limit of a small body, in bytes; nearly all requests are smaller. Small and large bodies are counted apart."""

SMALL_BODIES = 512
LARGE_BODIES = 24
"""Limit of large request bodies that are received at once; together they fit into memory."""

SMALL_BODY_TIMEOUT_S = 15.0
LARGE_BODY_TIMEOUT_S = 60.0


class Arrivals:
    """Counts request bodies that are being received."""

    def __init__(self) -> None:
        self._arriving = {True: 0, False: 0}

    @contextmanager
    def admitted(self, declared: str | None) -> Iterator[float]:
        """Admits a request body, or raises an error if too many are being received; yields its time limit in seconds.

        Args:
            declared: The header `Content-Length`; `None` without that header, which counts as large.

        Yields:
            Time limit for the body, in seconds.

        Raises:
            ThrottlingException: Too many are on their way already.
        """
        is_small = declared is not None and declared.isdecimal() and int(declared[:18]) <= SMALL_BODY_BYTES
        if self._arriving[is_small] >= (SMALL_BODIES if is_small else LARGE_BODIES):
            raise ThrottlingException(f"{self._arriving[is_small]} requests are being received")
        self._arriving[is_small] += 1
        try:
            yield SMALL_BODY_TIMEOUT_S if is_small else LARGE_BODY_TIMEOUT_S
        finally:
            self._arriving[is_small] -= 1


async def read_body(request: ServiceRequest, declared: str | None, max_bytes: int, timeout_s: float) -> bytes:
    """Reads a request's body, with limits on size and time.

    Args:
        request: The request, whose body has not been read.
        declared: The header `Content-Length`.
        max_bytes: Size limit of the body, in bytes.
        timeout_s: Time limit for the body, in seconds.

    Raises:
        RequestEntityTooLargeException: The body is longer; the rest is left unread.
        RequestTimeoutException: The body did not arrive in time.
        ClientDisconnect: The client hung up.
    """
    if declared is not None and declared.isdecimal() and (len(declared) > 18 or int(declared) > max_bytes):
        raise _too_large(max_bytes)
    try:
        async with asyncio.timeout(timeout_s):
            return await _read(request, max_bytes)
    except TimeoutError:
        raise RequestTimeoutException(f"the body did not arrive within {timeout_s:g} seconds") from None


async def _read(request: ServiceRequest, max_bytes: int) -> bytes:
    body = bytearray()
    async with aclosing(request.stream()) as parts:
        async for part in parts:
            body += part
            if len(body) > max_bytes:
                raise _too_large(max_bytes)
    return bytes(body)


def _too_large(max_bytes: int) -> RequestEntityTooLargeException:
    return RequestEntityTooLargeException(f"the body may have at most {max_bytes} bytes")
