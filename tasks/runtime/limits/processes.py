"""Process trees from `/proc`: descendants, their resource use, and killing all of them.

A supervisor adopts processes whose parents died (it is a *child subreaper*), so that all processes that a run started
are its descendants, also those that forked twice or made a session of their own.
docs/decisions/0004-processes-and-disk.md says what is read here and not through psutil, and why.
"""

import ctypes
import os
import signal
import time
from collections.abc import Container, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_POLL_S = 0.002
_PAGE_BYTES = os.sysconf("SC_PAGESIZE")
_HAS_ROLLUP = Path("/proc/self/smaps_rollup").exists()
_LIBC = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True)
class ProcessState:
    """State of one process, from `/proc/<pid>/stat` (proc(5))."""

    pid: int
    state: str
    """State letter; `Z` is a zombie that waits to be reaped."""

    parent: int
    group: int
    session: int
    threads: int
    resident_bytes: int
    """Resident memory in bytes, including pages shared with other processes."""

    started: int = 0
    """Start time, in ticks since the machine started; process ids are reused."""


def adopt_orphans() -> None:
    """Makes this process the parent of all descendants whose parents die (child subreaper).

    Raises OSError if the kernel refuses.
    """
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)


def die_with_parent() -> None:
    """Has the kernel kill this process when its parent ends (`PR_SET_PDEATHSIG`).

    Raises OSError if the kernel refuses.
    """
    _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def come_first() -> None:
    """Raises the scheduling priority of this process (not of its children), if permitted.

    Otherwise a run that forks without end leaves a thousandth of the machine to its supervisor.
    """
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(1))


def process_state(pid: int) -> ProcessState | None:
    """Returns the state of a process (parent, threads, memory) from `/proc`; `None` if there is no such process."""
    try:
        text = Path(f"/proc/{pid}/stat").read_bytes()
    except OSError:
        return None
    # "pid (name) state parent …"; the name may itself contain parentheses and blanks.
    fields = text.rpartition(b")")[2].split()
    return ProcessState(
        pid=pid,
        state=fields[0].decode(),
        parent=int(fields[1]),
        group=int(fields[2]),
        session=int(fields[3]),
        threads=int(fields[17]),
        resident_bytes=int(fields[21]) * _PAGE_BYTES,
        started=int(fields[19]),
    )


def proportional_bytes(pid: int) -> int | None:
    """Returns a process's memory in bytes with shared pages divided among their users (`Pss`).

    The value is exact, but the kernel walks all page tables for it, which takes milliseconds for a large process, and
    blocks while the process is changing its memory.

    Returns:
        Bytes, 0 if the process has just ended; None if this kernel or this user cannot measure it.
    """
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_bytes()
    except PermissionError:
        return None
    except OSError:
        return 0 if _HAS_ROLLUP else None
    for line in text.splitlines():
        if line.startswith(b"Pss:"):
            return int(line.split()[1]) * 1024
    return 0


def written_bytes(pid: int) -> int:
    """Returns the bytes that a process and its reaped children have written (`wchar`, proc(5)); 0 if it is gone."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/io").read_bytes().splitlines():
            if line.startswith(b"wchar:"):
                return int(line.split()[1])
    return 0


def children_of(pid: int) -> list[int]:
    """Returns the ids of a process's direct children, zombies included; none if the process is gone or not readable."""
    try:
        threads = os.listdir(f"/proc/{pid}/task")  # noqa: PTH208 - a list of names, four times faster
        lists = [Path(f"/proc/{pid}/task/{thread}/children").read_bytes() for thread in threads]
    except FileNotFoundError:
        if Path("/proc/self/task", str(os.getpid()), "children").exists():
            return []  # the process has just gone
        return _children_from_all(pid)  # the kernel was built without such lists
    except OSError:
        return []
    return [int(child) for children in lists for child in children.split()]


def descendants_of(pid: int) -> Iterator[ProcessState]:
    """Yields the states of all processes below a process, each after its parent, without the process itself."""
    waiting = children_of(pid)
    while waiting:
        child = waiting.pop()
        state = process_state(child)
        if state is not None:
            yield state
            waiting += children_of(child)


def kill_children(spared: Container[int] = ()) -> dict[int, int]:
    """Kills all children and their descendants, and waits until they are gone.

    Whole process groups are killed at once, so that a process that forks all the time cannot escape.

    Args:
        spared: Children that are not killed; they have to be in process groups of their own.

    Returns:
        The wait status of every process that was reaped, spared ones that ended by themselves included.
    """
    own = os.getpid()
    ended: dict[int, int] = {}
    while left := [child for child in children_of(own) if child not in spared]:
        began = time.monotonic()
        reached: set[int] = set()
        for pid in _stop_all(left):
            _send(signal.SIGKILL, pid, reached)
        _reap(ended)
        # Those that die need the processor more than this process, which may come before them (`come_first`).
        time.sleep(max(_POLL_S, 4.0 * (time.monotonic() - began)))
    return ended


def _stop_all(children: list[int]) -> set[int]:
    """Stops (SIGSTOP) processes and all their descendants; returns them.

    Stopped processes neither fork, nor make room for others to fork, nor compete for the processor.
    """
    stopped: set[int] = set()
    fresh = True
    while fresh:
        fresh = False
        waiting, reached = list(children), set[int]()
        while waiting:
            pid = waiting.pop()
            if pid not in stopped:
                _send(signal.SIGSTOP, pid, reached)
                stopped.add(pid)
                fresh = True
            waiting += _children_of_first_thread(pid)
    return stopped


def _send(number: signal.Signals, pid: int, reached: set[int]) -> None:
    """Sends a signal to a descendant's process group; ids are not reused soon, so it cannot hit another process.

    Args:
        number: Signal to send.
        pid: Process to signal.
        reached: Process groups that have just had the signal.
    """
    with suppress(ProcessLookupError, PermissionError):
        group = os.getpgid(pid)
        if group == os.getpgrp():
            os.kill(pid, number)
        elif group not in reached:
            reached.add(group)
            os.killpg(group, number)


def _children_of_first_thread(pid: int) -> list[int]:
    """Returns most children of a process, four times faster than all; the others are found when they are orphans."""
    try:
        with open(f"/proc/{pid}/task/{pid}/children", "rb", buffering=0) as listed:  # noqa: PTH123
            return [int(child) for child in listed.read().split()]
    except OSError:
        return []


def _reap(ended: dict[int, int]) -> None:
    """Reaps all child processes that have ended, and stores their wait statuses by process id."""
    with suppress(ChildProcessError):
        while (reaped := os.waitpid(-1, os.WNOHANG))[0]:
            ended[reaped[0]] = reaped[1]


def _children_from_all(pid: int) -> list[int]:
    numbers = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    states = (process_state(number) for number in numbers)
    return [state.pid for state in states if state is not None and state.parent == pid]


def _prctl(option: int, value: int) -> None:
    if _LIBC.prctl(option, value, 0, 0, 0) != 0:
        error = ctypes.get_errno()
        raise OSError(error, f"prctl({option}) failed: {os.strerror(error)}")
