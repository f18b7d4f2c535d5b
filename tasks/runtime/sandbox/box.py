"""A box: namespaces that the processes of one run share, made before the run is known.

A keeper is process 1 of the box. It prepares what every run sees while there is time; when the run begins it adds the
run's own folders, makes that the root, and from then on only reaps. Its death ends all processes of the box.

Processes of the box are children of the supervisor, which is outside: a helper enters the box and forks, and when it
ends the kernel hands its child to the supervisor, which adopts orphans. So process 1 is no process of an application
(signals do nothing to it that it does not handle), and the supervisor sees each end as the kernel tells it.

What is given up and when: docs/sandbox.md.
"""

import json
import os
import signal
import socket
import struct
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import NoReturn

from ....schemas.runs.programs import BoxNetwork
from ..limits.processes import die_with_parent
from . import kernel
from .furnishing import Furnishing
from .views import Sight, View

_ALL = kernel.NEW_USER | kernel.NEW_MOUNTS | kernel.NEW_IPC | kernel.NEW_NAMES | kernel.NEW_PIDS
_PID = struct.Struct("=i")
_READY = b"."
_MOST_BYTES = 1 << 20
_MOST_SERVICES = 16


class BoxError(OSError):
    """A box cannot be made here, or not like this; says why."""


class Box:
    """One box, seen from the supervisor of its run, which has to adopt orphans.

    Raises:
        BoxError: This machine or this user may not have one.
    """

    def __init__(self) -> None:
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._network: BoxNetwork = "full"
        self.doors: list[tuple[socket.socket, int]] = []
        """Sockets that listen in the box for servers outside, each with the server's port; for who forwards them."""
        with theirs:
            try:
                self.keeper = _orphan(lambda: _unshare_all(), lambda: _keep(theirs))
            except OSError:
                self._control.close()
                raise

    def furnish(self, sights: Sequence[Sight], network: BoxNetwork, services: Sequence[int] = ()) -> None:
        """Adds what a run sees, and closes the box: nothing else can be reached from now on.

        Args:
            sights: files and folders of the run.
            network: what its processes reach.
            services: ports of servers outside that are reached from a network of its own, too.

        Raises:
            BoxError: It cannot be done.
        """
        found: list[int] = []
        shown = [{**asdict(sight), "identity": _identity(sight.path)} for sight in sights]
        message = json.dumps({"sights": shown, "network": network, "services": list(services)}).encode()
        try:
            with suppress(BrokenPipeError):  # it has ended, and said why
                self._control.send(message)
            answer, found, _, _ = socket.recv_fds(self._control, _MOST_BYTES, _MOST_SERVICES)
        except OSError as error:
            answer = str(error).encode()
        if answer != _READY:
            raise BoxError(f"the box of the run cannot be furnished: {answer.decode() or 'its keeper has ended'}")
        self._network = network
        self.doors = [(socket.socket(fileno=number), port) for number, port in zip(found, services, strict=True)]

    def fork(self, become: Callable[[], NoReturn]) -> int:
        """Forks a process that is in the box and dies with this process.

        Args:
            become: What it does; it must not return.

        Returns:
            Its pid, as this process sees it, whose child it is.

        Raises:
            BoxError: It cannot be forked.
        """
        return _orphan(lambda: kernel.enter_namespaces(self.keeper, self._kinds), become)

    def join_network(self) -> None:
        """Moves this process into the network of the box, and with it into its user namespace."""
        if self._network != "full":
            kernel.enter_namespaces(self.keeper, kernel.NEW_USER | kernel.NEW_NETWORK)

    @property
    def _kinds(self) -> int:
        return _ALL | (kernel.NEW_NETWORK if self._network != "full" else 0)

    def close_in_child(self) -> None:
        """Lets go of the keeper in a fork that has nothing to tell it."""
        self._control.close()

    def close(self) -> None:
        """Ends all processes of the box; waits for none but its keeper."""
        self._control.close()
        for door, _ in self.doors:
            door.close()
        with suppress(ProcessLookupError):
            os.kill(self.keeper, signal.SIGKILL)
        with suppress(ChildProcessError):
            os.waitpid(self.keeper, 0)


def enter_network_of_keeper(network: BoxNetwork) -> None:
    """Moves a process of the box, which was forked before its network was made, into that."""
    if network != "full":
        kernel.enter_namespaces(1, kernel.NEW_NETWORK)


def _orphan(enter: Callable[[], None], become: Callable[[], NoReturn]) -> int:
    """Forks twice: the first enters namespaces, the second is in them; returns its pid.

    Raises:
        BoxError: The first could not.
    """
    ours, theirs = socket.socketpair()
    with ours:
        with theirs:
            helper = os.fork()
            if helper == 0:
                _help(ours, theirs, enter, become)
        answer = ours.recv(4096)
        os.waitpid(helper, 0)
        if len(answer) != _PID.size:
            raise BoxError(answer.decode(errors="replace") or "a process of the box was killed as it began")
        ours.sendall(_READY)  # the helper is gone: it has become a child of this process
        return _PID.unpack(answer)[0]


def _help(
    ours: socket.socket, theirs: socket.socket, enter: Callable[[], None], become: Callable[[], NoReturn]
) -> None:
    try:
        ours.close()
        enter()
        pid = os.fork()
        if pid == 0:
            _begin(theirs, become)
        theirs.sendall(_PID.pack(pid))
    except BaseException as error:
        theirs.sendall(str(error).encode()[:1000] + b"    ")
    finally:
        os._exit(0)


def _begin(theirs: socket.socket, become: Callable[[], NoReturn]) -> None:
    """The second process: it belongs to the supervisor once the first has ended."""
    try:
        if theirs.recv(1) == _READY:
            os.setsid()
            die_with_parent()
            kernel.stay_visible()
            # Had the supervisor died before, its end of this connection would be closed.
            theirs.close()
            become()
    finally:
        os._exit(1)


def _identity(path: str) -> list[int] | None:
    try:
        status = os.stat(path)
    except OSError:
        return None
    return [status.st_dev, status.st_ino]


def _known(path: str, view: View, identity: list[int] | None) -> Sight:
    """A sight that is the same in this namespace of mounts: what was mounted since it was made may not be there."""
    if view != "hide" and _identity(path) != identity:
        raise OSError(f"{path} is on a file system that was mounted after the box was made")
    return Sight(path, view)


def _unshare_all() -> None:
    user, group = os.geteuid(), os.getegid()
    kernel.unshare(_ALL)
    kernel.keep_identity(user, group)


def _keep(control: socket.socket) -> NoReturn:
    """The keeper: furnishes, gives up its rights, and reaps."""
    descriptor = control.fileno()
    os.closerange(3, descriptor)
    os.closerange(descriptor + 1, os.sysconf("SC_OPEN_MAX"))
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    try:
        furnishing = Furnishing()
        message = control.recv(_MOST_BYTES)
        if not message:
            os._exit(0)
        run = json.loads(message)
        sights = [_known(**sight) for sight in run["sights"]]
        doors = furnishing.finish(sights, run["network"], run["services"])
    except BaseException as error:
        with suppress(OSError):
            control.send(str(error).encode()[:1000] or b"unknown")
        os._exit(1)
    socket.send_fds(control, [_READY], [door.fileno() for door in doors])
    for one in (control, *doors):
        one.close()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # which has the kernel reap
    while True:
        signal.pause()
