"""Identification of local callers: finds the job whose process opened a connection, by marks of runs."""

import os
import socket
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import IPv6Address, ip_address
from pathlib import Path
from typing import NamedTuple

from pydantic import Field, ValidationError

from ....schemas.wire.base import Model
from ..limits.processes import process_state

_MARK = "supervisor.json"
_MOST_BYTES = 4096
_MOST_ANCESTORS = 1000
"""Maximum number of ancestors of a process that are examined; processes have tens."""


class _Mark(Model):
    """Mark file of a run's supervisor: process id and job ARN."""

    pid: int = Field(description="Its process.")
    started: int = Field(description="When that started, in ticks since the machine did: ids of processes come again.")
    job: str = Field(description="ARN of the job.")


def mark_run(folder: Path, job: str) -> None:
    """Records that this process supervises a run, so that its callers can be identified.

    Args:
        folder: Folder of the run.
        job: ARN of the job.

    Raises:
        OSError: The record cannot be written.
    """
    process = process_state(os.getpid())
    assert process is not None
    written = folder / f".{_MARK}"
    written.write_text(_Mark(pid=os.getpid(), started=process.started, job=job).model_dump_json())
    written.replace(folder / _MARK)


def marked_runs(home: Path) -> Mapping[int, str]:
    """Returns the ARN of the job of each living supervisor process, by process id.

    Args:
        home: Data home of the job workers.
    """
    found: dict[int, str] = {}
    for path in (home / "jobs").glob(f"*/*/{_MARK}"):
        with suppress(OSError, ValidationError):
            with path.open("rb") as file:
                mark = _Mark.model_validate_json(file.read(_MOST_BYTES))
            process = process_state(mark.pid)
            if process is not None and process.started == mark.started:
                found[mark.pid] = mark.job
    return found


def ancestors(pid: int) -> list[int] | None:
    """Returns the ids of a process and all its ancestors, the process first.

    Returns `None` if one of them has ended meanwhile, or there are too many.
    """
    found = [pid]
    while len(found) < _MOST_ANCESTORS:
        process = process_state(found[-1])
        if process is None:
            return None
        if process.parent == 0:
            return found
        found.append(process.parent)
    return None


Address = tuple[str, int]
"""An IP address and a port."""

_DIAGNOSIS = 4  # NETLINK_SOCK_DIAG
_BY_FAMILY = 20  # SOCK_DIAG_BY_FAMILY
_REQUEST = 1  # NLM_F_REQUEST
_ANSWER_BYTES = 8192
_HEADER = struct.Struct("=IHHII")
_NO_COOKIE = b"\xff" * 8
_OWNER_AT = _HEADER.size + 4 + 48 + 12
"""Byte offset of user and inode in the kernel's answer: after header, four bytes of state, the socket's id and three
numbers.
"""
_ERROR = 2  # NLMSG_ERROR
_MOST_KNOWN = 10_000
_KNOWN_S = 60.0
"""Seconds for which the process of a connection is cached; inodes of sockets are reused, after some billions."""


class ConnectionEnd(NamedTuple):
    """Other end of a local TCP connection, as the kernel knows it: user id and inode of its socket."""

    user: int
    inode: int


@dataclass(frozen=True)
class Caller:
    """The process at the other end of a local connection: the job it belongs to, if any, or why that is not known."""

    job: str | None = None
    """ARN of the job to which the process belongs; `None`: no job."""

    why_unknown: str | None = None
    """Reason why the process cannot be determined; `None` if it can."""


class Callers:
    """Finds which process, and so which job, has opened a local TCP connection.

    Args:
        home: Data home of the job workers of this machine.
        end_of: Function that finds the other end of a connection.
    """

    def __init__(self, home: Path, end_of: Callable[[Address, Address], ConnectionEnd | None] | None = None) -> None:
        self._home = home
        self._end_of = end_of or end_of_connection
        self._known: dict[tuple[Address, Address, ConnectionEnd], tuple[float, Caller]] = {}
        self._can_tell = os.path.exists("/proc/self/ns/pid")  # else there are no boxes either

    def who(self, peer: Address, server: Address) -> Caller:
        """Returns which process has opened a connection to this one, and which job that belongs to.

        Callers from other machines, and callers in no job, have neither job nor reason. A known caller is remembered
        for a while.

        Args:
            peer: Address and port of the caller's end of the connection.
            server: Address and port of this end of the connection.
        """
        if not self._can_tell or not ip_address(peer[0]).is_loopback:
            return Caller()
        end = self._end_of(peer, server)
        if end is None or end.inode == 0:
            return Caller(why_unknown="it has been closed by its sender")
        known_until_s, caller = self._known.get((peer, server, end), (0.0, Caller()))
        if (now_s := time.monotonic()) >= known_until_s:
            caller = self._found(end)
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            if caller.why_unknown is None:
                self._known[peer, server, end] = (now_s + _KNOWN_S, caller)
        return caller

    def _found(self, end: ConnectionEnd) -> Caller:
        user = os.geteuid()
        if end.user != user and user != 0:
            return _of_another_user(end.user)
        runs = marked_runs(self._home)
        holders = list(_holders(end))
        if not holders:
            return Caller(why_unknown="no process can be seen that has it open")
        # A socket may be held by several; one of a job among them is enough.
        callers = [_caller_of(pid, runs) for pid in holders]
        return next(
            (each for each in callers if each.job), next((each for each in callers if each.why_unknown), callers[0])
        )


def end_of_connection(peer: Address, server: Address) -> ConnectionEnd | None:
    """Returns the other end of a local connection, asking the kernel; `None` if the connection has ended."""
    try:
        return _asked(peer, server)
    except OSError:  # such questions are refused here
        return _listed(peer, server)


def _asked(peer: Address, server: Address) -> ConnectionEnd | None:
    (ours, our_port), (theirs, their_port) = server, peer
    family = socket.AF_INET6 if ":" in theirs else socket.AF_INET
    addresses = [socket.inet_pton(family, each).ljust(16, b"\0") for each in (theirs, ours)]
    wanted = struct.pack("=BBBxI", family, socket.IPPROTO_TCP, 0, 0xFFFFFFFF)
    wanted += struct.pack("!HH", their_port, our_port) + addresses[0] + addresses[1] + struct.pack("=I", 0) + _NO_COOKIE
    message = _HEADER.pack(_HEADER.size + len(wanted), _BY_FAMILY, _REQUEST, 1, 0) + wanted
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, _DIAGNOSIS) as kernel:
        kernel.settimeout(1.0)
        kernel.send(message)
        answer = kernel.recv(_ANSWER_BYTES)
    _, kind, _, _, _ = _HEADER.unpack_from(answer)
    if kind == _ERROR:
        number = -struct.unpack_from("=i", answer, _HEADER.size)[0]
        if number == 2:  # ENOENT: there is no such connection
            return None
        raise OSError(number, os.strerror(number))
    return ConnectionEnd(*struct.unpack_from("=II", answer, _OWNER_AT))


def _listed(peer: Address, server: Address) -> ConnectionEnd | None:
    """Returns the other end of a local connection from the kernel's list of all connections; `None` if it has none."""
    wanted = (_written(peer), _written(server))
    name = "tcp6" if ":" in peer[0] else "tcp"
    with suppress(OSError), Path(f"/proc/net/{name}").open() as lines:
        for line in lines:
            fields = line.split()
            if (fields[1], fields[2]) == wanted:
                return ConnectionEnd(int(fields[7]), int(fields[9]))
    return None


def _written(address: Address) -> str:
    packed = ip_address(address[0]).packed
    words = struct.unpack(f"={len(packed) // 4}I", packed)
    return "".join(f"{word:08X}" for word in words) + f":{address[1]:04X}"


def _holders(end: ConnectionEnd) -> Iterator[int]:
    """Yields the visible processes that have the socket open."""
    link = f"socket:[{end.inode}]"
    with os.scandir("/proc") as entries:
        for entry in entries:
            if entry.name.isdecimal():
                with suppress(OSError), os.scandir(f"/proc/{entry.name}/fd") as descriptors:
                    if any(_links_to(each.path, link) for each in descriptors):
                        yield int(entry.name)


def _links_to(path: str, link: str) -> bool:
    try:
        return os.readlink(path) == link
    except OSError:
        return False


def _caller_of(pid: int, runs: Mapping[int, str]) -> Caller:
    line = ancestors(pid)
    if line is None:
        return Caller(why_unknown="its process has ended")
    if (job := next((runs[each] for each in line if each in runs), None)) is not None:
        return Caller(job=job)
    try:
        is_here = os.path.samestat(os.stat(f"/proc/{pid}/ns/pid"), os.stat("/proc/self/ns/pid"))
    except OSError:
        is_here = False
    return Caller() if is_here else Caller(why_unknown="its process is in a namespace of its own, such as a container")


def _of_another_user(user: int) -> Caller:
    """Returns the caller for a socket of another user, whose process cannot be seen.

    It is unknown if that user has processes in containers, which jobs may have started; else it is no job.
    """
    with os.scandir("/proc") as entries:
        for entry in entries:
            if entry.name.isdecimal() and _is_contained(entry.name, user):
                return Caller(why_unknown=f"user {user} has processes in containers, which jobs may have started")
    return Caller()


def _is_contained(pid: str, user: int) -> bool:
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return False
    about = {name: value.split() for name, _, value in (line.partition(":") for line in lines)}
    return about.get("Uid", [""])[:1] == [str(user)] and len(about.get("NSpid", [])) > 1


def as_address(given: object) -> Address | None:
    """Returns a TCP address with its host in the usual form (IPv4 if it is mapped to IPv6, no scope) and its port.

    Returns `None` if the value is no such address.
    """
    if not isinstance(given, tuple) or len(given) < 2:
        return None
    host, port = given[0], given[1]
    if not isinstance(host, str) or not isinstance(port, int):
        return None
    with suppress(ValueError):
        address = ip_address(host.partition("%")[0])
        if isinstance(address, IPv6Address) and address.ipv4_mapped:
            return str(address.ipv4_mapped), port
        return str(address), port
    return None
