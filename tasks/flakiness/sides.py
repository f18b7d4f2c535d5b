"""The side of a job on which two of its runs first differ: the robot's commands, or the simulation's states."""

from collections.abc import Iterable
from itertools import combinations

from ...schemas.runs.verification import Side
from ..runtime.agents.action_log import ActionLog
from ..runtime.replay.commands import first_other_command
from ..runtime.replay.replay import RunOutputs, first_difference
from .trials import Trial, Trials

REPLAYS = 2
"""Replays of commands, if no two reruns tell by themselves: a simulation that flips every other time repeats both times
in one of four cases.
"""


def side_of(trials: Trials, most: int) -> tuple[Side, str | None]:
    """Finds the side on which reruns differ first, and where; of those with nothing held, if they differ.

    Same commands and other states are the simulation's. Other commands are the robot's if the simulation repeats under
    recorded ones; it is run with them, up to `REPLAYS` times.

    Args:
        trials: Reruns of the job.
        most: Number of replays at most.
    """
    free = [each for each in trials.made if not each.observation.held]
    pair = _differing(free) or _differing(trials.made)
    if pair is None:
        return "unknown", None
    one, other = pair
    states = first_difference(one.outputs, other.outputs)
    at_states = f"at {states.time_s:.2f} s: {states.what}" if states else None
    if one.outputs.actions is None or other.outputs.actions is None:
        plan = one.outputs.provenance.plan
        return ("unknown" if plan.has_robot_program else "one process"), at_states
    same_commands: dict[tuple[bytes, ...], Trial] = {}
    for second in sorted(trials.made, key=lambda each: len(each.observation.held)):
        commands = tuple(_commands(second))
        first = same_commands.setdefault(commands, second) if commands else second
        if first.observation.bits != second.observation.bits and not _same_states(first, second):
            difference = first_difference(first.outputs, second.outputs)
            return "simulation", f"at {difference.time_s:.2f} s: {difference.what}" if difference else None
    for trial in [one, other][: min(REPLAYS, most)]:
        if not _repeats(trial, trials.replay(trial)):
            return "simulation", at_states
    is_known = most > 0 and trials.have_states  # replays that end alike may have gone other ways
    return ("robot" if is_known else "unknown"), _command_in_words(one.outputs, other.outputs) or at_states


def _differing(free: Iterable[Trial]) -> tuple[Trial, Trial] | None:
    """Returns two reruns with other verdicts, or at least other bits; `None` if all are the same."""
    pairs = list(combinations(free, 2))
    verdicts = (pair for pair in pairs if pair[0].observation.verdict != pair[1].observation.verdict)
    bits = (pair for pair in pairs if pair[0].observation.bits != pair[1].observation.bits)
    return next(verdicts, None) or next(bits, None)


def _repeats(trial: Trial, again: Trial) -> bool:
    """Returns whether a replay of commands has the states and the verdict of the rerun that gave them."""
    states, states_again = (each.outputs.provenance.digest for each in (trial, again))
    return states == states_again and trial.observation.verdict == again.observation.verdict


def _same_states(one: Trial, other: Trial) -> bool:
    """Returns whether the states are known to be equal; then a robot that crashed after its last command differs."""
    states, of_other = one.outputs.provenance.digest, other.outputs.provenance.digest
    return states is not None and states == of_other


def _commands(trial: Trial) -> list[bytes]:
    path = trial.outputs.actions
    return list(ActionLog(path)) if path is not None else []


def _command_in_words(one: RunOutputs, other: RunOutputs) -> str | None:
    """Describes the first command in which two runs differ: `at 0.25 s in the command wheels: 1.0 and 0.1`.

    Returns None if their commands are equal; both runs must have recorded them.
    """
    assert one.actions is not None
    assert other.actions is not None
    found = first_other_command(one.actions, other.actions)
    if found is None:
        return None
    end_s = one.result.sim_time_s if one.result is not None else 0.0
    return f"at {found.time_s(end_s):.2f} s in the command{found.name}: {found.values}"
