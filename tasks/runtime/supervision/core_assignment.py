"""Assigns processor cores to runs, so that runs that share a machine are spread over it."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Cores:
    """Counts how many runs use each core of this machine; threads may share it.

    Args:
        available: Numbers of the cores; absent: those that this process may use.
        first: Where to begin, so that several job workers on one machine do not all begin with the
            same core; absent: somewhere that depends on the process.
    """

    def __init__(self, available: list[int] | None = None, first: int | None = None) -> None:
        cores = sorted(os.sched_getaffinity(0)) if available is None else available
        start = (os.getpid() if first is None else first) % len(cores)
        self._runs = dict.fromkeys(cores[start:] + cores[:start], 0)
        self._lock = threading.Lock()

    @contextmanager
    def taken(self, count: int | None) -> Iterator[list[int] | None]:
        """Chooses the cores with the fewest runs and counts one more on them for as long as the context lasts.

        Args:
            count: How many; None: as many as there are.

        Yields:
            Their numbers; None for all, which needs no confinement.
        """
        if count is None or count >= len(self._runs):
            yield None
            return
        with self._lock:
            chosen = sorted(self._runs, key=self._runs.__getitem__)[:count]
            self._add(chosen, 1)
        try:
            yield chosen
        finally:
            with self._lock:
                self._add(chosen, -1)

    def _add(self, cores: list[int], runs: int) -> None:
        for core in cores:
            self._runs[core] += runs
