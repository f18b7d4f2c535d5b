"""Targets of attacks on the machine that a job runs on: a victim process, servers, files, keys, memory.

`tests/attacks/escapes/escapes.py` has the attacks, by the same names.
"""

import ctypes
import os
import socket
import sqlite3
import subprocess
import sys
import sysconfig
import threading
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from helpers.paths import TESTS
from helpers.run_processes import wait_until

ESCAPES = TESTS / "attacks" / "escapes"
ADD_KEY, KEYCTL, SESSION_KEYRING, KEYCTL_UNLINK = 248, 250, -3, 9
MARK = "robomaker-victim"
SHARED_KEY = 0x52424D4B + os.getpid()
OF_SOME_KERNELS: dict[str, str | None] = {
    **dict.fromkeys(("user faults", "io_uring", "performance counters", "bpf", "network cards")),
    **dict.fromkeys(("file system", "watching all files", "ports of the processor")),
    "kernel log": "/dev/kmsg",
    "memory of the kernel": "/proc/kcore",
    "group of processes": "/sys/fs/cgroup/cgroup.procs",
    "loop devices": "/dev/loop-control",
}
SYSTEM_OF_ROOT = {
    *("mount", "chroot", "setuid", "device", "shadow", "sysctl", "host name", "file handle", "system", "owner"),
    *("system programs", "packets", "raw sockets"),
    *("processes of its own", "network of its own", "messages of its own"),
}


@pytest.fixture
def victim() -> Iterator[subprocess.Popen[bytes]]:
    """A process like a job worker, with a secret in its environment."""
    command = [sys.executable, "-c", "import time; time.sleep(600)", MARK]
    with subprocess.Popen(command, env={"SECRET_KEY": "s3cret"}) as process:
        wait_until(lambda: b"SECRET" in Path(f"/proc/{process.pid}/environ").read_bytes())
        yield process
        process.kill()


@pytest.fixture
def listeners(tmp_path: Path) -> Iterator[dict[str, Any]]:
    """Servers of this machine, which greet whoever connects."""
    places: dict[str, Any] = {"abstract socket": f"{MARK}-{hash(tmp_path)}", "socket": str(tmp_path / "home" / "s")}
    (tmp_path / "home").mkdir(exist_ok=True)
    servers = []
    for family, address in (
        (socket.AF_INET, ("127.0.0.1", 0)),
        (socket.AF_UNIX, "\0" + places["abstract socket"]),
        (socket.AF_UNIX, places["socket"]),
    ):
        server = socket.socket(family)
        server.bind(address)
        server.listen()
        servers.append(server)
        threading.Thread(target=greet, args=[server], daemon=True).start()
    memory = ctypes.CDLL(None, use_errno=True)
    number = memory.shmget(SHARED_KEY, 4096, 0o1600)  # made, or found
    file = Path("/dev/shm", f"{MARK}-{os.getpid()}")
    file.write_text("s3cret")
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp,
        socket.create_server(("::1", 0), family=socket.AF_INET6) as six,
    ):
        udp.bind(("127.0.0.1", 0))
        threading.Thread(target=answer, args=[udp], daemon=True).start()
        threading.Thread(target=greet, args=[six], daemon=True).start()
        places |= {"udp": udp.getsockname()[1], "tcp of version 6": six.getsockname()[1]}
        places |= {"shared memory": str(file), "shared memory of System V": SHARED_KEY}
        yield {**places, "tcp": servers[0].getsockname()[1]}
        six.shutdown(socket.SHUT_RDWR)
    file.unlink()
    memory.shmctl(number, 0, None)  # removes it
    for server in servers:
        server.shutdown(socket.SHUT_RDWR)  # which also ends its thread's wait
        server.close()


def answer(server: socket.socket) -> None:
    while True:
        try:
            server.sendto(b"hi", server.recvfrom(100)[1])
        except OSError:
            return


def greet(server: socket.socket) -> None:
    while True:
        try:
            with server.accept()[0] as client:
                client.sendall(b"hi")
        except OSError:
            return


@pytest.fixture(scope="module")
def key() -> Iterator[str | None]:
    """A key in the session keyring, where the kernel has keyrings."""
    libc = ctypes.CDLL(None, use_errno=True)
    number = libc.syscall(ADD_KEY, b"user", MARK.encode(), b"s3cret", 6, SESSION_KEYRING)
    yield MARK if number > 0 else None
    if number > 0:
        libc.syscall(KEYCTL, KEYCTL_UNLINK, number, SESSION_KEYRING)


@cache
def succeeds(attack: str) -> bool:
    """Whether an attack succeeds here, where nothing confines it."""
    target = OF_SOME_KERNELS[attack]
    code = f"import sys; sys.path.insert(0, {str(ESCAPES)!r}); import escapes; "
    code += f"sys.exit(not escapes.ATTACKS[{attack!r}]({target!r}))"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0


@pytest.fixture
def targets(
    tmp_path: Path, victim: subprocess.Popen[bytes], listeners: dict[str, Any], key: str | None
) -> dict[str, Any]:
    """Targets of an attack."""
    home = tmp_path / "home"
    with sqlite3.connect(home / "catalog.db") as database:
        database.execute("CREATE TABLE jobs (secret)")
        database.execute("INSERT INTO jobs VALUES ('s3cret')")
    for name in ("other/output/result.json", "user/.aws/credentials", "home/runs/data/map.json"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("s3cret")
    targets: dict[str, Any] = dict.fromkeys(
        (
            *("environ", "working directory", "root of a process", "ptrace", "kill", "memory", "memory by a call"),
            *("memory by a file", "descriptors of a process", "stolen descriptor", "limits of a process"),
            "other limits of a process",
            *("priority of a process", "processors of a process", "group of a process", "session of a process"),
            *("kill order", "traffic of a process", "namespace of a process"),
        ),
        victim.pid,
    )
    other = str(tmp_path / "other/output/result.json")
    targets |= {
        "processes": MARK,
        "supervisor": None,
        "catalog": str(home / "catalog.db"),
        "touch the catalog": str(home / "catalog.db"),
        "other output": str(tmp_path / "other/output/result.json"),
        "cloud keys": str(tmp_path / "user/.aws/credentials"),
        "installed packages": sysconfig.get_path("purelib") + "/escaped.py",
        "input": str(home / "runs/data/escaped.json"),
        "temporary files": str(tmp_path / "other"),
        **dict.fromkeys(("upwards", "move", "rights"), other),
        "files of a process": f"/proc/{victim.pid}/root{other}",
        "home": str(tmp_path / "user"),
        "start of a shell": str(tmp_path / "user/.bashrc"),
        **dict.fromkeys(("user namespace", "clone", "clone3")),
        **listeners,
    }
    if key is not None:
        targets |= {"keyring": key, "own key": key}
    targets |= {name: target for name, target in OF_SOME_KERNELS.items() if succeeds(name)}
    if os.geteuid() == 0:
        targets |= dict.fromkeys(SYSTEM_OF_ROOT)
        targets |= {"mount": "/mnt", "chroot": "/usr", "device": str(tmp_path / "home/runs/device")}
        targets |= {"file handle": other, "owner": other}
        targets |= {"system": "/etc/escaped", "system programs": "/usr/local/bin/escaped"}
        targets |= {"shadow": "/etc/shadow", "sysctl": "/proc/sys/kernel/core_pattern"}
    return targets
