"""Forwarding of applications' ports to other port numbers, on this machine only."""

import asyncio
import os
import signal
import socket
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from ....schemas.runs.programs import PortPlan
from ....schemas.wire.errors import LaunchError
from ..limits.processes import die_with_parent

_HOST = "127.0.0.1"
_LISTENS = "0A"
"""State of a listening socket in `/proc/net/tcp`."""

_CHUNK_BYTES = 64 * 1024
_FAILURE_CODE = "InvalidInput"


def open_ports(ports: Sequence[PortPlan], *, is_shared: bool = True) -> list[tuple[socket.socket, int]]:
    """Opens listening sockets for the job's forwarded ports.

    Args:
        ports: Ports to forward. A port that keeps its number is only checked, as the application itself will listen on
            it.
        is_shared: Whether the application shares this process's network; otherwise all its ports are forwarded.

    Returns:
        Listening sockets, each with the application's port.

    Raises:
        LaunchError: A port is taken, or not for this user; names it.
    """
    opened: list[tuple[socket.socket, int]] = []
    try:
        for port in ports:
            listening = _listen(port)
            if is_shared and port.job_port == port.application_port:
                listening.close()
            else:
                opened.append((listening, port.application_port))
    except LaunchError:
        for listening, _ in opened:
            listening.close()
        raise
    return opened


def are_listened_on(ports: Sequence[PortPlan], pid: int) -> bool:
    """Returns whether applications listen on all forwarded ports, without connecting, which could disturb them.

    Args:
        ports: Forwarded ports.
        pid: A process in the applications' network.
    """
    listening: set[int] = set()
    for table in ("tcp", "tcp6"):
        with suppress(OSError):  # the process has ended, or there is no IPv6
            lines = Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]
            fields = (line.split() for line in lines)
            listening |= {int(local.rpartition(":")[2], 16) for _, local, _, state, *_ in fields if state == _LISTENS}
    return all(port.application_port in listening for port in ports)


def _listen(port: PortPlan) -> socket.socket:
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((_HOST, port.job_port))
        listening.listen()
    except OSError as error:
        listening.close()
        raise LaunchError(
            f"portForwardingConfig: jobPort {port.job_port} (of applicationPort {port.application_port}) cannot be "
            f"opened on {_HOST}: {error.strerror}; choose one that is free, or wait until its owner has ended",
            _FAILURE_CODE,
        ) from error
    return listening


def fork_forwarder(ports: Sequence[tuple[socket.socket, int]], join_network: Callable[[], None] = lambda: None) -> int:
    """Starts a child process that forwards connections to the application's ports; returns its process id.

    This process closes its copies of the sockets; the child keeps them, in the network in which they were opened. The
    child ignores SIGTERM, and ends with this process.

    Args:
        ports: Listening sockets, each with the application's port.
        join_network: Function that moves the child into the application's network.
    """
    parent = os.getpid()
    pid = os.fork()
    if pid == 0:
        try:
            os.setsid()
            signal.signal(signal.SIGTERM, signal.SIG_IGN)  # ends last, when the run has ended
            die_with_parent()
            if os.getppid() == parent:
                join_network()
                asyncio.run(_forward_all(ports))
        finally:
            os._exit(0)
    for listening, _ in ports:
        listening.close()
    return pid


async def _forward_all(ports: Sequence[tuple[socket.socket, int]]) -> None:
    for listening, application_port in ports:
        await asyncio.start_server(_forwarder_to(application_port), sock=listening)
    await asyncio.Event().wait()


def _forwarder_to(application_port: int):
    async def forward(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            from_application, to_application = await asyncio.open_connection(_HOST, application_port)
        except OSError:  # it does not listen (yet): the client sees its connection end
            writer.close()
            return
        await asyncio.gather(_pass_on(reader, to_application), _pass_on(from_application, writer))
        for ended in (writer, to_application):
            ended.close()

    return forward


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Copies one direction of a connection until its sender is done, then closes it for the receiver."""
    with suppress(OSError):
        while data := await reader.read(_CHUNK_BYTES):
            writer.write(data)
            await writer.drain()
        writer.write_eof()
