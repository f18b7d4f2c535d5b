"""The files of a box: an empty root, into which what is seen is mounted."""

import os
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ....schemas.runs.programs import BoxNetwork
from . import kernel
from .views import Sight, ordered, paths_in, python_paths, system_sights

_EMPTY_FOLDERS = ("/mnt", "/media", "/srv")
_ELSE = "/dev/shm"
_DEVICES = ("null", "zero", "full", "random", "urandom", "tty")
_GPUS = ("dri", "kfd", "nvidia*", "dxg")
_LINKS = {"fd": "/proc/self/fd", "stdin": "/proc/self/fd/0", "stdout": "/proc/self/fd/1", "stderr": "/proc/self/fd/2"}
_OF_THE_KERNEL = ("/proc/sys", "/proc/sysrq-trigger", "/proc/irq", "/proc/bus", "/proc/fs")
_SAFE = kernel.NO_SET_USER_ID | kernel.NO_DEVICES
_TEMPORARY_BYTES = 1 << 30


class Furnishing:
    """The root of a box while it is made, by its process 1.

    The new root lies on a folder that is hidden by it meanwhile, in the box's own mount namespace only.

    Raises:
        OSError: This machine or this user may not mount.
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
        """Sights that are mounted already, before the job of the box is known."""
        for sight in ordered(imported):
            self._show(sight)

    def finish(self, sights: Sequence[Sight], network: BoxNetwork, services: Sequence[int] = ()) -> list[socket.socket]:
        """Adds what a run sees, makes it all there is, and gives up the right to change it.

        Args:
            sights: files and folders of the run.
            network: what is reached from the box.
            services: ports in a network of its own at which servers outside will be reached.

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
        kernel.forgo_privileges()
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
        """Makes what something can be mounted on, unless it is there; never through a link out of the new root."""
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
