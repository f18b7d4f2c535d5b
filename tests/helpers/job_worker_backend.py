"""A backend whose machines are homes on this one: each job worker is a real process with a home of its own."""

import threading
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from prefect_robomaker.tasks.backends.node import Ended, run_job_worker


@dataclass
class HomesBackend:
    """Starts one job worker for each home, once."""

    homes: list[Path]
    variables: Mapping[str, str]
    """Where catalog and object store are."""

    ended: list[Ended] = field(default_factory=list)
    """How the workers ended."""

    patience_s: float = 0.0
    """How long job workers may take to end by themselves once their batch has, before they are told to."""

    @contextmanager
    def job_workers(self, batch: str, wanted: int) -> Generator["HomesBackend"]:
        """Has job workers inside the block."""
        del wanted
        stop = threading.Event()
        threads = [
            threading.Thread(target=lambda home=home: self.ended.append(self._work(batch, home, stop)))
            for home in self.homes
        ]
        for thread in threads:
            thread.start()
        try:
            yield self
            for thread in threads:  # they end with their batch, sooner or later
                thread.join(self.patience_s)
        finally:
            stop.set()
            for thread in threads:
                thread.join()

    def look(self) -> str:
        """Starts no others."""
        return f"{len(self.homes)} job workers on this machine"

    def _work(self, batch: str, home: Path, stop: threading.Event) -> Ended:
        return run_job_worker(batch, {**self.variables, "ROBOMAKER_HOME": str(home)}, stop.is_set)
