"""Resources of a shared machine that jobs wait for, and for how long."""

from collections.abc import Mapping
from typing import Literal

Scarce = Literal["slots", "memory", "disk"]
"""Resource of the machine that a job waits for."""

WAITS_FOR: Mapping[Scarce, str] = {"slots": "a slot", "memory": "memory", "disk": "disk"}
"""The same in words, after `waits for`."""

Wait = Scarce | Literal["worker"]
"""Resource that the jobs of a run wait for: one of this machine, or a job worker elsewhere."""

IN_WORDS: Mapping[Wait, str] = {**WAITS_FOR, "worker": "a job worker"}
"""All of these in words, after `waits for`."""

NOTICED_S = 1.0
"""Shorter waits are not recorded, in seconds."""


def noticed(waited_s: Mapping[Scarce, float]) -> dict[Scarce, float]:
    """The waits that are long enough to be recorded.

    Args:
        waited_s: how long, by what was waited for, in seconds.
    """
    return {scarce: round(time_s, 1) for scarce, time_s in waited_s.items() if time_s >= NOTICED_S}
