"""World builders: processes that each build one world at a time.

Plain programs rather than `multiprocessing`, whose children import the caller's `__main__` again:
under a Prefect worker that is Prefect itself, and in a script without a guard it is the script.
"""

import json
import queue
import subprocess
import sys
from pathlib import Path
from types import TracebackType

from ..schemas.errors import WorldGenerationError

_PROGRAM = "prefect_robomaker.tasks.worldforge.worker"


class WorldBuilders:
    """A fixed number of builders; use as a context manager. Safe to use from several threads.

    Args:
      count: how many processes.
      log: file their messages are appended to.
    """

    def __init__(self, count: int, log: Path) -> None:
        self._count = count
        self._log = log
        self._idle: queue.SimpleQueue[subprocess.Popen[str]] = queue.SimpleQueue()
        self._all: list[subprocess.Popen[str]] = []
        self._stopped = False

    def __enter__(self) -> "WorldBuilders":
        for _ in range(self._count):
            self._idle.put(self._start())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is not None:
            self.stop()
        for process in self._all:
            if process.stdin:
                process.stdin.close()
            process.wait()
            if process.stdout:
                process.stdout.close()

    def stop(self) -> None:
        """Ends all builders in the midst of what they do; builds fail from then on."""
        self._stopped = True
        for process in self._all:
            process.kill()

    def build(self, body: str, floorplan_seed: int, interior_seed: int, folder: Path) -> str:
        """Builds a world bundle; waits for an idle builder.

        Returns:
          The bundle's content hash.

        Raises:
          WorldGenerationError: there is no such world, or its builder died or was stopped.
        """
        order = {
            "body": body,
            "floorplan_seed": floorplan_seed,
            "interior_seed": interior_seed,
            "folder": str(folder),
        }
        process = self._idle.get()
        try:
            answer = _ask(process, json.dumps(order))
        finally:
            alive = self._stopped or process.poll() is None
            self._idle.put(process if alive else self._start())
        if "error" in answer:
            raise WorldGenerationError(answer["error"])
        return answer["content"]

    def _start(self) -> subprocess.Popen[str]:
        with self._log.open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", _PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                cwd=self._log.parent,
                start_new_session=True,  # Ctrl-C in a terminal is for the caller to handle
            )
        self._all.append(process)
        return process


def _ask(process: subprocess.Popen[str], order: str) -> dict[str, str]:
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(f"{order}\n")
        process.stdin.flush()
        line = process.stdout.readline()
    except BrokenPipeError:
        line = ""
    if not line.endswith("\n"):  # killed in the midst of its answer, at the latest
        raise WorldGenerationError(f"the process that built the world ended with code {process.wait()}")
    return json.loads(line)
