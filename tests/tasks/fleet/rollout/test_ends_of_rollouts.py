"""How a whole rollout ends: thresholds, canaries, time, people."""

import pytest
from helpers.small_rollouts import SmallRollout

from prefect_robomaker.schemas.fleet.rollouts.rollout import Offered, Paused, Resumed, RobotGone, StopCause, Stopped


@pytest.mark.parametrize(("robots", "percent", "at_once"), [(10, 25, 2), (3, 20, 1), (7, 100, 7), (200, 1, 2)])
def test_the_concurrency_is_rounded_down_to_one_robot_at_least(robots: int, percent: int, at_once: int) -> None:
    rollout = SmallRollout(robots, concurrent_percentage=percent)

    assert len(rollout.offer()) == at_once
    assert rollout.offer() == []


def test_a_rollout_stops_at_its_threshold_and_lets_robots_finish() -> None:
    rollout = SmallRollout(10, concurrent_percentage=50, threshold_percentage=20)
    rollout.offer()
    rollout.fetch("r0", "r1", "r2")
    rollout.fail("r0")
    assert rollout.offer() == ["r5"]
    rollout.fail("r1")

    assert rollout.end == ("Failed", "FailureThresholdBreached")
    assert rollout.rollout.failure_reason == "2 of 10 robots failed, which is 20 %; the threshold is 20 %"
    assert rollout.offer() == []
    assert set(rollout.cancellations()) == {"r3", "r4", "r5"}  # they had not begun
    assert rollout.shown("r2") == ("Deploying", None)
    assert rollout.shown("r9") == ("Registered", None)
    rollout.fail("r2")  # more failed than the threshold says, as many as may go on at once
    assert rollout.shown("r2") == ("Failed", "PreLaunchFileFailure")
    assert rollout.end == ("Failed", "FailureThresholdBreached")


def test_robots_that_were_away_do_not_get_a_version_that_was_stopped() -> None:
    rollout = SmallRollout(4, concurrent_percentage=50, threshold_percentage=50)
    rollout.offer()
    rollout.wait(100)
    assert rollout.end == ("Failed", "FailureThresholdBreached")

    rollout.give_up("r0")

    assert rollout.offer() == []


def test_canaries_come_first_and_alone() -> None:
    rollout = SmallRollout(10, concurrent_percentage=50, threshold_percentage=60, canaries=("r7", "r3"))
    assert rollout.offer() == ["r7", "r3"]
    rollout.succeed("r7")
    assert rollout.offer() == []

    rollout.fail("r3")

    assert rollout.offer() == ["r0", "r1", "r2", "r4", "r5"]


def test_the_threshold_holds_among_canaries_alone() -> None:
    rollout = SmallRollout(10, threshold_percentage=50, canaries=("r0", "r1"))
    rollout.offer()
    rollout.fail("r1")

    assert rollout.end == ("Failed", "FailureThresholdBreached")
    assert rollout.rollout.failure_reason == "1 of 2 canaries failed, which is 50 %; the threshold is 50 %"


def test_a_canary_that_leaves_does_not_keep_the_others_waiting() -> None:
    rollout = SmallRollout(3, canaries=("r0",))
    rollout.offer()
    rollout.happen(RobotGone(robot="r0", how="deleted"))

    assert rollout.offer() == ["r1", "r2"]


def test_a_rollout_times_out() -> None:
    rollout = SmallRollout(3, concurrent_percentage=67, job_timeout_s=150)
    rollout.offer()
    rollout.wait(80)
    rollout.fetch("r0")
    rollout.wait(60)
    assert rollout.offer() == ["r2"]  # r1 did not fetch its order

    rollout.wait(10)

    assert rollout.end == ("Failed", "FleetDeploymentTimeout")
    assert rollout.rollout.ended_s == 1150
    assert rollout.shown("r0") == ("Failed", "FleetDeploymentTimeout")
    assert rollout.shown("r1") == ("NoResponse", "RobotDeploymentNoResponse")
    assert rollout.shown("r2") == ("Registered", None)
    rollout.give_up("r1")
    assert rollout.offer() == ["r1"]  # the latest deployment, when it returns


@pytest.mark.parametrize(
    ("why", "status", "code", "robot_code"),
    [
        ("canceled", "Canceled", None, "RobotDeploymentAborted"),
        ("application_deleted", "Failed", "RobotApplicationDoesNotExist", "RobotApplicationDoesNotExist"),
        ("fleet_deleted", "Failed", "DeploymentFleetDoesNotExist", "DeploymentFleetDoesNotExist"),
    ],
)
def test_people_end_a_rollout(why: StopCause, status: str, code: str | None, robot_code: str) -> None:
    rollout = SmallRollout(3, concurrent_percentage=67)
    rollout.offer()
    rollout.fetch("r0")
    rollout.happen(Stopped(why=why))

    assert rollout.end == (status, code)
    assert rollout.offer() == []
    assert set(rollout.cancellations()) == {"r0", "r1"}
    assert rollout.shown("r0") == ("Failed", robot_code)
    assert rollout.shown("r1") == ("Registered", None)
    assert rollout.shown("r2") == ("Registered", None)


def test_a_rollout_that_has_ended_stays_as_it_is() -> None:
    rollout = SmallRollout(2)
    rollout.offer()
    rollout.succeed("r0")
    rollout.wait(100)
    rollout.give_up("r1")
    rollout.offer()
    before = rollout.rollout

    rollout.happen(Stopped(why="canceled"))
    assert rollout.rollout == before

    rollout.happen(Stopped(why="superseded"))
    assert rollout.end == ("Succeeded", None)
    assert rollout.cancellations() == {"r1": 3}
    rollout.give_up("r1")
    assert rollout.offer() == []
    assert rollout.shown("r1") == ("NoResponse", "RobotDeploymentNoResponse")


def test_a_pause_keeps_new_orders_back_and_lets_open_ones_go_on() -> None:
    rollout = SmallRollout(4, concurrent_percentage=50)
    rollout.offer()
    rollout.happen(Paused(), Paused())
    rollout.succeed("r0")
    assert rollout.offer() == []
    rollout.happen(Offered(robot="r2", action_id=99))
    assert rollout.robot("r2").order == "none"

    rollout.happen(Resumed())

    assert rollout.offer() == ["r2"]


def test_robots_that_leave_do_not_count() -> None:
    rollout = SmallRollout(4, concurrent_percentage=25, threshold_percentage=50)
    rollout.offer()
    rollout.fail("r0")
    assert rollout.end == ("InProgress", None)

    rollout.happen(RobotGone(robot="r2", how="left"))
    assert rollout.end == ("InProgress", None)
    rollout.happen(RobotGone(robot="r3", how="left"))

    assert rollout.end == ("Failed", "FailureThresholdBreached")  # one of two


def test_a_rollout_whose_robots_all_left_fails() -> None:
    rollout = SmallRollout(2)
    rollout.happen(RobotGone(robot="r0", how="left"), RobotGone(robot="r1", how="left"))

    assert rollout.end == ("Failed", "RobotDeploymentAborted")


def test_a_rollout_to_robots_that_cannot_get_it_fails() -> None:
    rollout = SmallRollout(2, unfit={"r0", "r1"})

    assert rollout.end == ("Failed", "MissingRobotApplicationArchitecture")


def test_orders_that_are_not_due_are_not_taken_in() -> None:
    rollout = SmallRollout(4, concurrent_percentage=25, canaries=("r1",))
    rollout.happen(Offered(robot="r0", action_id=1), Offered(robot="of another fleet", action_id=2))
    assert rollout.ledger.open_orders == 0

    rollout.happen(Offered(robot="r1", action_id=3), Offered(robot="r1", action_id=4))

    assert rollout.number("r1") == 3
    assert rollout.ledger.open_orders == 1


def test_no_more_orders_are_taken_in_than_the_concurrency_allows() -> None:
    rollout = SmallRollout(4, concurrent_percentage=50)
    rollout.happen(*(Offered(robot=f"r{number}", action_id=number + 1) for number in range(4)))

    assert rollout.ledger.open_orders == 2
    assert rollout.robot("r2").order == "none"


def test_a_robot_that_was_away_and_is_canceled_under_way_counts_as_away() -> None:
    rollout = SmallRollout(2)
    rollout.offer()
    rollout.succeed("r0")
    rollout.wait(100)
    rollout.give_up("r1")
    rollout.offer()
    rollout.fetch("r1")
    rollout.happen(Stopped(why="superseded"))

    assert rollout.cancellations() == {"r1": 3}
    assert rollout.shown("r1") == ("NoResponse", "RobotDeploymentNoResponse")
    assert rollout.ledger.unanswered() == {"r1": 3}
