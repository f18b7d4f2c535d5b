"""Decides on which machines job workers are to be started. Pure: it starts none, and the time is passed in.

A machine is a name that means the same machine each time: what it is called is up to the backend.
"""

from collections.abc import Collection
from dataclasses import dataclass

from ...schemas.exit_codes import BAD_USAGE, INTERRUPTED, OK
from .backend import BackendError
from .node import Ended

FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 60.0
"""How long a machine is left alone after its job worker has ended; each further pause is twice as long."""

STEADY_S = 60.0
"""A job worker that lasted this long was well; pauses after it begin anew."""

_MOST_REASONS = 3  # more make a message that is not read


@dataclass
class _Machine:
    started_at: float | None = None
    """`None`: no job worker runs there."""

    ends_in_a_row: int = 0
    not_before: float = 0.0
    refuses: bool = False
    """Whether its last job worker could not use its settings."""

    reason: str = ""
    """Why its last job worker ended, unless it ended well."""

    @property
    def runs(self) -> bool:
        return self.started_at is not None


class Staffing:
    """Machines that have job workers of a batch, and machines that are to get one.

    Args:
        place: where the machines are, in words: `the Dask cluster tcp://10.0.0.7:8786`.
        wanted: how many job workers can be of use.
    """

    def __init__(self, place: str, wanted: int) -> None:
        self._place = place
        self._wanted = wanted
        self._machines: dict[str, _Machine] = {}
        self._present: tuple[str, ...] = ()
        self._proven = False

    def to_start(self, present: Collection[str], now: float) -> list[str]:
        """Chooses machines that get a job worker now; from then on they count as having one.

        Args:
            present: the machines that there are; those named first are taken first.
            now: seconds of a clock that never goes back.

        Returns:
            The machines.

        Raises:
            BackendError: the settings of every machine are wrong, and none has done any work.
        """
        self._present = tuple(present)
        self._check()
        room = self._wanted - sum(machine.runs for machine in self._machines.values())
        chosen: list[str] = []
        for name in self._present:
            machine = self._machines.setdefault(name, _Machine())
            if len(chosen) < room and not machine.runs and now >= machine.not_before:
                machine.started_at = now
                chosen.append(name)
        return chosen

    def ended(self, name: str, ended: Ended, now: float) -> None:
        """Notes that the job worker of a machine has ended, though the batch has not.

        Args:
            name: the machine.
            ended: how it ended.
            now: as for `to_start`.
        """
        machine = self._machines[name]
        assert machine.started_at is not None
        machine.refuses = ended.exit_code == BAD_USAGE
        steady = not machine.refuses and now - machine.started_at >= STEADY_S
        self._proven = self._proven or steady or ended.exit_code in (OK, INTERRUPTED)
        machine.ends_in_a_row = 1 if steady else machine.ends_in_a_row + 1
        pause_s = FIRST_PAUSE_S * 2 ** min(machine.ends_in_a_row - 1, 10)
        machine.not_before = now + min(pause_s, LONGEST_PAUSE_S)
        machine.reason = "" if ended.exit_code == OK else ended.reason
        machine.started_at = None

    @property
    def words(self) -> str:
        """Job workers of the batch, in words: `2 job workers on the Dask cluster tcp://10.0.0.7:8786`."""
        count = sum(machine.runs for machine in self._machines.values())
        if count:
            text = f"{count} job worker{'' if count == 1 else 's'} on {self._place}"
        elif self._present:
            text = f"no job worker runs on {self._place} now"
        else:
            text = f"{self._place} has no machine yet"
        return "; ".join([text, *self._reasons()])

    def _check(self) -> None:
        machines = [self._machines.get(name) for name in self._present]
        all_refuse = bool(machines) and all(machine and machine.refuses for machine in machines)
        if all_refuse and not self._proven and not any(machine.runs for machine in self._machines.values()):
            raise BackendError(f"no machine of {self._place} can run jobs: {'; '.join(self._reasons())}")

    def _reasons(self) -> list[str]:
        """Why machines that are present have no job worker."""
        idle = [self._machines[name] for name in self._present if name in self._machines]
        reasons = list(dict.fromkeys(machine.reason for machine in idle if machine.reason and not machine.runs))
        more = len(reasons) - _MOST_REASONS
        return reasons[:_MOST_REASONS] + ([f"and {more} more like these"] if more > 0 else [])
