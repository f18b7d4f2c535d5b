"""Slot of a job among those that simulate, given back once the job only draws videos and uploads."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.runs.programs import StopReason
from ..catalog import Resource
from ..machine.machine_slots import MachineSlots, Turn

Take = Callable[[ExitStack], Turn | None]
"""Function that waits for a slot to simulate and puts its release on the stack; `None`: the job has to stop."""

Permit = Callable[[ExitStack], bool]
"""Function that takes permission to finish beside simulating jobs, without waiting; returns whether one was free."""


IS_STORED = "Terminating"
"""Status of a job whose run is over and whose outputs are being uploaded; the end of its batch does not affect it."""

SIMULATED = "simulatedAt"
"""Member of a job's document with the time at which its programs ended; from then on it draws videos or uploads."""


def only_finishes(job: Resource, reason: StopReason) -> bool:
    """Whether a running job may still upload its outputs although its batch has to stop."""
    if job.status == IS_STORED:
        return True
    return reason is StopReason.BATCH_TIMED_OUT and SimulationJobDocument.of(job).simulated_at is not None


def _no_turn(_: ExitStack) -> Turn | None:
    """Returns at once the right to simulate without a wait; for jobs that need no slot of the machine."""
    return Turn({})


def _no_permit(_: ExitStack) -> bool:
    return False


class Place(AbstractContextManager["Place"]):
    """A job's place on its machine: first a slot to simulate, then permission to finish (upload). Context manager.

    Args:
        take: Function that waits for a slot to simulate; None as its result: the job has to stop.
        permit: Function that takes permission to finish, without waiting; returns whether one was free.
    """

    def __init__(self, take: Take = _no_turn, permit: Permit = _no_permit) -> None:
        self._take, self._permit = take, permit
        self._held, self._finishing = ExitStack(), ExitStack()
        self._simulates = False

    def simulate(self) -> Turn | None:
        """Waits until the machine has a free slot, and takes it, so that the job may simulate.

        Returns:
            Time that the job waited for the machine; `None`: the job has to stop.
        """
        if self._simulates:
            return Turn({})
        self._finishing.close()
        turn = self._take(self._held)
        self._simulates = turn is not None
        return turn

    def finish(self) -> None:
        """Exchanges the job's slot for a place to upload, so that another can simulate; keeps it if none is free."""
        with ExitStack() as finishing:
            if self._simulates and self._permit(finishing):
                self._finishing = finishing.pop_all()
                self._simulates = False
                self._held.close()

    def __exit__(self, *_: object) -> None:
        self._held.close()
        self._finishing.close()


def permit_of(machine: MachineSlots) -> Permit:
    """Returns a function that takes a place to finish (draw and upload) on a machine; it has as many as slots.

    The function returns false if all places are taken; else the exit stack that it is given releases the place.
    """

    def permit(stack: ExitStack) -> bool:
        place = machine.take_finishing()
        if place is not None:
            stack.callback(machine.give_back, place)
        return place is not None

    return permit
