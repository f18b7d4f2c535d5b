"""Ends what an agent that was killed has left running, found by a variable in the environment of each process."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path

HOME_VARIABLE = "ROBOMAKER_AGENT_HOME"
"""Every program that an agent starts has its home in this variable."""

VERSION_VARIABLE = "ROBOMAKER_AGENT_VERSION"
"""Programs of an application have the folder of their version in this one."""


def kill_leftovers(home: Path, version: str | None = None) -> int:
    """Kills processes that an agent of this home has started, and what they have started.

    Args:
        home: the agent's.
        version: only those of a version's application, by its folder.

    Returns:
        How many there were.
    """
    marks = [f"{HOME_VARIABLE}={home}".encode()]
    if version is not None:
        marks.append(f"{VERSION_VARIABLE}={version}".encode())
    killed = 0
    for entry in os.scandir("/proc"):
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        with suppress(OSError):  # it has ended, or is not ours
            variables = Path(entry.path, "environ").read_bytes().split(b"\0")
            if all(mark in variables for mark in marks):
                os.kill(int(entry.name), signal.SIGKILL)
                killed += 1
    return killed
