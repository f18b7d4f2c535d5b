"""The filter of system calls: what it refuses, what works as before, and that its numbers are the kernel's."""

import os
import re
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from prefect_robomaker.tasks.runtime.sandbox.kernel import _MACHINES, _REFUSED

pytestmark = pytest.mark.skipif(os.uname().machine not in _MACHINES, reason="there is no filter for this machine")
FILTERED = """
import ctypes, os, subprocess, sys, threading
from prefect_robomaker.tasks.runtime.sandbox.kernel import drop_capabilities
from prefect_robomaker.tasks.runtime.sandbox.kernel import filter_system_calls
drop_capabilities()
assert filter_system_calls()
libc = ctypes.CDLL(None, use_errno=True)
def refused(number, *arguments):
    return libc.syscall(number, *arguments) == -1 and ctypes.get_errno()
"""
HEADERS = {0: "x86_64-linux-gnu/asm/unistd_64.h", 1: "x86_64-linux-gnu/asm/unistd_32.h", 2: "asm-generic/unistd.h"}


def filtered(code: str, *arguments: str) -> str:
    """What a process prints that has the filter."""
    command = [sys.executable, "-c", FILTERED + code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout


@pytest.mark.parametrize("column", HEADERS)
def test_numbers_are_those_of_the_kernel(column: int) -> None:
    header = Path("/usr/include", HEADERS[column])
    if not header.is_file():
        pytest.skip(f"no {header}")
    pairs = re.findall(r"#define\s+__NR(?:3264)?_(\w+)\s+(\d+)", header.read_text())
    known = {name: int(number) for name, number in pairs}
    assert {name: columns[column] for name, columns in _REFUSED.items()} == {name: known.get(name) for name in _REFUSED}


def test_listed_calls_are_refused_and_new_namespaces_too() -> None:
    column = _MACHINES[os.uname().machine][0].column
    numbers = [str(columns[column]) for columns in _REFUSED.values() if columns[column] is not None]
    code = """
print({refused(int(number), 0, 0, 0, 0, 0) for number in sys.argv[1:]})
print(*(refused(NUMBER, flag) for flag in (0x10000000, 0x00020000, 0x40000000)), refused(435, None, 0))
"""
    code = code.replace("NUMBER", str(_MACHINES[os.uname().machine][0].unshare))
    assert filtered(code, *numbers) == "{1}\n1 1 1 38\n"


def test_forks_threads_programs_and_debuggers_work() -> None:
    code = """
thread = threading.Thread(target=print, args=["thread"], daemon=True)
thread.start()
thread.join()
print(subprocess.run(["echo", "program"], capture_output=True, text=True).stdout.strip())
child = subprocess.Popen(["sleep", "60"])
assert libc.ptrace(16, child.pid, None, None) == 0
os.waitpid(child.pid, 0x40000000)
libc.ptrace(17, child.pid, None, None)
child.kill()
print("debugged", refused(NUMBER, 0x400))
"""
    told = filtered(code.replace("NUMBER", str(_MACHINES[os.uname().machine][0].unshare)))
    assert told == "thread\nprogram\ndebugged False\n"


def test_32_bit_programs_run_and_are_refused_the_same(tmp_path: Path) -> None:
    program = tmp_path / "keys"
    program.write_bytes(_program_of_32_bits())
    program.chmod(0o755)
    try:
        unfiltered = subprocess.run([program], check=False).returncode
    except OSError:
        pytest.skip("this machine runs no 32-bit x86 programs")
    assert unfiltered != 1
    assert filtered("print(subprocess.run(sys.argv[1:]).returncode)", str(program)) == "1\n"


def _program_of_32_bits() -> bytes:
    """A program for i386 that calls `add_key` without arguments; its exit code is the error's number."""
    base = 0x08048000
    call, leave = struct.pack("<BIH", 0xB8, 286, 0x80CD), struct.pack("<BIH", 0xB8, 1, 0x80CD)
    clear = bytes.fromhex("31db 31c9 31d2 31f6 31ff")
    code = clear + call + bytes.fromhex("f7d8 89c3") + leave  # neg eax; mov ebx, eax
    size = 52 + 32 + len(code)
    magic = b"\x7fELF\x01\x01\x01" + bytes(9)
    header = magic + struct.pack("<HHIIIIIHHHHHH", 2, 3, 1, base + 84, 52, 0, 0, 52, 32, 1, 40, 0, 0)
    return header + struct.pack("<IIIIIIII", 1, 0, base, base, size, size, 5, 0x1000) + code


def test_a_process_sets_its_own_limits_and_no_others() -> None:
    code = """
import resource
own, parent = os.getpid(), os.getppid()
resource.setrlimit(resource.RLIMIT_CORE, resource.getrlimit(resource.RLIMIT_CORE))
limits = resource.prlimit(parent, resource.RLIMIT_CORE)
try:
    resource.prlimit(parent, resource.RLIMIT_CORE, limits)
except PermissionError:
    print("refused")
"""
    assert filtered(code) == "refused\n"


def test_numbers_of_looked_at_calls_are_those_of_the_kernel() -> None:
    for machine in _MACHINES[os.uname().machine]:
        header = Path("/usr/include", HEADERS[machine.column])
        if not header.is_file():
            pytest.skip(f"no {header}")
        known = {name: int(number) for name, number in re.findall(r"#define\s+__NR_(\w+)\s+(\d+)", header.read_text())}
        found = (machine.unshare, machine.clone, machine.limits)
        assert found == tuple(known[name] for name in ("unshare", "clone", "prlimit64"))
