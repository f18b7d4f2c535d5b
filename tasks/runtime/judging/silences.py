"""Silences of a recording's topics: requirements become errors where something could have been missed."""

import math
from typing import Any

from ....schemas.runs.requirement_kinds.kind import ROUNDING_S, Rule
from .bags import RecordingFault


class Source:
    """A source of measurements (topic) in a recording, with the longest time that it was silent."""

    def __init__(self, name: str, max_gap_s: float) -> None:
        """Prepares a topic whose silences are measured from the beginning of the run.

        Args:
            name: Name of the topic, for messages.
            max_gap_s: Longest acceptable silence in seconds; infinite for topics that publish events only.
        """
        self.name = name
        self._max_gap_s = max_gap_s
        self._last_s = 0.0
        self._stamp_s = -math.inf
        self.rules: list[Rule[Any]] = []
        self.messages = 0

    def hear(self, time_s: float) -> None:
        """Counts a message at a time in seconds; records an error in the rules if the silence before was too long."""
        self.messages += time_s >= 0
        self.look_back(time_s)
        self._last_s = max(self._last_s, time_s)

    def look_back(self, time_s: float) -> None:
        """Records an error in the topic's rules if it was silent for too long until a time in seconds."""
        if time_s - self._last_s > self._max_gap_s + ROUNDING_S:
            words = f"no message on {self.name} from {self._last_s:.2f} to {time_s:.2f} s"
            self._break(f"{words}, longer than max_gap_s ({self._max_gap_s:g} s), so something could have been missed")

    def finish(self, end_s: float) -> None:
        """Records an error in the topic's rules if it was silent for too long at the run's end, or all the time."""
        if not self.messages and math.isfinite(self._max_gap_s):
            self._break(f"no message on {self.name} could be used")
        self.look_back(end_s)

    def check_stamp(self, stamp: Any, path: object) -> None:
        """Checks that a topic's time stamps do not go backwards.

        Raises:
            RecordingFault: The time stamps go backwards.
        """
        stamp_s = stamp.sec + stamp.nanosec / 1e9
        if stamp_s < self._stamp_s - min(1.0, self._max_gap_s):
            raise RecordingFault(
                f"{path}: time goes backwards on {self.name}, from {self._stamp_s:.3f} to {stamp_s:.3f} s; record each "
                "run in a recording of its own"
            )
        self._stamp_s = max(self._stamp_s, stamp_s)

    def _break(self, why: str) -> None:
        for rule in self.rules:
            if not _is_decided(rule, self._last_s):
                rule.fail(why)


def _is_decided(rule: Rule[Any], time_s: float) -> bool:
    """Returns whether a rule was decided before a time: by a violation, or by reaching its goal in time."""
    if rule.violated_s is not None:
        return rule.violated_s <= time_s + ROUNDING_S
    return rule.is_reached is True
