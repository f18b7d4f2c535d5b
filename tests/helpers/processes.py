"""Real processes for tests: found by their folder, watched until they are gone, stopped with their group."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


def wait_for(probe: Callable[[], T], what: str, timeout_s: float = 200.0) -> T:
    """Asks until the answer is true, and returns it; the longer that takes, the more seldom, up to half a second.

    The limit is for what never comes: a busy machine takes many times as long as an idle one.
    """
    began = time.monotonic()
    while not (answer := probe()):
        waited_s = time.monotonic() - began
        assert waited_s < timeout_s, f"waited {timeout_s:g} s for {what}"
        time.sleep(min(0.1 + waited_s / 20, 0.5))
    return answer


def working_below(folder: Path) -> set[int]:
    """Processes whose working directory is below a folder: simulations that run."""
    found = set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if (entry / "cwd").readlink().is_relative_to(folder):
                    found.add(int(entry.name))
            except OSError:
                continue  # it has ended, or belongs to somebody else
    return found


def descendants(pid: int) -> set[int]:
    """All processes that a process has started, directly or not."""
    children: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            # "pid (name) state parent …"; the name may itself contain parentheses and blanks.
            parent = int(stat.read_text(errors="replace").rpartition(")")[2].split()[1])
        except OSError:
            continue  # it has ended
        children.setdefault(parent, []).append(int(stat.parent.name))
    found: set[int] = set()
    reached = [pid]
    while reached:
        below = children.get(reached.pop(), [])
        found.update(below)
        reached.extend(below)
    return found


def alive(pids: set[int]) -> set[int]:
    """Which of some processes have not ended."""
    return {pid for pid in pids if Path(f"/proc/{pid}/cwd").exists()}


def kill_tree(pid: int) -> None:
    """Kills a process and all that it has started, directly or not, as the end of a machine does."""
    for each in (pid, *descendants(pid)):
        with suppress(ProcessLookupError):
            os.kill(each, signal.SIGKILL)


@contextmanager
def started(command: list[str], environ: Mapping[str, str], **options: object) -> Iterator[subprocess.Popen[str]]:
    """A process with a group of its own, all of which is killed at the end."""
    process = subprocess.Popen(command, env={**os.environ, **environ}, text=True, start_new_session=True, **options)  # type: ignore[call-overload]
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@contextmanager
def process_worker(pool: str, environ: Mapping[str, str], log: Path) -> Iterator[subprocess.Popen[str]]:
    """A Prefect process worker; what it writes, and its flow runs, goes to a log."""
    command = [sys.executable, "-m", "prefect", "worker", "start", "--pool", pool, "--type", "process"]
    with log.open("w") as output, started(command, environ, stdout=output, stderr=subprocess.STDOUT) as worker:
        try:
            yield worker
        finally:
            # Asked first: it stops its flow runs, which have groups of their own.
            worker.send_signal(signal.SIGINT)
            try:
                worker.wait(20)
            except subprocess.TimeoutExpired:
                os.killpg(worker.pid, signal.SIGKILL)
