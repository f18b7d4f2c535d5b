"""How many job workers a work pool is to have now: pure, with times given.

Prefect does not say on which machine a flow run will run, so places have no names: there are as many as machines. The
place of a job worker that ended too early is left empty for a while, longer each time; a machine that comes meanwhile
gets its job worker at once.
"""

from dataclasses import dataclass, field

_FIRST_PAUSE_S = 5.0
_LONGEST_PAUSE_S = 60.0
_LONG_LIFE_S = 60.0
"""A job worker that lived for so long was healthy: pauses begin anew."""


@dataclass
class Places:
    """The places of job workers."""

    _empty_until: list[float] = field(default_factory=list[float])
    _short_lives: int = 0

    def note_end(self, lived_s: float, now: float) -> None:
        """Takes note of a job worker that ended before its batch.

        Args:
            lived_s: for how many seconds it ran.
            now: the time in seconds, of a clock that only goes forward.
        """
        self._short_lives = 0 if lived_s >= _LONG_LIFE_S else self._short_lives + 1
        pause_s = min(_LONGEST_PAUSE_S, _FIRST_PAUSE_S * 2.0 ** max(0, self._short_lives - 1))
        self._empty_until.append(now + pause_s)

    def missing(self, alive: int, room: int, now: float) -> int:
        """How many to start now; negative: how many there are too many.

        Args:
            alive: how many are scheduled or run.
            room: how many there are to be.
            now: see `note_end`.
        """
        self._empty_until = [until for until in self._empty_until if until > now]
        if alive > room:
            return room - alive
        return max(0, room - alive - len(self._empty_until))
