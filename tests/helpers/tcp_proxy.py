"""A proxy of TCP connections that makes a network bad: slow, silent, or cut."""

import asyncio
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

_CHUNK_BYTES = 65_536


class TcpProxy:
    """Passes connections on to a port of this machine; its methods may be called from any thread.

    Args:
        target: The port that connections are passed on to.
    """

    def __init__(self, target: int) -> None:
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._loop = asyncio.new_event_loop()
        self._flows = asyncio.Event()
        self._delay_s = 0.0
        self._open: set[asyncio.StreamWriter] = set()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def cut(self) -> None:
        """Resets all connections; new ones are taken."""
        self._soon(lambda: [writer.transport.abort() for writer in list(self._open)])

    def silence(self) -> None:
        """Passes nothing on, and takes connections all the same, until `restore`."""
        self._soon(self._flows.clear)

    def slow(self, delay_s: float) -> None:
        """Delays whatever is passed on, until `restore`."""
        self._soon(lambda: setattr(self, "_delay_s", delay_s))

    def restore(self) -> None:
        """Ends silence and slowness."""
        self.slow(0.0)
        self._soon(self._flows.set)

    def close(self) -> None:
        """Ends all connections, and takes no more."""
        self.cut()
        self._soon(self._loop.stop)
        self._thread.join(10)

    def _soon(self, act: Callable[[], object]) -> None:
        self._loop.call_soon_threadsafe(act)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._flows.set()
        server = self._loop.run_until_complete(asyncio.start_server(self._serve, sock=self._listener))
        self._loop.run_forever()
        server.close()
        for task in asyncio.all_tasks(self._loop):
            task.cancel()
        self._loop.run_until_complete(asyncio.sleep(0))
        self._loop.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open.add(writer)
        try:
            there_reader, there_writer = await asyncio.open_connection("127.0.0.1", self._target)
        except OSError:
            writer.transport.abort()
            self._open.discard(writer)
            return
        self._open.add(there_writer)
        try:
            await asyncio.gather(self._pass(reader, there_writer), self._pass(there_reader, writer))
        finally:
            for each in (writer, there_writer):
                self._open.discard(each)
                each.transport.abort()

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while data := await reader.read(_CHUNK_BYTES):
                await self._flows.wait()
                if self._delay_s:
                    await asyncio.sleep(self._delay_s)
                writer.write(data)
                await writer.drain()
            if writer.can_write_eof():
                writer.write_eof()


@contextmanager
def tcp_proxy(target: int) -> Iterator[TcpProxy]:
    """A proxy for the block."""
    proxy = TcpProxy(target)
    try:
        yield proxy
    finally:
        proxy.close()
