"""Linux system calls for a sandbox: namespaces, mounts, Landlock, seccomp filters."""

import ctypes
import fcntl
import os
import socket
import stat
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from errno import EINVAL, ENOSYS, EPERM
from pathlib import Path
from typing import NamedTuple

from ....schemas.runs.programs import BoxLevel

NEW_USER, NEW_MOUNTS, NEW_IPC, NEW_NAMES, NEW_PIDS, NEW_NETWORK = (
    0x10000000, 0x00020000, 0x08000000, 0x04000000, 0x20000000, 0x40000000,
)  # fmt: skip
READ_ONLY, NO_SET_USER_ID, NO_DEVICES, NO_PROGRAMS = 1, 2, 4, 8
"""Flags of mounts (`MOUNT_ATTR_…`, which for these equal `MS_…`)."""

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
    """Creates new Linux namespaces of some kinds for this process (`unshare`).

    Raises `OSError` if the kernel refuses.
    """
    _check(_LIBC.unshare(kinds), "unshare")


def enter_namespaces(pid: int, kinds: int) -> None:
    """Moves this process into another process's namespaces; process namespaces only affect its children.

    Raises `OSError` if the kernel refuses.
    """
    descriptor = os.pidfd_open(pid)
    try:
        _check(_LIBC.setns(descriptor, kinds), "setns")
    finally:
        os.close(descriptor)


def keep_identity(user: int, group: int) -> None:
    """Maps this user and group to themselves in the new user namespace of this process.

    Writes to `/proc/self`, after which the process cannot change its groups.
    """
    Path("/proc/self/setgroups").write_text("deny")
    Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
    Path("/proc/self/gid_map").write_text(f"{group} {group} 1")


def mount_new(kind: str, target: str, attributes: int, options: str = "") -> None:
    """Mounts a new file system, such as `tmpfs` or `proc`.

    Raises OSError if the kernel refuses.
    """
    _mount(kind, target, kind, attributes, options)


def bind(source: str, target: str) -> None:
    """Bind-mounts a file or folder, with mounts below it, at another path.

    Raises OSError if the kernel refuses.
    """
    _mount(source, target, None, _MS_BIND | _MS_REC, "")


def keep_mounts_inside() -> None:
    """Keeps mounts of this namespace invisible to others.

    Raises OSError if the kernel refuses.
    """
    _mount("none", "/", None, _MS_REC | _MS_SLAVE, "")


def restrict_mount(target: str, attributes: int, *, below: bool = True) -> None:
    """Adds restrictions (such as read-only) to a mount, and to all mounts below it unless `below` is false.

    Raises OSError if the kernel refuses.
    """
    values = struct.pack("QQQQ", attributes, 0, 0, 0)
    flags = _AT_RECURSIVE if below else 0
    done = _LIBC.syscall(_MOUNT_SETATTR, _AT_FDCWD, os.fsencode(target), flags, values, ctypes.c_size_t(len(values)))
    _check(done, f"mount_setattr {target}")


def change_root(folder: str) -> None:
    """Makes a mounted folder the root of this mount namespace, and detaches the old root.

    The working directory of the process becomes the new root. Raises `OSError` if the kernel refuses.
    """
    os.chdir(folder)
    _check(_LIBC.syscall(_number(_PIVOT_ROOT), b".", b"."), "pivot_root")
    _check(_LIBC.umount2(b".", _MNT_DETACH), "umount")
    os.chdir("/")


def raise_loopback() -> None:
    """Activates the loopback interface of a new network namespace.

    Raises OSError if the kernel refuses.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        request = struct.pack("16sh22x", b"lo", 0)
        (flags,) = struct.unpack_from("h", fcntl.ioctl(any_socket, _SIOCGIFFLAGS, request), 16)
        fcntl.ioctl(any_socket, _SIOCSIFFLAGS, struct.pack("16sh22x", b"lo", flags | _IFF_UP))


def drop_capabilities() -> None:
    """Gives up all capabilities for good, also for programs that are executed later.

    Raises OSError if the kernel refuses.
    """
    _check(_LIBC.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0), "PR_SET_NO_NEW_PRIVS")
    _LIBC.prctl(_PR_CAP_AMBIENT, _PR_CAP_AMBIENT_CLEAR_ALL, 0, 0, 0)
    for capability in range(_MOST_CAPABILITIES):
        if _LIBC.prctl(_PR_CAPBSET_DROP, capability, 0, 0, 0) != 0:
            break  # the kernel knows no more, or this process has none to drop
    header, nothing = struct.pack("Ii", _CAPABILITY_VERSION_3, 0), bytes(24)
    _check(_LIBC.capset(header, nothing), "capset")


def stay_visible() -> None:
    """Allows the same user to inspect this process again, so that its supervisor can measure it.

    Raises OSError if the kernel refuses.
    """
    _check(_LIBC.prctl(_PR_SET_DUMPABLE, 1, 0, 0, 0), "PR_SET_DUMPABLE")


def leave_keyrings() -> None:
    """Gives this process its own session keyring, where the kernel has keyrings."""
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


_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION_FLAG = 1
_RULE_PATH_BENEATH = 1
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR, _TRUNCATE, _IOCTL = 1 << 0, 1 << 1, 1 << 2, 1 << 3, 1 << 14, 1 << 15
_REFER = 1 << 13
_FIRST_VERSION = (1 << 13) - 1
_OF_FILES = _EXECUTE | _WRITE_FILE | _READ_FILE | _TRUNCATE | _IOCTL
_READ = _EXECUTE | _READ_FILE | _READ_DIR
_SCOPES = 3
"""Landlock scopes: abstract sockets and signals reach only processes with the same rules."""


@dataclass(frozen=True)
class Rules:
    """Landlock rule (kernel sandbox): access to a file, or to all files in a folder."""

    path: str
    writable: bool


def landlock_version() -> int:
    """Returns the version of the kernel's Landlock interface; 0 if it has none."""
    return max(0, _LIBC.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), _VERSION_FLAG))


def restrict(rules: Sequence[Rules]) -> None:
    """Confines this process and its children to some files with Landlock; requires `no_new_privs`.

    Args:
        rules: Files and folders that stay accessible; missing ones are left out.

    Raises:
        OSError: The kernel refuses.
    """
    version = landlock_version()
    handled = _FIRST_VERSION
    handled |= _REFER if version >= 2 else 0
    handled |= _TRUNCATE if version >= 3 else 0
    handled |= _IOCTL if version >= 5 else 0
    attributes = struct.pack("QQQ", handled, 0, _SCOPES)[: 24 if version >= 6 else 16 if version >= 4 else 8]
    ruleset = _checked(_LIBC.syscall(_CREATE_RULESET, attributes, ctypes.c_size_t(len(attributes)), 0))
    try:
        for rule in rules:
            _allow(ruleset, rule, handled)
        _checked(_LIBC.syscall(_RESTRICT_SELF, ruleset, 0))
    finally:
        os.close(ruleset)


def _allow(ruleset: int, rule: Rules, handled: int) -> None:
    try:
        descriptor = os.open(rule.path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        allowed = handled if rule.writable else handled & _READ
        if not stat.S_ISDIR(os.fstat(descriptor).st_mode):
            allowed &= _OF_FILES
        beneath = struct.pack("=Qi", allowed, descriptor)
        _checked(_LIBC.syscall(_ADD_RULE, ruleset, _RULE_PATH_BENEATH, beneath, 0))
    finally:
        os.close(descriptor)


def _checked(answer: int) -> int:
    if answer < 0:
        error = ctypes.get_errno()
        raise OSError(error, f"landlock: {os.strerror(error)}")
    return answer


_SECCOMP = {"x86_64": 317, "aarch64": 277}
_SET_MODE_FILTER, _SPECULATE = 1, 1 << 2
"""seccomp operation that sets a filter, and its flag that keeps speculative execution, as older kernels would slow down
every process with a filter.
"""
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_NUMBER_AT, _MACHINE_AT, _ARGUMENT_AT, _THIRD_AT = 0, 4, 16, 32
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000
_X32 = 0x40000000
_NEW_NAMESPACES = 0x7E020000
"""Mask of the `CLONE_NEW…` flags of users, mounts, processes, networks, IPC, names and control groups."""

_REFUSED = {  # on x86-64, on i386, on 64-bit ARM
    "add_key": (248, 286, 217), "request_key": (249, 287, 218), "keyctl": (250, 288, 219),
    "bpf": (321, 357, 280), "perf_event_open": (298, 336, 241), "userfaultfd": (323, 374, 282),
    "io_uring_setup": (425, 425, 425), "io_uring_enter": (426, 426, 426), "io_uring_register": (427, 427, 427),
    "mount": (165, 21, 40), "umount": (None, 22, None), "umount2": (166, 52, 39), "pivot_root": (155, 217, 41),
    "move_mount": (429, 429, 429), "open_tree": (428, 428, 428), "mount_setattr": (442, 442, 442),
    "fsopen": (430, 430, 430), "fsconfig": (431, 431, 431), "fsmount": (432, 432, 432), "fspick": (433, 433, 433),
    "setns": (308, 346, 268), "chroot": (161, 61, 51), "open_by_handle_at": (304, 342, 265),
    "kexec_load": (246, 283, 104), "kexec_file_load": (320, None, 294), "reboot": (169, 88, 142),
    "init_module": (175, 128, 105), "finit_module": (313, 350, 273), "delete_module": (176, 129, 106),
    "swapon": (167, 87, 224), "swapoff": (168, 115, 225), "acct": (163, 51, 89),
    "quotactl": (179, 131, 60), "quotactl_fd": (443, 443, 443), "lookup_dcookie": (212, 253, 18),
    "iopl": (172, 110, None), "ioperm": (173, 101, None), "vhangup": (153, 111, 58),
}  # fmt: skip


class _Machine(NamedTuple):
    """Numbers of system calls on a machine type, by which they are filtered.

    One kernel may run programs of several types.
    """

    identity: int
    column: int
    unshare: int
    clone: int
    limits: int
    """Number of `prlimit64`, with which a process outside of a box could take files and CPU time from its job worker.
    """


_CLONE3 = 435
"""Number of `clone3`, which is blocked because its arguments are in memory, where filters cannot look; programs then
use `clone`.
"""
_MACHINES = {
    "x86_64": (_Machine(0xC000003E, 0, 272, 56, 302), _Machine(0x40000003, 1, 310, 120, 340)),
    "aarch64": (_Machine(0xC00000B7, 2, 97, 220, 261),),
}


def filter_system_calls() -> bool:
    """Blocks dangerous system calls for this process and its children (seccomp); requires `no_new_privs`.

    Returns:
        Whether the filter is active: only on 64-bit x86 and ARM, and where the kernel has filters.

    Raises:
        OSError: The kernel refuses.
    """
    machine = os.uname().machine
    if machine not in _MACHINES:
        return False
    code = b"".join(rules_for(_MACHINES[machine]))
    buffer = ctypes.create_string_buffer(code, len(code))
    program = struct.pack("HxxxxxxP", len(code) // 8, ctypes.addressof(buffer))
    if _LIBC.syscall(_SECCOMP[machine], _SET_MODE_FILTER, _SPECULATE, program) == 0:
        return True
    error = ctypes.get_errno()
    if error in (EINVAL, ENOSYS):
        return False
    raise OSError(error, f"seccomp: {os.strerror(error)}")


def rules_for(machines: Sequence[_Machine]) -> Iterator[bytes]:
    """Yields the seccomp filter (blocked system calls) as kernel instructions, for each machine type."""
    yield _instruction(_LOAD, _MACHINE_AT)
    for machine in machines:
        rules = list(_rules_of(machine))
        # A jump is at most 255 instructions long.
        yield _instruction(_EQUAL, machine.identity, otherwise=len(rules))
        yield from rules
    yield _instruction(_RETURN, _REFUSE | ENOSYS)


def _rules_of(machine: _Machine) -> Iterator[bytes]:
    numbers = [columns[machine.column] for columns in _REFUSED.values()]
    refused = [number for number in numbers if number is not None]
    yield _instruction(_LOAD, _NUMBER_AT)
    tests = [(_EQUAL, number, "refuse") for number in refused]
    tests += [(_EQUAL, machine.clone, "look"), (_EQUAL, machine.unshare, "look"), (_EQUAL, _CLONE3, "missing")]
    tests += [(_EQUAL, machine.limits, "limits"), (_AT_LEAST, _X32, "missing")]
    ends = {"allow": 0, "look": 1, "refuse": 3, "missing": 4, "limits": 6}
    for index, (test, value, end) in enumerate(tests):
        yield _instruction(test, value, then=len(tests) - index - 1 + ends[end])
    yield _instruction(_RETURN, _ALLOW)
    yield _instruction(_LOAD, _ARGUMENT_AT)
    yield _instruction(_ANY_BIT, _NEW_NAMESPACES, otherwise=2)
    yield _instruction(_RETURN, _REFUSE | EPERM)
    yield _instruction(_RETURN, _REFUSE | ENOSYS)
    yield _instruction(_RETURN, _ALLOW)
    # Limits may be read of any process, and set of the one that asks: without its number, as `setrlimit` does.
    yield _instruction(_LOAD, _ARGUMENT_AT)
    yield _instruction(_EQUAL, 0, then=6)
    for place in (_THIRD_AT, _THIRD_AT + 4):  # where the new limits are: nowhere
        yield _instruction(_LOAD, place)
        yield _instruction(_EQUAL, 0, then=1)
        yield _instruction(_RETURN, _REFUSE | EPERM)
    yield _instruction(_RETURN, _ALLOW)


def _instruction(code: int, value: int, *, then: int = 0, otherwise: int = 0) -> bytes:
    return struct.pack("HBBI", code, then, otherwise, value)


def confine(level: BoxLevel, rules: Sequence[Rules] = ()) -> None:
    """Confines this process and its children for good, at a given sandbox level.

    System calls that jobs do not need are blocked at the levels `box` and `landlock`.

    Args:
        level: Sandbox level: `box` gives up the privileges over the box that the process is already in; `landlock`
            applies rules; `none` does nothing more.
        rules: Landlock rules.

    Raises:
        OSError: The kernel refuses.
    """
    if level == "none":
        return
    leave_keyrings()
    drop_capabilities()
    if level == "landlock":
        restrict(rules)
    stay_visible()
    filter_system_calls()
