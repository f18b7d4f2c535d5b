"""When a rollout was paused, for those who look at it later."""

from ....schemas.rollouts.events import Paused, Resumed
from ....schemas.rollouts.rollout import Pause

MOST_PAUSES = 100
"""Earlier ones are forgotten."""


def with_pause(pauses: tuple[Pause, ...], event: Paused | Resumed, now_s: float) -> tuple[Pause, ...]:
    """The pauses after one has begun or ended; a repetition changes nothing.

    Args:
        pauses: those before, oldest first.
        event: what a person wants.
        now_s: when, in seconds since the epoch.
    """
    last = pauses[-1] if pauses else None
    is_paused = last is not None and last.until_s is None
    if isinstance(event, Paused):
        return pauses if is_paused else (*pauses, Pause(from_s=now_s))[-MOST_PAUSES:]
    return (*pauses[:-1], last.model_copy(update={"until_s": now_s})) if last is not None and is_paused else pauses
