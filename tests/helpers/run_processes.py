"""Looking at real processes, for tests."""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path


def never() -> None:
    """Never asks for the run to stop."""


def running() -> Iterator[Path]:
    """The `/proc` folders of all processes that are not merely waiting to be reaped."""
    for entry in Path("/proc").iterdir():
        with suppress(OSError):
            if entry.name.isdigit() and (entry / "stat").read_text().rpartition(")")[2].split()[0] != "Z":
                yield entry


def is_running(pid: int) -> bool:
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def children_of(pid: int) -> list[int]:
    children = []
    for entry in running():
        with suppress(OSError):
            if (entry / "stat").read_text().rpartition(")")[2].split()[1] == str(pid):
                children.append(int(entry.name))
    return children


def processes_with(text: str) -> list[int]:
    """Processes that have a text in their environment or command line, wherever they hang in the tree."""
    found = []
    for entry in running():
        with suppress(OSError):
            if text.encode() in (entry / "cmdline").read_bytes() + (entry / "environ").read_bytes():
                found.append(int(entry.name))
    return found


def processes_in(folder: Path) -> list[int]:
    """Processes that have a working directory, as they call it."""
    found = []
    for entry in running():
        with suppress(OSError):
            if (entry / "cwd").readlink() == folder:
                found.append(int(entry.name))
    return found


def limit_reached(condition: Callable[[], bool]) -> Callable[[], float]:
    """A clock by which the duration limit is reached once a condition holds, and not before."""
    began = time.monotonic()
    has_held = False

    def clock() -> float:
        nonlocal has_held
        has_held = has_held or condition()
        return time.monotonic() + 3600 if has_held else began

    return clock


def wait_until(condition: Callable[[], bool], timeout_s: float = 60.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "it did not become true in time"
        time.sleep(0.02)
