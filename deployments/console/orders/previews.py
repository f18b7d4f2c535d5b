"""Floor plan previews of worlds that do not exist yet, drawn by a child process, with a limit per minute."""

import json
import select
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable

from ....schemas.wire.errors import ThrottlingException

_PROGRAM = "prefect_robomaker.tasks.worldforge.bundle.plan_worker"
_PATIENCE_S = 20.0
"""Time limit for a preview, in seconds.

The first one waits for the process, which imports MuJoCo; each has a second of processor time.
"""

_QUEUE_S = 5.0
_WITHIN_S = 60.0
_MOST_VISITORS = 1_000

MOST_A_MINUTE = 40
"""Limit of previews a minute for one visitor: a form that is being filled in asks after each pause."""


class NoPlanError(Exception):
    """Raised when no floor plan preview can be drawn; says why."""


class Previews:
    """Draws floor plan previews of world templates in a child process.

    Args:
        clock: Seconds that only grow.
        program: The module that draws them.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, program: str = _PROGRAM) -> None:
        self._clock = clock
        self._program = program
        self._process: subprocess.Popen[str] | None = None
        self._drawing = threading.Lock()
        self._asked: dict[str, deque[float]] = {}
        self._counting = threading.Lock()

    def draw(self, body: str, seed: int, visitor: str) -> str:
        """Draws the floor plan of a generation job's first world, as SVG.

        Args:
            body: Body of the world template.
            seed: Seed of the generation job.
            visitor: The visitor who asks.

        Raises:
            NoPlanError: The world cannot be generated, or takes too long.
            ThrottlingException: The visitor, or all of them, ask for too many.
        """
        self._count(visitor)
        if not self._drawing.acquire(timeout=_QUEUE_S):
            raise ThrottlingException("other plans are being drawn; try again in a moment")
        try:
            answer = self._ask(json.dumps({"body": body, "seed": seed}))
        finally:
            self._drawing.release()
        if "svg" not in answer:
            raise NoPlanError(answer.get("error", "it could not be drawn"))
        return answer["svg"]

    def close(self) -> None:
        """Ends the child process that draws floor plans."""
        with self._drawing:
            self._end()

    def _count(self, visitor: str) -> None:
        now = self._clock()
        with self._counting:
            asked = self._asked.pop(visitor, None) or deque(maxlen=MOST_A_MINUTE)
            self._asked[visitor] = asked  # the last to go
            while len(self._asked) > _MOST_VISITORS:
                del self._asked[next(iter(self._asked))]
            if len(asked) == MOST_A_MINUTE and now - asked[0] < _WITHIN_S:
                raise ThrottlingException(f"{MOST_A_MINUTE} plans were drawn for you within a minute; wait a moment")
            asked.append(now)

    def _ask(self, request: str) -> dict[str, str]:
        """Sends a request to the child process that draws plans, and returns its answer; empty if there is none.

        A process that has ended is started again, once. One that does not answer in time is ended.
        """
        for _ in range(2):
            process = self._process = self._process or self._started()
            assert process.stdin is not None
            assert process.stdout is not None
            try:
                process.stdin.write(f"{request}\n")
                process.stdin.flush()
                is_there = select.select([process.stdout], [], [], _PATIENCE_S)[0]
                line = process.stdout.readline() if is_there else ""
            except BrokenPipeError:
                is_there, line = [process.stdout], ""
            if line:
                return json.loads(line)
            self._end()
            if not is_there:
                break
        return {}

    def _started(self) -> subprocess.Popen[str]:
        return subprocess.Popen(
            ["nice", "-n", "5", sys.executable, "-P", "-m", self._program],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,  # it ends with its input, not by Ctrl-C in a terminal
        )

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()
