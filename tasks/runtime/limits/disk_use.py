"""Disk use of a run: measures its folders, and detects when they exceed their limit.

A supervisor must not be blocked for long, so folders are walked in slices of a fraction of a millisecond, one for each
check. Slices are longer while the disk loses space quickly.
"""

import heapq
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.programs import FoundFiles
from ...files.untrusted_files import HeldFile, deleted_files, files_below

PAUSE_S = 1.0
"""Seconds between two walks through the folders."""
SLICE_S = 0.0003
"""Time limit in seconds for one slice of a walk; ten slices a second take 0.3 % of a processor."""
URGENT_SLICE_S = 0.01
"""Time limit in seconds for one slice while the disk loses space so quickly that the limit may soon be reached."""
LAST_LOOK_S = 2.0
"""Time limit in seconds for the last walk, at the end of a run."""
NOTHING_FOUND = FoundFiles(size_bytes=0, at_s=0.0)
_LOOK_S = 0.09
_URGENT_SHARE = 0.25
"""Share of the bytes that the run may still write; if the disk loses more than that during a walk, slices become
longer.
"""
_NAMED = 3
_WORTH_NAMING = 0.01
"""Share of the limit below which a file is not named as a cause."""


def free_bytes(folder: Path) -> int:
    """Returns the free bytes for this user on a folder's disk; 0 if the folder does not exist."""
    try:
        return shutil.disk_usage(folder).free
    except OSError:  # the application may have removed it
        return 0


class DiskMeter:
    """Measures how much a run's processes have written to disk, a little at each call.

    Args:
        folders: Folders to measure, with their names in messages; a folder may contain another one.
        limit_bytes: Maximum total size of new data in the folders; None: no limit.
        found: Files that existed before the run, which do not count.
        processes: Function that returns the ids of the run's processes; their deleted but open files count, too.
        clock: Monotonic clock, in seconds.
        free: Function that returns the free bytes on a folder's disk.
    """

    def __init__(
        self,
        folders: Mapping[Path, str],
        limit_bytes: int | None,
        found: FoundFiles = NOTHING_FOUND,
        *,
        processes: Callable[[], Iterable[int]] = tuple,
        clock: Callable[[], float] = time.perf_counter,
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        self._folders = _outermost(folders)
        self._names = dict(folders)
        self._limit_bytes = limit_bytes
        self._found = found
        self._processes = processes
        self._clock = clock
        self._free = free
        self._walk: Iterator[None] | None = None
        self._next_look_s = 0.0
        self._next_walk_s = clock() + PAUSE_S
        self._free_bytes = 0
        """Free bytes of the disk when the last walk through the folders began."""
        self._headroom_bytes = limit_bytes or 0
        """Number of bytes that the run may still write, as of the last complete walk."""
        self._used_bytes = -found.size_bytes
        self._deleted_bytes = 0
        """Number of bytes in deleted files that are still open, found in the present walk."""
        self._most = (0, 0)
        """Largest number of bytes found in any walk, and the part of it in deleted files."""
        self._biggest: list[tuple[int, str]] = []
        """Largest files with their sizes, the smallest of them first."""

    def look(self) -> bool:
        """Continues the measurement of the run's folders for a short time; returns whether their limit is exceeded.

        Returns false at once if there is no limit, or the last call was a moment ago.
        """
        now = self._clock()
        if self._limit_bytes is None or now < self._next_look_s:
            return False
        self._next_look_s = now + _LOOK_S
        is_urgent = self._free_bytes - self._free(self._folders[0]) > _URGENT_SHARE * self._headroom_bytes
        if self._walk is None and (now >= self._next_walk_s or is_urgent):
            self._begin()
        self._go_on(now + (URGENT_SLICE_S if is_urgent else SLICE_S))
        return self._used_bytes > self._limit_bytes

    def last_look(self) -> str | None:
        """Measures all folders after the run; returns a message if they ever exceeded the limit, else `None`."""
        if self._limit_bytes is None:
            return None
        self._begin()
        self._go_on(self._clock() + LAST_LOOK_S)
        return self._in_words(self._limit_bytes) if self._most[0] > self._limit_bytes else None

    def _begin(self) -> None:
        self._free_bytes = self._free(self._folders[0])
        self._used_bytes, self._deleted_bytes, self._biggest = -self._found.size_bytes, 0, []
        self._walk = self._measure()

    def _go_on(self, until_s: float) -> None:
        if self._walk is None:
            return
        for _ in self._walk:
            if self._clock() >= until_s:
                break
        else:
            self._walk = None
            self._next_walk_s = self._clock() + PAUSE_S
            self._headroom_bytes = (self._limit_bytes or 0) - self._used_bytes
        self._most = max(self._most, (self._used_bytes, self._deleted_bytes))

    def _measure(self) -> Iterator[None]:
        devices: set[int] = set()
        for file in files_below(self._folders):
            if file is not None:
                devices.add(file.device)
                self._used_bytes += file.size_bytes
                if file.changed_s > self._found.at_s:
                    self._remember(file)
            yield
        for size in deleted_files(self._processes(), devices):
            self._used_bytes += size or 0
            self._deleted_bytes += size or 0
            yield

    def _remember(self, file: HeldFile) -> None:
        if len(self._biggest) < _NAMED:
            heapq.heappush(self._biggest, (file.size_bytes, file.path))
        elif file.size_bytes > self._biggest[0][0]:
            heapq.heapreplace(self._biggest, (file.size_bytes, file.path))

    def _in_words(self, limit_bytes: int) -> str:
        most_bytes, deleted_bytes = self._most
        biggest = [
            f"{self._named(Path(path))} ({in_gb(size)})"
            for size, path in sorted(self._biggest, reverse=True)
            if size > _WORTH_NAMING * limit_bytes
        ]
        deleted = f", {in_gb(deleted_bytes)} of it in files that were deleted and still open" if deleted_bytes else ""
        named = f"; the biggest files are {', '.join(biggest)}" if biggest else ""
        return f"{in_gb(limit_bytes)} of disk are allowed, and it used {in_gb(most_bytes)}{deleted}{named}"

    def _named(self, path: Path) -> str:
        """Returns a file's path as the application sees it: `output/big.bin`, `/home/robomaker/big.bin`."""
        folder = next(folder for folder in path.parents if folder in self._names)
        return f"{self._names[folder]}/{path.relative_to(folder)}"


def disk_meter(plan: RunPlan, processes: Callable[[], Iterable[int]] = tuple) -> DiskMeter:
    """Makes the disk meter for all folders that a run's processes may write to.

    Args:
        plan: Plan of the run.
        processes: Function that returns the ids of the run's processes.
    """
    return DiskMeter(_folders_of(plan), plan.compute.disk_bytes, plan.found or NOTHING_FOUND, processes=processes)


def found_files(plan: RunPlan) -> FoundFiles:
    """Returns the size of the files that a run's folders have before anything runs, so that these are no outputs.

    Args:
        plan: Plan of the run.
    """
    files = files_below(_outermost(_folders_of(plan)))
    size_bytes = sum(file.size_bytes for file in files if file is not None)
    return FoundFiles(size_bytes=size_bytes, at_s=time.time())


def _folders_of(plan: RunPlan) -> dict[Path, str]:
    called = {plan.output_dir: "output", plan.work_dir: "work"}
    if plan.root_dir is not None:
        called[plan.root_dir] = ""
    for folder in (plan.checkpoint_dir, *(program.folder for program in plan.programs)):
        if folder is not None:
            called.setdefault(folder, folder.name)
    return called


def _outermost(folders: Iterable[Path]) -> list[Path]:
    """Returns the folders that are not inside another one of them."""
    every = set(folders)
    return [folder for folder in folders if every.isdisjoint(folder.parents)]


def in_gb(count: int) -> str:
    """Formats a number of bytes for messages: `128 GB`, `1.25 GB`, `20 MB`."""
    return f"{count / 1e9:.3g} GB" if count >= 1e9 else f"{count / 1e6:.3g} MB"
