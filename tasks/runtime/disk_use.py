"""What a run has written into its folders, and finding out when that is too much.

The supervisor has no time to lose: folders are walked in slices of a fraction of a millisecond, one each time it looks
at what the run uses. While nothing suggests that much is being written that is all; while the disk loses space quickly
the slices are longer.
"""

import heapq
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from ...schemas.simulation_run import RunPlan

PAUSE_S = 1.0
"""From the end of one walk to the beginning of the next."""
SLICE_S = 0.0003
"""What a look may take, ten times a second: 0.3 % of a processor."""
URGENT_SLICE_S = 0.01
"""The same while the disk loses space so quickly that the limit may soon be reached."""
LAST_LOOK_S = 2.0
"""What the last look, at the end of a run, may take."""
_LOOK_S = 0.09
_URGENT_SHARE = 0.25
"""Of what the run may still write: what the disk may lose from one walk to the next before it becomes urgent."""
_BLOCK_BYTES = 512
_LEAST_BYTES = 4096
"""What a file counts at least: an empty one has its place on the disk too."""
_NAMED = 3
_WORTH_NAMING = 0.01
"""Of the limit; smaller files are nobody's fault."""


class DiskMeter:
    """Measures what folders hold, a little at a time.

    Args:
        folders: The folders, and what they are called in messages; one may be in another.
        limit_bytes: What they may hold together; None: as much as they like.
        spared: Folders in them that do not count.
        clock: Seconds.
    """

    def __init__(
        self,
        folders: Mapping[Path, str],
        limit_bytes: int | None,
        spared: Sequence[Path] = (),
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._folders = [folder for folder in folders if not folders.keys() & set(folder.parents)]
        self._names = dict(folders)
        self._limit_bytes = limit_bytes
        self._spared = {str(folder) for folder in spared}
        self._clock = clock
        self._walk: Iterator[None] | None = None
        self._next_look_s = 0.0
        self._next_walk_s = clock() + PAUSE_S
        self._free_bytes = 0
        """Free space of the disk when the last walk began."""
        self._headroom_bytes = limit_bytes or 0
        """What might still be written, as of the last walk that came to its end."""
        self._used_bytes = 0
        self._most_bytes = 0
        """The most that was found in any walk."""
        self._biggest: list[tuple[int, str]] = []
        """The biggest files, the smallest of them first."""

    def look(self) -> bool:
        """Goes on with measuring; returns whether there is too much."""
        now = self._clock()
        if self._limit_bytes is None or now < self._next_look_s:
            return False
        self._next_look_s = now + _LOOK_S
        is_urgent = self._is_urgent()
        if self._walk is None and (now >= self._next_walk_s or is_urgent):
            self._begin()
        self._go_on(now + (URGENT_SLICE_S if is_urgent else SLICE_S))
        return self._used_bytes > self._limit_bytes

    def last_look(self) -> str | None:
        """Measures all of it, once nobody writes any more; returns limit and use in words if there was too much."""
        if self._limit_bytes is None:
            return None
        self._begin()
        self._go_on(self._clock() + LAST_LOOK_S)
        return self._in_words(self._limit_bytes) if self._most_bytes > self._limit_bytes else None

    def _begin(self) -> None:
        self._free_bytes = self._free()
        self._used_bytes, self._biggest = 0, []
        self._walk = self._files()

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
        self._most_bytes = max(self._most_bytes, self._used_bytes)

    def _is_urgent(self) -> bool:
        return self._free_bytes - self._free() > _URGENT_SHARE * self._headroom_bytes

    def _free(self) -> int:
        with suppress(OSError):  # the application may have removed it
            disk = os.statvfs(self._folders[0])
            return disk.f_bavail * disk.f_frsize
        return 0

    def _files(self) -> Iterator[None]:
        """Counts one file after the other; links are not followed, a file of several names counts for each."""
        waiting = [str(folder) for folder in self._folders]
        while waiting:
            with suppress(OSError), os.scandir(waiting.pop()) as entries:  # it may be gone, or its path be too long
                for entry in entries:
                    if not entry.is_dir(follow_symlinks=False):
                        self._count(entry)
                    elif entry.path not in self._spared:
                        waiting.append(entry.path)
                    yield

    def _count(self, entry: "os.DirEntry[str]") -> None:
        with suppress(OSError):  # it may be gone
            size = max(entry.stat(follow_symlinks=False).st_blocks * _BLOCK_BYTES, _LEAST_BYTES)
            self._used_bytes += size
            if len(self._biggest) < _NAMED:
                heapq.heappush(self._biggest, (size, entry.path))
            elif size > self._biggest[0][0]:
                heapq.heapreplace(self._biggest, (size, entry.path))

    def _in_words(self, limit_bytes: int) -> str:
        biggest = [
            f"{self._named(Path(path))} ({in_gb(size)})"
            for size, path in sorted(self._biggest, reverse=True)
            if size > _WORTH_NAMING * limit_bytes
        ]
        named = f"; the biggest files are {', '.join(biggest)}" if biggest else ""
        return f"{in_gb(limit_bytes)} of disk are allowed, and it used {in_gb(self._most_bytes)}{named}"

    def _named(self, path: Path) -> str:
        """A file as whoever knows the run calls it: `output/big.bin`, `/home/robomaker/big.bin`."""
        folder = next(folder for folder in path.parents if folder in self._names)
        return f"{self._names[folder]}/{path.relative_to(folder)}"


def disk_meter(plan: RunPlan) -> DiskMeter:
    """The meter of all folders that a run's processes are given to write to; data sources do not count."""
    called = {plan.output_dir: "output", plan.work_dir: "work"}
    if plan.root_dir is not None:
        called[plan.root_dir] = ""
    for folder in (plan.checkpoint_dir, *(program.folder for program in plan.programs)):
        if folder is not None:
            called.setdefault(folder, folder.name)
    return DiskMeter(called, plan.compute.disk_bytes, [plan.data_dir] if plan.data_dir else [])


def in_gb(count: int) -> str:
    """Bytes in words: `128 GB`, `1.25 GB`, `20 MB`."""
    return f"{count / 1e9:.3g} GB" if count >= 1e9 else f"{count / 1e6:.3g} MB"
