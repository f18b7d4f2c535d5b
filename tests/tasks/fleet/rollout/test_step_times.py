"""Times of a rollout that are kept: when robots got their orders, and when they came to each step."""

from helpers.small_rollouts import SmallRollout

from prefect_robomaker.schemas.fleet.rollouts.rollout import Rollout


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
