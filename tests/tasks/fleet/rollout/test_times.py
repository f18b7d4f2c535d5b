"""What is kept of a rollout's course: when robots got their orders and came to each step, and pauses."""

from itertools import pairwise

from helpers.small_rollouts import SmallRollout
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.fleet.rollouts.rollout import Pause, Paused, Resumed, Rollout
from prefect_robomaker.tasks.fleet.rollout.windows import MOST_PAUSES, with_pause


def test_the_first_time_of_each_step_is_kept_for_the_latest_order() -> None:
    small = SmallRollout(1)
    small.offer()
    small.wait(2)
    small.fetch("r0")
    small.wait(1.26)
    small.progress("r0", "DownloadingExtracting", 10)
    small.wait(1)
    small.progress("r0", "DownloadingExtracting", 90)
    small.wait(1)
    small.progress("r0", "Launching")

    state = small.robot("r0")
    assert (state.offered_s, state.started_s) == (1000, 1002)
    assert state.step_times == {"DownloadingExtracting": 1003.3, "Launching": 1005.3}
    assert Rollout.of_json(small.rollout.to_json()) == small.rollout


def test_another_order_begins_anew() -> None:
    small = SmallRollout(2)
    small.offer()
    small.fetch("r1")
    small.progress("r1", "Launching")
    small.succeed("r1")
    small.wait(100)  # r0 does not answer
    small.wait(5)
    small.progress("r0", "DownloadingExtracting", 5)  # it had just begun
    assert small.robot("r0").step_times != {}
    small.give_up("r0")
    small.offer()

    assert small.robot("r0").offered_s == 1105
    assert small.robot("r0").step_times == {}


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
