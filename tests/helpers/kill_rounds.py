"""Processes that are killed at random moments and started again, from a seed."""

import os
import random
import signal
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import STDOUT, Popen

from helpers.processes import descendants


@dataclass
class Actor:
    """A process that is started again whenever it has ended.

    Args:
        name: What it is called in the account of a round.
        command: Its words.
        environ: Its variables besides those of the tests.
        log: Where it writes.
    """

    name: str
    command: Sequence[str]
    environ: Mapping[str, str]
    log: Path
    process: Popen[bytes] | None = None
    exit_codes: list[int] = field(default_factory=list)

    def keep(self) -> None:
        """Starts it unless it runs."""
        if self.process is not None and (code := self.process.poll()) is not None:
            self.exit_codes.append(code)
            self.process = None
        if self.process is None:
            with self.log.open("ab") as log:
                environ = {**os.environ, **self.environ}
                self.process = Popen(self.command, env=environ, stdout=log, stderr=STDOUT, start_new_session=True)

    def has_ended(self) -> bool:
        """Whether it does not run."""
        return self.process is None or self.process.poll() is not None

    def kill(self) -> None:
        """Kills the process; what it started is left to itself."""
        if self.process is not None:
            self.process.kill()

    def kill_one_below(self, chance: random.Random) -> None:
        """Kills one of the processes that it has started, directly or not."""
        if self.process is not None and (below := sorted(descendants(self.process.pid))):
            with suppress(ProcessLookupError):
                os.kill(chance.choice(below), signal.SIGKILL)

    def end(self) -> None:
        """Kills it with its group."""
        if self.process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()


def kill_at_random(
    seed: int,
    kills: int,
    targets: Mapping[str, Callable[[], object]],
    keep: Callable[[], None],
    is_over: Callable[[], bool],
    pause_s: tuple[float, float] = (1.0, 6.0),
) -> Counter[str]:
    """Kills targets at moments that the seed decides, until that often or all is over.

    Args:
        seed: The same one gives the same order of targets and pauses.
        kills: How often at most.
        targets: What may be killed, by name.
        keep: Starts what has ended; called several times a second.
        is_over: Asked several times a second.
        pause_s: The shortest and the longest time between two kills.

    Returns:
        How often each was killed.
    """
    chance = random.Random(seed)
    killed: Counter[str] = Counter()
    names = sorted(targets)
    for _ in range(kills):
        due = time.monotonic() + chance.uniform(*pause_s)
        name = chance.choice(names)
        while time.monotonic() < due:
            keep()
            if is_over():
                return killed
            time.sleep(0.2)
        targets[name]()
        killed[name] += 1
    return killed
