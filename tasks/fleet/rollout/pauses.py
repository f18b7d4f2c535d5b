"""Pauses of a rollout: between a person's decisions to pause it and to resume it; pure functions."""

from ....schemas.fleet.rollouts.rollout import Pause, Paused, Resumed

MOST_PAUSES = 100
"""Limit of the stored pauses of a rollout; earlier ones are deleted."""


def with_pause(pauses: tuple[Pause, ...], event: Paused | Resumed, now_s: float) -> tuple[Pause, ...]:
    """Returns the pauses of a deployment after a person began or ended one; a repetition changes nothing.

    Args:
        pauses: Earlier pauses, oldest first.
        event: A person's decision.
        now_s: The time, in seconds since the epoch.
    """
    last = pauses[-1] if pauses else None
    is_paused = last is not None and last.until_s is None
    if isinstance(event, Paused):
        return pauses if is_paused else (*pauses, Pause(from_s=now_s))[-MOST_PAUSES:]
    return (*pauses[:-1], last.model_copy(update={"until_s": now_s})) if last is not None and is_paused else pauses
