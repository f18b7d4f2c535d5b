"""Sends files to robots, from where the last connection was cut."""

import asyncio
import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from starlette.types import Receive, Send

from ....schemas.wire.errors import ObjectNotFoundError, StorageError
from ....tasks.fleet.ddi.orders import RobotOrder
from .robot_answers import DoorRefusal

_RANGE = re.compile(rb"bytes=(\d{0,18})-(\d{0,18})")


@dataclass(frozen=True)
class Part:
    """A byte range of a file, from `start` to before `stop`."""

    start: int
    stop: int
    is_whole: bool
    """Whether the whole file was requested, so that the response has status 200 and not 206."""


def part_of(size_bytes: int, etag: bytes, range_: bytes | None, if_range: bytes | None) -> Part:
    """Determines the byte range of a file that an HTTP request asks for.

    Several ranges, other units, and what cannot be read count as asking for the whole file.

    Args:
        size_bytes: Length of the file.
        etag: The file's, with its quotes.
        range_: The header `Range`.
        if_range: The header `If-Range`: another file than that has to be read from its beginning.

    Raises:
        DoorRefusal: The file has no such part (416).
    """
    whole = Part(0, size_bytes, True)
    found = _RANGE.fullmatch((range_ or b"").strip())
    if found is None or found.groups() == (b"", b"") or (if_range is not None and if_range.strip() != etag):
        return whole
    first, last = found.groups()
    if first:
        start, stop = int(first), int(last) + 1 if last else size_bytes
        if last and stop <= start:
            return whole
    else:
        start, stop = max(0, size_bytes - int(last)), size_bytes
    if start >= size_bytes:
        raise DoorRefusal(416, f"the file has {size_bytes} bytes", [(b"content-range", b"bytes */%d" % size_bytes)])
    return Part(start, min(stop, size_bytes), False)


Result = TypeVar("Result")

ReadPart = Callable[[RobotOrder, int, int], bytes]
"""Function that reads that many bytes of an order's file, from an offset on; called from several threads."""

CHUNK_BYTES = 256 * 1024
_READERS = 8


def reader_of_files(path_of: Callable[[RobotOrder], Path]) -> ReadPart:
    """Makes a function that reads parts of orders' files from local folders.

    Args:
        path_of: Returns the local path of an order's file.
    """

    def read(order: RobotOrder, start: int, length: int) -> bytes:
        try:
            with path_of(order).open("rb") as file:
                file.seek(start)
                return file.read(length)
        except FileNotFoundError as error:
            raise ObjectNotFoundError(f"the file of order {order.action_id} is gone: {error}") from error
        except OSError as error:
            raise StorageError(f"the file of order {order.action_id} cannot be read: {error}") from error

    return read


@dataclass(frozen=True)
class ServedFile:
    """An unchangeable file that can be downloaded by robots."""

    name: str
    """Name of a served file in error messages."""

    size_bytes: int
    sha256: str
    """SHA-256 of a served file, used as its `ETag`."""

    read: Callable[[int, int], bytes]
    """Function that reads that many bytes from an offset on; called from several threads."""


class Downloads:
    """Sends files to robots; reads them in threads.

    Args:
        read: Reads parts of orders' files.
    """

    def __init__(self, read: ReadPart) -> None:
        self._read = read
        self._threads = ThreadPoolExecutor(_READERS, thread_name_prefix="robot-downloads")

    def close(self) -> None:
        """Ends the threads that read files."""
        self._threads.shutdown(cancel_futures=True)

    async def run(self, call: Callable[[], Result]) -> Result:
        """Runs a function that waits for disks or servers, in a thread.

        Raises:
            DoorRefusal: There is no such file (404), or it cannot be read now (503).
        """
        try:
            return await asyncio.get_running_loop().run_in_executor(self._threads, call)
        except ObjectNotFoundError as error:
            raise DoorRefusal(404, str(error)) from error
        except StorageError as error:
            raise DoorRefusal(503, str(error)) from error

    async def serve(
        self, order: RobotOrder, method: str, range_: bytes | None, if_range: bytes | None, receive: Receive, send: Send
    ) -> None:
        """Answers a robot's request for its order's file; see `serve_file`."""
        name = f"the file of order {order.action_id}"
        file = ServedFile(name, order.size_bytes, order.sha256, partial(self._read, order))
        await self.serve_file(file, method, range_, if_range, receive, send)

    async def serve_file(
        self, file: ServedFile, method: str, range_: bytes | None, if_range: bytes | None, receive: Receive, send: Send
    ) -> None:
        """Answers an HTTP request for a file, with support for byte ranges.

        Args:
            file: The file.
            method: GET, or HEAD for the headers alone.
            range_: The header `Range`.
            if_range: The header `If-Range`.
            receive: Receives ASGI messages, such as that the robot disconnected.
            send: Sends the ASGI messages of the response.

        Raises:
            DoorRefusal: There is no such part (416) or no such file (404), or it cannot be read now (503). Once
                bytes were sent, errors of the reader end the connection, and the robot asks for the rest.
        """
        etag = f'"{file.sha256}"'.encode()
        part = part_of(file.size_bytes, etag, range_, if_range)
        if method == "HEAD" or part.start >= part.stop:
            await send(_head(file, etag, part))
            await send({"type": "http.response.body"})
            return
        chunk = await self.run(lambda: _chunk(file, part.start, part.stop))
        await send(_head(file, etag, part))
        gone = asyncio.ensure_future(_hung_up(receive))
        try:
            start = part.start
            while not gone.done():
                start += len(chunk)
                await send({"type": "http.response.body", "body": chunk, "more_body": start < part.stop})
                if start >= part.stop:
                    return
                chunk = await asyncio.get_running_loop().run_in_executor(self._threads, _chunk, file, start, part.stop)
        finally:
            gone.cancel()


def _chunk(file: ServedFile, start: int, stop: int) -> bytes:
    length = min(CHUNK_BYTES, stop - start)
    chunk = file.read(start, length)
    if len(chunk) != length:
        raise StorageError(
            f"{file.name} is not the one that was ordered: {len(chunk)} bytes at {start}, expected {length}"
        )
    return chunk


def _head(file: ServedFile, etag: bytes, part: Part) -> dict[str, object]:
    headers = [
        (b"content-type", b"application/octet-stream"),
        (b"content-length", b"%d" % (part.stop - part.start)),
        (b"accept-ranges", b"bytes"),
        (b"etag", etag),
        (b"cache-control", b"no-store"),
    ]
    if not part.is_whole:
        headers.append((b"content-range", b"bytes %d-%d/%d" % (part.start, part.stop - 1, file.size_bytes)))
    return {"type": "http.response.start", "status": 200 if part.is_whole else 206, "headers": headers}


async def _hung_up(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
