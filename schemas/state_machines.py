"""State machines: states of a resource, and transitions by event."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from .wire.errors import StateConflictError

State = TypeVar("State", bound=str)


@dataclass(frozen=True)
class Lifecycle(Generic[State]):
    """A state machine: its states, the initial one, and the transitions by event."""

    name: str
    """Name of the resource for messages: `the simulation job`."""

    initial: State
    """First state of a new resource."""

    states: tuple[State, ...]
    """All states of the resource."""

    terminal: frozenset[State]
    """Final states, from which no event leads."""

    transitions: Mapping[tuple[State, str], State]
    """Next state by state and event; missing pairs are not allowed."""

    not_when_canceled: frozenset[str] = frozenset()
    """Events that are not allowed any more after a cancellation was requested."""

    @property
    def events(self) -> frozenset[str]:
        """Names of all events of the state machine."""
        return frozenset(event for _, event in self.transitions)


def next_state(machine: Lifecycle[State], state: str, event: str) -> State:
    """Returns the state of a state machine after an event.

    Raises:
        StateConflictError: The event cannot happen in that state; the message says what can.
    """
    for (before, happened), after in machine.transitions.items():
        if (before, happened) == (state, event):
            return after
    possible = sorted(happened for before, happened in machine.transitions if before == state)
    hint = f"possible are {', '.join(possible)}" if possible else "nothing is possible any more"
    raise StateConflictError(f"{machine.name} is {state}: {event!r} cannot happen; {hint}")


def transition_table(rows: Mapping[str, tuple[tuple[State, ...], State]]) -> dict[tuple[State, str], State]:
    """Converts rows `{event: (states before, state after)}` to a table from (state, event) to the next state."""
    return {(before, event): after for event, (befores, after) in rows.items() for before in befores}
