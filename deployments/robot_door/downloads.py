"""Sends files to robots, from where the last connection was cut."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from starlette.types import Receive, Send

from ...schemas.wire.errors import ObjectNotFoundError, StorageError
from ...tasks.fleet.ddi.orders import RobotOrder
from .answers import DoorRefusal
from .ranges import Part, part_of

ReadPart = Callable[[RobotOrder, int, int], bytes]
"""Reads that many bytes of an order's file, from an offset on; called from several threads."""

CHUNK_BYTES = 256 * 1024
_READERS = 8


def reader_of_files(path_of: Callable[[RobotOrder], Path]) -> ReadPart:
    """Reads orders' files from folders of this machine.

    Args:
        path_of: where an order's file lies.
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


class Downloads:
    """Sends files; readers run in threads, since they wait for disks and servers.

    Args:
        read: reads parts of files.
    """

    def __init__(self, read: ReadPart) -> None:
        self._read = read
        self._threads = ThreadPoolExecutor(_READERS, thread_name_prefix="robot-downloads")

    def close(self) -> None:
        """Ends the threads."""
        self._threads.shutdown(cancel_futures=True)

    async def serve(
        self, order: RobotOrder, method: str, range_: bytes | None, if_range: bytes | None, receive: Receive, send: Send
    ) -> None:
        """Answers a request for an order's file.

        Args:
            order: whose file.
            method: GET, or HEAD for the headers alone.
            range_: the header `Range`.
            if_range: the header `If-Range`.
            receive: says when the robot hung up.
            send: where the answer goes.

        Raises:
            DoorRefusal: there is no such part (416) or no such file (404), or it cannot be read now (503). Once
                bytes were sent, errors of the reader end the connection, and the robot asks for the rest.
        """
        etag = f'"{order.sha256}"'.encode()
        part = part_of(order.size_bytes, etag, range_, if_range)
        if method == "HEAD":
            await send(_head(order, etag, part))
            await send({"type": "http.response.body"})
            return
        chunk = await self._first(order, part)
        await send(_head(order, etag, part))
        gone = asyncio.ensure_future(_hung_up(receive))
        try:
            start = part.start
            while not gone.done():
                start += len(chunk)
                await send({"type": "http.response.body", "body": chunk, "more_body": start < part.stop})
                if start >= part.stop:
                    return
                chunk = await self._chunk(order, start, part.stop)
        finally:
            gone.cancel()

    async def _first(self, order: RobotOrder, part: Part) -> bytes:
        try:
            return await self._chunk(order, part.start, part.stop)
        except ObjectNotFoundError as error:
            raise DoorRefusal(404, str(error)) from error
        except StorageError as error:
            raise DoorRefusal(503, str(error)) from error

    async def _chunk(self, order: RobotOrder, start: int, stop: int) -> bytes:
        length = min(CHUNK_BYTES, stop - start)
        chunk = await asyncio.get_running_loop().run_in_executor(self._threads, self._read, order, start, length)
        if len(chunk) != length:
            raise StorageError(
                f"the file of order {order.action_id} is not the one that was ordered: "
                f"{len(chunk)} bytes at {start}, expected {length}"
            )
        return chunk


def _head(order: RobotOrder, etag: bytes, part: Part) -> dict[str, object]:
    headers = [
        (b"content-type", b"application/octet-stream"),
        (b"content-length", b"%d" % (part.stop - part.start)),
        (b"accept-ranges", b"bytes"),
        (b"etag", etag),
        (b"cache-control", b"no-store"),
    ]
    if not part.is_whole:
        headers.append((b"content-range", b"bytes %d-%d/%d" % (part.start, part.stop - 1, order.size_bytes)))
    return {"type": "http.response.start", "status": 200 if part.is_whole else 206, "headers": headers}


async def _hung_up(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
