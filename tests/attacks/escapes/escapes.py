"""Ways out of a job, tried for real: each function returns what it got, or fails.

It runs as a program of a job, and is imported by the factory of one. What it is to reach is in `TARGETS`, as JSON.
"""

import ctypes
import json
import os
import resource
import signal
import socket
import sqlite3
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

LIBC = ctypes.CDLL(None, use_errno=True)
ADD_KEY, BPF, PERF_EVENT_OPEN, USERFAULTFD, IO_URING_SETUP, CLONE, CLONE3 = 248, 321, 298, 323, 425, 56, 435
NEW_USER, PTRACE_ATTACH, PTRACE_DETACH = 0x10000000, 16, 17
PIDFD_OPEN, PIDFD_GETFD, PROCESS_VM_READV, NAME_TO_HANDLE, OPEN_BY_HANDLE = 434, 438, 310, 303, 304
FSOPEN, FANOTIFY_INIT = 430, 300
KEYCTL, KEYCTL_SEARCH, SESSION_KEYRING = 250, 10, -3


def called(answer: int) -> int:
    if answer < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return answer


def in_a_fork(action: Callable[[], Any]) -> bool:
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            action()
            code = 0
        finally:
            os._exit(code)
    assert os.waitpid(pid, 0)[1] == 0, "it failed"
    return True


def connect_in_its_folder(path: str) -> bool:
    """Connects to a socket by a short name: the kernel takes 107 bytes, and folders of runs may have more."""
    folder = os.open(Path(path).parent, os.O_PATH | os.O_DIRECTORY)
    return connect(socket.AF_UNIX, f"/proc/self/fd/{folder}/{Path(path).name}")


def connect(family: int, address: Any) -> bool:
    with socket.socket(family) as client:
        client.settimeout(20)
        client.connect(address)
        return client.recv(2) == b"hi"


def written(path: str) -> bool:
    Path(path).write_bytes(b"")
    Path(path).unlink()
    return True


def catalog(target: str) -> Any:
    with sqlite3.connect(f"file:{target}?mode=ro", uri=True) as database:
        return database.execute("SELECT secret FROM jobs").fetchone()


def attach(pid: int) -> bool:
    called(LIBC.ptrace(PTRACE_ATTACH, pid, None, None))
    os.waitpid(pid, 0x40000000)
    LIBC.ptrace(PTRACE_DETACH, pid, None, None)
    return True


def processes(text: str) -> bool:
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if text.encode() in entry.read_bytes() and entry.parent.name != str(os.getpid()):
                return True
        except OSError:
            continue
    return False


def sysctl(path: str) -> bool:
    value = Path(path).read_text()
    Path(path).write_text(value)
    return True


def supervisor(_: Any) -> bool:
    assert os.getppid() > 1, "the parent is not seen"
    os.kill(os.getppid(), 0)
    return True


def foreign_descriptors(_: Any) -> list[str]:
    found = []
    for number in os.listdir("/proc/self/fd"):
        try:
            where = os.readlink(f"/proc/self/fd/{number}")
        except OSError:
            continue
        if where.startswith("socket:") or where.endswith(".db"):
            found.append(where)
    return found


def key(name: str) -> bool:
    return called(LIBC.syscall(KEYCTL, KEYCTL_SEARCH, SESSION_KEYRING, b"user", name.encode(), 0)) > 0


def own_key(name: str) -> bool:
    """A key of the kernel, whose code for them had many mistakes."""
    return called(LIBC.syscall(ADD_KEY, b"user", f"{name}-own".encode(), b"x", 1, SESSION_KEYRING)) > 0


def opened(descriptor: int) -> bool:
    os.close(called(descriptor))
    return True


def counters(_: Any) -> bool:
    """Counts this process's instructions; software counters are there also on virtual machines."""
    attributes = ctypes.create_string_buffer(struct.pack("IIQ", 1, 128, 0) + bytes(24) + struct.pack("Q", 0x61), 128)
    return opened(LIBC.syscall(PERF_EVENT_OPEN, attributes, 0, -1, -1, 0))


def bpf_map(_: Any) -> bool:
    return opened(LIBC.syscall(BPF, 0, ctypes.create_string_buffer(struct.pack("IIII", 2, 4, 4, 1), 128), 128))


def cloned(number: int, *arguments: Any) -> bool:
    """A child in a user namespace of its own; the call keeps Python's lock, which the child needs to leave."""
    pid = ctypes.PyDLL(None, use_errno=True).syscall(number, *arguments)
    if pid == 0:
        os._exit(0)
    os.waitpid(called(pid), 0)
    return True


def stolen(pid: int) -> bool:
    """A descriptor of another process, by a handle of that process."""
    handle = called(LIBC.syscall(PIDFD_OPEN, pid, 0))
    return opened(LIBC.syscall(PIDFD_GETFD, handle, 0, 0))


def copied(pid: int) -> bool:
    """Memory of another process, without a file."""
    begin = int(Path(f"/proc/{pid}/maps").read_text().partition("-")[0], 16)
    buffer = ctypes.create_string_buffer(16)
    ours, theirs = (struct.pack("PN", address, 16) for address in (ctypes.addressof(buffer), begin))
    return called(LIBC.syscall(PROCESS_VM_READV, pid, ours, 1, theirs, 1, 0)) == 16


def by_handle(path: str) -> bytes:
    """A file by its number on the disk, whatever folders are shown."""
    handle, mount = ctypes.create_string_buffer(struct.pack("Ii", 128, 0), 136), ctypes.c_int()
    called(LIBC.syscall(NAME_TO_HANDLE, -100, path.encode(), handle, ctypes.byref(mount), 0))
    folder = os.open(os.path.dirname(path), os.O_RDONLY)
    descriptor = called(LIBC.syscall(OPEN_BY_HANDLE, folder, handle, os.O_RDONLY))
    return os.read(descriptor, 10)


def shared(number: int) -> bool:
    """Memory of System V, by its key."""
    return called(LIBC.shmget(number, 0, 0)) >= 0


def same(path: str) -> bool:
    """Writes into a file what is in it."""
    with open(path, "r+b", buffering=0) as file:
        content = file.read(64)
        file.seek(0)
        file.write(content)
    return True


def asked_by_udp(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.settimeout(5)
        client.connect(("127.0.0.1", port))
        client.send(b"hello")
        return client.recv(2) == b"hi"


def other_links(_: Any) -> list[str]:
    return [name for _, name in socket.if_nameindex() if name != "lo"]


def upwards(path: str) -> str:
    """A file by the way up from an open folder."""
    folder = os.open(".", os.O_RDONLY)
    return Path(f"/proc/self/fd/{folder}/" + "../" * 40 + path).read_text()


def opens(path: str, flags: int = os.O_RDONLY) -> bool:
    os.close(os.open(path, flags))
    return True


def separated(kind: int) -> bool:
    return in_a_fork(lambda: called(LIBC.unshare(kind)))


def limited(pid: int) -> tuple[int, int]:
    """Sets a limit of the job worker: with no file or no time left it ends."""
    return resource.prlimit(pid, resource.RLIMIT_CORE, resource.prlimit(pid, resource.RLIMIT_CORE))


def keeps_priority(pid: int) -> bool:
    os.setpriority(os.PRIO_PROCESS, pid, os.getpriority(os.PRIO_PROCESS, pid))
    return True


ATTACKS: dict[str, Callable[[Any], Any]] = {
    "memory": lambda pid: Path(f"/proc/{pid}/maps").read_text() != "",
    "memory by a call": copied,
    "memory by a file": lambda pid: opens(f"/proc/{pid}/mem", os.O_RDWR),
    "descriptors of a process": lambda pid: os.listdir(f"/proc/{pid}/fd"),
    "stolen descriptor": stolen,
    "limits of a process": lambda pid: resource.prlimit(pid, resource.RLIMIT_NOFILE),
    "other limits of a process": limited,
    "priority of a process": keeps_priority,
    "processors of a process": lambda pid: os.sched_setaffinity(pid, os.sched_getaffinity(pid)) is None,
    # Either is 0 where its leader lives outside the container in which the tests run.
    "group of a process": lambda pid: os.getpgid(pid) >= 0,
    "session of a process": lambda pid: os.getsid(pid) >= 0,
    "kill order": lambda pid: same(f"/proc/{pid}/oom_score_adj"),
    "traffic of a process": lambda pid: Path(f"/proc/{pid}/io").read_text(),
    "namespace of a process": lambda pid: opens(f"/proc/{pid}/ns/mnt"),
    "files of a process": lambda path: Path(path).read_text(),
    "upwards": upwards,
    "move": lambda path: (os.rename(path, f"{path}.moved"), os.rename(f"{path}.moved", path)) is not None,
    "rights": lambda path: os.chmod(path, 0o644) is None,
    "home": os.listdir,
    "start of a shell": written,
    "shared memory": lambda path: Path(path).read_text(),
    "shared memory of System V": shared,
    "udp": asked_by_udp,
    "tcp of version 6": lambda port: connect(socket.AF_INET6, ("::1", port)),
    "socket of outputs": connect_in_its_folder,
    "pipe": lambda path: opens(path, os.O_WRONLY | os.O_NONBLOCK),
    "network cards": other_links,
    "kernel log": lambda path: opens(path, os.O_RDONLY | os.O_NONBLOCK),
    "memory of the kernel": opens,
    "group of processes": lambda path: opens(path, os.O_WRONLY),
    "loop devices": lambda path: opens(path, os.O_RDWR),
    "file system": lambda _: opened(LIBC.syscall(FSOPEN, b"tmpfs", 0)),
    "watching all files": lambda _: opened(LIBC.syscall(FANOTIFY_INIT, 0, 0)),
    "ports of the processor": lambda _: in_a_fork(lambda: called(LIBC.ioperm(0x80, 1, 1))),
    # of root only
    "file handle": by_handle,
    "system": written,
    "system programs": written,
    "owner": lambda path: (os.chown(path, 1, 1), os.chown(path, 0, 0)) is not None,
    "packets": lambda _: socket.socket(socket.AF_PACKET, socket.SOCK_RAW).close() is None,
    "raw sockets": lambda _: socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP).close() is None,
    "processes of its own": lambda _: separated(0x20000000),
    "network of its own": lambda _: separated(0x40000000),
    "messages of its own": lambda _: separated(0x08000000),
    "environ": lambda pid: b"SECRET_KEY" in Path(f"/proc/{pid}/environ").read_bytes(),
    "working directory": lambda pid: os.listdir(f"/proc/{pid}/cwd") is not None,
    "root of a process": lambda pid: os.listdir(f"/proc/{pid}/root/") is not None,
    "processes": processes,
    "ptrace": attach,
    "kill": lambda pid: os.kill(pid, signal.SIGCONT) is None,
    "supervisor": supervisor,
    "catalog": catalog,
    "other output": lambda path: Path(path).read_text(),
    "cloud keys": lambda path: Path(path).read_text(),
    "touch the catalog": lambda path: os.utime(path) is None,
    "installed packages": written,
    "input": written,
    "temporary files": lambda path: Path(path).exists(),
    "tcp": lambda port: connect(socket.AF_INET, ("127.0.0.1", port)),
    "abstract socket": lambda name: connect(socket.AF_UNIX, "\0" + name),
    "socket": lambda path: connect(socket.AF_UNIX, path),
    "user namespace": lambda _: in_a_fork(lambda: called(LIBC.unshare(NEW_USER))),
    "clone": lambda _: cloned(CLONE, NEW_USER | signal.SIGCHLD, None, None, None, None),
    "clone3": lambda _: cloned(CLONE3, struct.pack("QQQQQ", NEW_USER, 0, 0, 0, signal.SIGCHLD) + bytes(24), 64),
    "keyring": key,
    "own key": own_key,
    "user faults": lambda _: opened(LIBC.syscall(USERFAULTFD, os.O_CLOEXEC | 1)),  # of its own accesses only
    "io_uring": lambda _: opened(LIBC.syscall(IO_URING_SETUP, 1, ctypes.create_string_buffer(256))),
    "performance counters": counters,
    "bpf": bpf_map,
    # of root only
    "mount": lambda folder: in_a_fork(
        lambda: called(LIBC.unshare(0x20000)) or called(LIBC.mount(b"none", folder.encode(), b"tmpfs", 0, None))
    ),
    "chroot": lambda folder: in_a_fork(lambda: os.chroot(folder)),
    "setuid": lambda _: in_a_fork(lambda: os.setuid(1)),
    "device": lambda path: in_a_fork(lambda: (os.mknod(path, 0o60600, os.makedev(7, 0)), os.unlink(path))),
    "shadow": lambda path: bool(Path(path).read_text()),
    "sysctl": sysctl,
    "host name": lambda _: in_a_fork(lambda: called(LIBC.unshare(0x4000000)) or socket.sethostname("box")),
}


def try_all(targets: dict[str, Any]) -> dict[str, str]:
    """What each attack got; those that failed are left out."""
    succeeded = {}
    for name, target in targets.items():
        try:
            if got := ATTACKS[name](target):
                succeeded[name] = str(got)
        except (OSError, AssertionError, sqlite3.Error) as error:
            sys.stderr.write(f"{name}: {error}\n")
    if left := foreign_descriptors(None):
        succeeded["descriptors"] = str(left)
    return succeeded


def note() -> None:
    result = json.dumps(try_all(json.loads(os.environ["TARGETS"])))
    Path(os.environ["ROBOMAKER_OUTPUT_DIR"], "escapes.json").write_text(result)


def make_environment(context: Any) -> Any:
    """A factory that attacks."""
    del context
    note()
    sys.exit(0)


if __name__ == "__main__":
    note()
