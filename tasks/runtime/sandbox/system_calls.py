"""A filter of system calls that no simulation needs and in which mistakes of kernels are found, as of containers.

What Docker's profile refuses to programs without capabilities is refused here. `ptrace` is not: debuggers and
sanitizers of a job use it, and it reaches the job's own processes only. The rules are compiled here: they are a list,
and pyseccomp, one person's, needs a library of the system that not every machine has. seccomp(2) has the form.
"""

import ctypes
import os
import struct
from collections.abc import Iterator, Sequence
from errno import EINVAL, ENOSYS, EPERM
from typing import NamedTuple

_SECCOMP = {"x86_64": 317, "aarch64": 277}
_SET_MODE_FILTER, _SPECULATE = 1, 1 << 2
"""The second: speculative execution stays as it is; older kernels would slow down all that has a filter."""
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_NUMBER_AT, _MACHINE_AT, _ARGUMENT_AT, _THIRD_AT = 0, 4, 16, 32
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000
_X32 = 0x40000000
_NEW_NAMESPACES = 0x7E020000
"""`CLONE_NEW…` of users, mounts, processes, networks, IPC, names and control groups."""
_LIBC = ctypes.CDLL(None, use_errno=True)

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
    """Numbers of one kind of programs; several kinds run on one machine."""

    identity: int
    column: int
    unshare: int
    clone: int
    limits: int
    """`prlimit64`: without a box a process could take files and time from its job worker."""


_CLONE3 = 435
"""Its arguments are in memory, where no filter looks; who finds it missing uses `clone`."""
_MACHINES = {
    "x86_64": (_Machine(0xC000003E, 0, 272, 56, 302), _Machine(0x40000003, 1, 310, 120, 340)),
    "aarch64": (_Machine(0xC00000B7, 2, 97, 220, 261),),
}


def filter_system_calls() -> bool:
    """Refuses the calls to this process and all that it starts; it must have `no_new_privs`.

    Returns:
        Whether it did: not on other machines than 64-bit x86 and ARM, nor where the kernel has no filters.

    Raises:
        OSError: the kernel refuses.
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
    """The filter as instructions of the kernel: for each kind of programs what it is refused, for others everything."""
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
