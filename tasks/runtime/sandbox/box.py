"""Boxes: sandboxes of Linux namespaces with a root file system of their own, and forking of processes into them."""

import json
import os
import signal
import socket
import struct
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import NoReturn

from ....schemas.runs.programs import BoxNetwork
from ..limits.processes import die_with_parent
from . import kernel
from .visible_files import Sight, View, ordered, paths_in, python_paths, system_sights


def fork_beside(become: Callable[[], NoReturn]) -> int:
    """Forks a process in its own session, which dies with this process, to run a function.

    If the function raises or returns, the process ends with code 1.

    Args:
        become: Function that the new process runs; it must not return.

    Returns:
        Process id of the new process.
    """
    parent = os.getpid()
    pid = os.fork()
    if pid == 0:
        try:
            os.setsid()
            die_with_parent()
            if os.getppid() == parent:
                become()
        finally:
            os._exit(1)
    return pid


_EMPTY_FOLDERS = ("/mnt", "/media", "/srv")
_ELSE = "/dev/shm"
_DEVICES = ("null", "zero", "full", "random", "urandom", "tty")
_GPUS = ("dri", "kfd", "nvidia*", "dxg")
_LINKS = {"fd": "/proc/self/fd", "stdin": "/proc/self/fd/0", "stdout": "/proc/self/fd/1", "stderr": "/proc/self/fd/2"}
_OF_THE_KERNEL = ("/proc/sys", "/proc/sysrq-trigger", "/proc/irq", "/proc/bus", "/proc/fs")
_SAFE = kernel.NO_SET_USER_ID | kernel.NO_DEVICES
_TEMPORARY_BYTES = 1 << 30


class Furnishing:
    """Builds the root file system of a sandbox, inside its first process.

    The new root is mounted on a folder that it hides meanwhile, in the sandbox's own mount namespace only.

    Raises:
        OSError: This machine or this user may not mount file systems.
    """

    def __init__(self) -> None:
        kernel.keep_mounts_inside()
        # No process of the box gets rights over namespaces of its own.
        Path("/proc/sys/user/max_user_namespaces").write_text("0")
        self._root = next((path for path in _EMPTY_FOLDERS if _is_empty(path)), _ELSE)
        kernel.mount_new("tmpfs", self._root, _SAFE, "mode=755,size=16m")
        for sight in system_sights():
            self._show(sight)
        self._make_devices()
        os.mkdir(self._root + "/proc")
        kernel.mount_new("proc", self._root + "/proc", _SAFE | kernel.NO_PROGRAMS)
        for path in _OF_THE_KERNEL:
            if os.path.exists(self._root + path):
                kernel.bind(self._root + path, self._root + path)
                kernel.restrict_mount(self._root + path, kernel.READ_ONLY)
        self._show(Sight("/sys", "read"))
        imported = [Sight(str(path), "read") for path in (*python_paths(sys.path), *paths_in(os.environ))]
        self._shown = {*system_sights(), *imported}
        """Files that are mounted already, before the sandbox's job is known."""
        for sight in ordered(imported):
            self._show(sight)

    def finish(self, sights: Sequence[Sight], network: BoxNetwork, services: Sequence[int] = ()) -> list[socket.socket]:
        """Adds the files a run may see, makes them the root, and gives up the right to change it.

        Args:
            sights: Files and folders that the run may see.
            network: Network that processes in the sandbox can reach.
            services: Ports at which a sandbox with a network of its own reaches servers outside.

        Returns:
            A socket that listens for each of `services`.
        """
        doors: list[socket.socket] = []
        for sight in ordered(sight for sight in sights if sight not in self._shown):
            self._show(sight)
        if network != "full":
            kernel.unshare(kernel.NEW_NETWORK)
            kernel.raise_loopback()
            doors += [socket.create_server(("127.0.0.1", port)) for port in services]
        kernel.change_root(self._root)
        kernel.restrict_mount("/", kernel.READ_ONLY, below=False)
        kernel.drop_capabilities()
        kernel.stay_visible()
        return doors

    def _show(self, sight: Sight) -> None:
        if os.path.islink(sight.path) and sight.view == "read" and sight.path.count("/") == 1:
            if not os.path.lexists(self._root + sight.path):
                os.symlink(os.readlink(sight.path), self._root + sight.path)  # /bin and the like
            return
        source = os.path.realpath(sight.path)
        for place in {sight.path, source}:
            self._mount(sight, source, place)

    def _mount(self, sight: Sight, source: str, place: str) -> None:
        target = self._root + place
        if sight.view == "hide":
            if not os.path.exists(target):
                return
            self._hide(target)
            return
        if not os.path.exists(source):
            return
        self._make_place(target, is_folder=os.path.isdir(source))
        kernel.bind(source, target)
        kernel.restrict_mount(target, _SAFE if sight.view == "write" else _SAFE | kernel.READ_ONLY)

    def _hide(self, target: str) -> None:
        if os.path.isdir(target):
            kernel.mount_new("tmpfs", target, _SAFE | kernel.NO_PROGRAMS, "mode=755,size=1m")
        else:
            kernel.bind("/dev/null", target)
            kernel.restrict_mount(target, kernel.READ_ONLY)

    def _make_place(self, target: str, *, is_folder: bool) -> None:
        """Creates a mount point (file or folder) in the new root unless it exists.

        Raises `OSError` if a link leads out of the new root.
        """
        if os.path.exists(target) and os.path.realpath(target).startswith(self._root + "/"):
            return
        parent = target if is_folder else os.path.dirname(target)
        if not f"{os.path.realpath(parent)}/".startswith(self._root + "/"):
            raise OSError(f"{target.removeprefix(self._root)} leads out of the box")
        os.makedirs(parent, exist_ok=True)
        if not is_folder:
            with open(target, "wb"):
                pass

    def _make_devices(self) -> None:
        folder = self._root + "/dev"
        os.mkdir(folder)
        kernel.mount_new("tmpfs", folder, kernel.NO_SET_USER_ID, "mode=755,size=1m")
        for device in [*_DEVICES, *(path.name for name in _GPUS for path in Path("/dev").glob(name))]:
            if os.path.exists(f"/dev/{device}"):
                self._make_place(f"{folder}/{device}", is_folder=os.path.isdir(f"/dev/{device}"))
                kernel.bind(f"/dev/{device}", f"{folder}/{device}")
        for name, target in _LINKS.items():
            os.symlink(target, f"{folder}/{name}")
        for name, kind, options in (
            ("shm", "tmpfs", f"mode=1777,size={_TEMPORARY_BYTES}"),
            ("pts", "devpts", "newinstance,ptmxmode=0666,mode=620"),
            ("mqueue", "mqueue", ""),
        ):
            os.mkdir(f"{folder}/{name}")
            with suppress(OSError):  # kernels without them
                kernel.mount_new(kind, f"{folder}/{name}", _SAFE | kernel.NO_PROGRAMS, options)
        os.symlink("pts/ptmx", f"{folder}/ptmx")
        os.mkdir(self._root + "/tmp")
        kernel.mount_new("tmpfs", self._root + "/tmp", _SAFE, f"mode=1777,size={_TEMPORARY_BYTES}")


def _is_empty(path: str) -> bool:
    try:
        return not os.listdir(path)
    except OSError:
        return False


_ALL = kernel.NEW_USER | kernel.NEW_MOUNTS | kernel.NEW_IPC | kernel.NEW_NAMES | kernel.NEW_PIDS
_PID = struct.Struct("=i")
_READY = b"."
_MOST_BYTES = 1 << 20
_MOST_SERVICES = 16


class BoxError(OSError):
    """Raised when a sandbox cannot be created on this machine; the message says why."""


class Box:
    """Sandbox of a run's processes (Linux namespaces), controlled by the run's supervisor.

    Raises:
        BoxError: This machine or this user may not create the namespaces.
    """

    def __init__(self) -> None:
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._network: BoxNetwork = "full"
        self.doors: list[tuple[socket.socket, int]] = []
        """Sockets that listen in the sandbox for servers outside, each with the server's port, for the forwarding
        process.
        """
        with theirs:
            try:
                self.keeper = _orphan(lambda: _unshare_all(), lambda: _keep(theirs))
            except OSError:
                self._control.close()
                raise

    def furnish(self, sights: Sequence[Sight], network: BoxNetwork, services: Sequence[int] = ()) -> None:
        """Adds the files and network that the run may access, and closes the sandbox.

        Args:
            sights: Files and folders that the run may see.
            network: Network that the run's processes can reach.
            services: Ports at which a sandbox with a network of its own reaches servers outside.

        Raises:
            BoxError: The files or network cannot be added.
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
        """Forks a process into the sandbox, which dies with this process.

        Args:
            become: Function that the process runs; it must not return.

        Returns:
            Process id of the new process, a child of this one.

        Raises:
            BoxError: The process cannot be forked.
        """
        return _orphan(lambda: kernel.enter_namespaces(self.keeper, self._kinds), become)

    def join_network(self) -> None:
        """Moves this process into the sandbox's network and user namespace.

        Does nothing if runs have the full network.
        """
        if self._network != "full":
            kernel.enter_namespaces(self.keeper, kernel.NEW_USER | kernel.NEW_NETWORK)

    @property
    def _kinds(self) -> int:
        return _ALL | (kernel.NEW_NETWORK if self._network != "full" else 0)

    def close_in_child(self) -> None:
        """Closes the connection to the sandbox's first process, in a fork that does not need it."""
        self._control.close()

    def close(self) -> None:
        """Kills the sandbox's first process, with which all processes in the sandbox end, and waits for that."""
        self._control.close()
        for door, _ in self.doors:
            door.close()
        with suppress(ProcessLookupError):
            os.kill(self.keeper, signal.SIGKILL)
        with suppress(ChildProcessError):
            os.waitpid(self.keeper, 0)


def enter_network_of_keeper(network: BoxNetwork) -> None:
    """Moves a process that was forked before the network was known into the network of its sandbox."""
    if network != "full":
        kernel.enter_namespaces(1, kernel.NEW_NETWORK)


def _orphan(enter: Callable[[], None], become: Callable[[], NoReturn]) -> int:
    """Starts a process in other namespaces as a child of this process, and returns its pid.

    It forks twice: a helper process enters the namespaces, forks the process, which is then in them, and exits. This
    process adopts the orphan; so it has to be a child subreaper (see `adopt_orphans`).

    Args:
        enter: Function by which the helper makes or joins the namespaces.
        become: Function that the new process runs; it must not return.

    Raises:
        BoxError: The namespaces could not be entered, or the process was killed as it began.
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
    """Runs in the second fork: waits until the supervisor has adopted it, then calls `become`; never returns.

    Ends the process with code 1 if the supervisor is gone.
    """
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
    """Checks that a path is the same file in this mount namespace, which lacks later mounts; returns its `Sight`.

    Raises `OSError` if it is not. Paths that are only hidden are not checked.
    """
    if view != "hide" and _identity(path) != identity:
        raise OSError(f"{path} is on a file system that was mounted after the box was made")
    return Sight(path, view)


def _unshare_all() -> None:
    user, group = os.geteuid(), os.getegid()
    kernel.unshare(_ALL)
    kernel.keep_identity(user, group)


def _keep(control: socket.socket) -> NoReturn:
    """Runs the sandbox's first process, for ever: builds the file system, gives up privileges, and reaps processes.

    Ends the process with code 1, and sends the reason, if the sandbox cannot be built; with 0 if it is not needed.
    """
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
