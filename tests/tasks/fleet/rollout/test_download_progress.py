"""How long a download will still take."""

from helpers.small_rollouts import SmallRollout

from prefect_robomaker.tasks.fleet.rollout.download_progress import remaining_s


def downloading(*percents: float, every_s: float = 10) -> SmallRollout:
    """A robot that reported these shares of its download."""
    rollout = SmallRollout(1, robot_timeout_s=10_000)
    rollout.offer()
    rollout.fetch("r0")
    for number, percent in enumerate(percents):
        rollout.wait(every_s if number else 0)
        rollout.progress("r0", "DownloadingExtracting", percent)
    return rollout


def left_s(rollout: SmallRollout) -> int | None:
    return remaining_s(rollout.robot("r0"), rollout.now_s)


def test_nothing_is_said_before_the_speed_is_known() -> None:
    assert left_s(downloading()) is None
    assert left_s(downloading(40)) is None
    assert left_s(downloading(40, 40)) is None


def test_the_speed_is_that_of_the_whole_download() -> None:
    assert left_s(downloading(0, 10)) == 90
    assert left_s(downloading(0, 10, 40)) == 30
    assert left_s(downloading(0, 100)) == 0


def test_a_resumed_download_is_measured_from_where_it_was() -> None:
    assert left_s(downloading(50, 60)) == 40


def test_a_download_that_begins_again_is_measured_anew() -> None:
    assert left_s(downloading(0, 80, 0)) is None
    assert left_s(downloading(0, 80, 0, 20)) == 40


def test_the_estimate_runs_down_between_reports() -> None:
    rollout = downloading(0, 10)
    rollout.wait(30)
    assert left_s(rollout) == 60
    rollout.wait(500)
    assert left_s(rollout) == 0
