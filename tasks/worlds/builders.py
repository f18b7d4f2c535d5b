"""Pool of child processes that build worlds, one world at a time each.

They are plain programs and not `multiprocessing`, whose children import the caller's `__main__` again: under a Prefect
worker that is Prefect itself, and in a script without a guard it is the script.
"""

import json
import queue
import shutil
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from ...schemas.wire.errors import WorldGenerationError

_PROGRAM = "prefect_robomaker.tasks.worldforge.bundle.bundle_worker"


MOST_S = 120.0
"""Time after which a builder process that has not answered is killed, in seconds.

The generator itself gives up long before.
"""


class _BuilderDiedError(WorldGenerationError):
    """Raised when a builder process ended without an answer."""


class WorldBuilders:
    """Pool of processes that generate worlds. Context manager; safe to use from several threads.

    A builder that dies is replaced, and its world is begun once more: the machine may have been short of memory for a
    moment.

    Args:
        count: Number of processes.
        log: File their messages are appended to.
        most_s: Seconds that one world may take.
    """

    def __init__(self, count: int, log: Path, most_s: float = MOST_S) -> None:
        self._count = count
        self._log = log
        self.most_s = most_s
        self._lock = threading.Lock()
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
                with suppress(BrokenPipeError):  # of one that died with an order half written
                    process.stdin.close()
            process.wait()
            if process.stdout:
                process.stdout.close()

    def stop(self) -> None:
        """Kills all processes of the pool; calls of `build` fail from then on."""
        with self._lock:
            self._stopped = True
            for process in self._all:
                process.kill()

    def build(self, body: str, floorplan_seed: int, interior_seed: int, folder: Path) -> str:
        """Generates the files of a world in an idle process of the pool; waits for one.

        Returns:
            The bundle's content hash.

        Raises:
            WorldGenerationError: No world can be generated from these values, or the builder died or was stopped.
        """
        order = {
            "body": body,
            "floorplan_seed": floorplan_seed,
            "interior_seed": interior_seed,
            "folder": str(folder),
        }
        try:
            answer = self._ask(json.dumps(order))
        except _BuilderDiedError:
            if self._stopped:
                raise
            shutil.rmtree(folder, ignore_errors=True)  # it may have died with everything done but its answer
            answer = self._ask(json.dumps(order))
        if "error" in answer:
            raise WorldGenerationError(answer["error"])
        return answer["content"]

    def _ask(self, order: str) -> dict[str, str]:
        """Sends an order to the next idle builder, and returns its answer; a dead builder is replaced first.

        It waits until a builder is idle.
        """
        process = self._idle.get()
        try:
            if process.poll() is not None:
                process = self._start()
            return _answer(process, order, self.most_s)
        finally:
            self._idle.put(process)

    def _start(self) -> subprocess.Popen[str]:
        with self._lock, self._log.open("ab") as log:
            if self._stopped:
                raise WorldGenerationError("no more worlds are wanted")
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


def _answer(process: subprocess.Popen[str], order: str, most_s: float) -> dict[str, str]:
    """Returns a builder process's answer to an order.

    Raises:
        _BuilderDiedError: The builder's process ended before its answer.
        WorldGenerationError: The world took too long, and its builder was ended.
    """
    assert process.stdin is not None
    assert process.stdout is not None
    late = threading.Event()

    def end() -> None:
        late.set()
        process.kill()

    timer = threading.Timer(most_s, end)
    timer.daemon = True
    timer.start()
    try:
        process.stdin.write(f"{order}\n")
        process.stdin.flush()
        line = process.stdout.readline()
    except BrokenPipeError:
        line = ""
    finally:
        timer.cancel()
    if line.endswith("\n"):  # otherwise killed in the midst of its answer, at the latest
        return json.loads(line)
    code = process.wait()
    if late.is_set():
        raise WorldGenerationError(f"the world was not built within {most_s:g} s")
    raise _BuilderDiedError(f"the process that built the world ended with code {code}")
