"""Pauses of a rollout are kept with their ends, one after the other, and no more than so many."""

from itertools import pairwise

from helpers.small_rollouts import SmallRollout
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.fleet.rollouts.rollout import Pause, Paused, Resumed
from prefect_robomaker.tasks.fleet.rollout.pauses import MOST_PAUSES, with_pause


def test_pauses_are_kept_with_their_ends() -> None:
    small = SmallRollout(3)
    small.happen(Paused())
    small.wait(5)
    small.happen(Paused())
    small.wait(5)
    small.happen(Resumed(), Resumed())
    small.wait(10)
    small.happen(Paused())

    assert small.rollout.pauses == (Pause(from_s=1000, until_s=1010), Pause(from_s=1020))
    assert small.rollout.paused


@given(st.lists(st.sampled_from([Paused(), Resumed()]), max_size=300))
def test_pauses_follow_one_another_and_are_bounded(events: list[Paused | Resumed]) -> None:
    pauses: tuple[Pause, ...] = ()
    for now_s, event in enumerate(events):
        pauses = with_pause(pauses, event, float(now_s))

    assert len(pauses) <= MOST_PAUSES
    assert all(pause.until_s is not None for pause in pauses[:-1])
    assert all(early.until_s <= late.from_s for early, late in pairwise(pauses) if early.until_s)
    is_paused = bool(events) and isinstance(events[-1], Paused)
    assert (bool(pauses) and pauses[-1].until_s is None) == is_paused
