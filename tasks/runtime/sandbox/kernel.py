"""System calls that Python has no functions for: namespaces, mounts, capabilities.

Each raises `OSError` with the kernel's reason.
"""

import ctypes
import fcntl
import os
import socket
import struct
from pathlib import Path

NEW_USER, NEW_MOUNTS, NEW_IPC, NEW_NAMES, NEW_PIDS, NEW_NETWORK = (
    0x10000000, 0x00020000, 0x08000000, 0x04000000, 0x20000000, 0x40000000,
)  # fmt: skip
READ_ONLY, NO_SET_USER_ID, NO_DEVICES, NO_PROGRAMS = 1, 2, 4, 8
"""Flags of mounts (`MOUNT_ATTR_…`, which for these are also `MS_…`)."""

_MS_BIND, _MS_REC, _MS_SLAVE = 0x1000, 0x4000, 0x80000
_MNT_DETACH = 2
_AT_FDCWD, _AT_RECURSIVE = -100, 0x8000
_MOUNT_SETATTR = 442
_KEYCTL = {"x86_64": 250, "aarch64": 219}
_PIVOT_ROOT = {"x86_64": 155, "aarch64": 41}
_KEYCTL_JOIN_SESSION_KEYRING = 1
_PR_SET_DUMPABLE, _PR_CAPBSET_DROP, _PR_SET_NO_NEW_PRIVS, _PR_CAP_AMBIENT, _PR_CAP_AMBIENT_CLEAR_ALL = 4, 24, 38, 47, 4
_CAPABILITY_VERSION_3 = 0x20080522
_MOST_CAPABILITIES = 64
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _IFF_UP = 0x8913, 0x8914, 1
_LIBC = ctypes.CDLL(None, use_errno=True)


def unshare(kinds: int) -> None:
    """Gives this process namespaces of its own."""
    _check(_LIBC.unshare(kinds), "unshare")


def enter_namespaces(pid: int, kinds: int) -> None:
    """Moves this process into namespaces of another one; those of processes only count for its children."""
    descriptor = os.pidfd_open(pid)
    try:
        _check(_LIBC.setns(descriptor, kinds), "setns")
    finally:
        os.close(descriptor)


def keep_identity(user: int, group: int) -> None:
    """Lets a new user namespace know this user and group, by their own numbers."""
    Path("/proc/self/setgroups").write_text("deny")
    Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
    Path("/proc/self/gid_map").write_text(f"{group} {group} 1")


def mount_new(kind: str, target: str, attributes: int, options: str = "") -> None:
    """Mounts a new file system, such as `tmpfs` or `proc`."""
    _mount(kind, target, kind, attributes, options)


def bind(source: str, target: str) -> None:
    """Shows a file or folder, and what is mounted below it, in another place too."""
    _mount(source, target, None, _MS_BIND | _MS_REC, "")


def keep_mounts_inside() -> None:
    """Keeps mounts of this namespace from others; theirs still come in, where the machine passes them on."""
    _mount("none", "/", None, _MS_REC | _MS_SLAVE, "")


def restrict_mount(target: str, attributes: int, *, below: bool = True) -> None:
    """Adds attributes to a mount, and to all below it."""
    values = struct.pack("QQQQ", attributes, 0, 0, 0)
    flags = _AT_RECURSIVE if below else 0
    done = _LIBC.syscall(_MOUNT_SETATTR, _AT_FDCWD, os.fsencode(target), flags, values, ctypes.c_size_t(len(values)))
    _check(done, f"mount_setattr {target}")


def change_root(folder: str) -> None:
    """Makes a mounted folder the root of this mount namespace; nothing else stays reachable."""
    os.chdir(folder)
    _check(_LIBC.syscall(_number(_PIVOT_ROOT), b".", b"."), "pivot_root")
    _check(_LIBC.umount2(b".", _MNT_DETACH), "umount")
    os.chdir("/")


def raise_loopback() -> None:
    """Starts `lo` of a new network namespace."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        request = struct.pack("16sh22x", b"lo", 0)
        (flags,) = struct.unpack_from("h", fcntl.ioctl(any_socket, _SIOCGIFFLAGS, request), 16)
        fcntl.ioctl(any_socket, _SIOCSIFFLAGS, struct.pack("16sh22x", b"lo", flags | _IFF_UP))


def forgo_privileges() -> None:
    """Gives up all capabilities, for good: no program that is executed later gets any."""
    _check(_LIBC.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0), "PR_SET_NO_NEW_PRIVS")
    _LIBC.prctl(_PR_CAP_AMBIENT, _PR_CAP_AMBIENT_CLEAR_ALL, 0, 0, 0)
    for capability in range(_MOST_CAPABILITIES):
        if _LIBC.prctl(_PR_CAPBSET_DROP, capability, 0, 0, 0) != 0:
            break  # the kernel knows no more, or this process has none to drop
    header, nothing = struct.pack("Ii", _CAPABILITY_VERSION_3, 0), bytes(24)
    _check(_LIBC.capset(header, nothing), "capset")


def stay_visible() -> None:
    """Lets the same user look into this process, which changing its rights has ended: its supervisor measures it."""
    _check(_LIBC.prctl(_PR_SET_DUMPABLE, 1, 0, 0, 0), "PR_SET_DUMPABLE")


def leave_keyrings() -> None:
    """Gives this process a session keyring of its own, where the kernel has keyrings."""
    _LIBC.syscall(_number(_KEYCTL), _KEYCTL_JOIN_SESSION_KEYRING, None)


def _mount(source: str, target: str, kind: str | None, flags: int, options: str) -> None:
    words = [os.fsencode(word) if word is not None else None for word in (source, target, kind)]
    _check(_LIBC.mount(*words, ctypes.c_ulong(flags), options.encode()), f"mount {target}")


def _number(of_machines: dict[str, int]) -> int:
    machine = os.uname().machine
    if machine not in of_machines:
        raise OSError(f"system calls of {machine} are not known")
    return of_machines[machine]


def _check(answer: int, what: str) -> None:
    if answer < 0:
        error = ctypes.get_errno()
        raise OSError(error, f"{what}: {os.strerror(error)}")
