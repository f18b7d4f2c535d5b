"""How a robot's part of a rollout ends, with which status and failure code."""

import pytest
from helpers.small_rollouts import SmallRollout

from prefect_robomaker.schemas.fleet.rollouts.rollout import (
    CancelRefused,
    Failed,
    Fetched,
    Outage,
    ReportedCode,
    RobotGone,
    Stopped,
    Succeeded,
)
from prefect_robomaker.schemas.wire.base import choices


def test_a_robot_goes_through_its_steps_and_is_in_sync() -> None:
    rollout = SmallRollout(1)
    assert rollout.shown("r0") == ("PendingNewDeployment", None)
    assert rollout.offer() == ["r0"]
    assert rollout.shown("r0") == ("PendingNewDeployment", None)

    rollout.fetch("r0")
    rollout.progress("r0", "ExecutingPreLaunch")
    assert rollout.shown("r0") == ("Deploying", None)
    rollout.succeed("r0")

    assert rollout.shown("r0") == ("InSync", None)
    assert rollout.end == ("Succeeded", None)


@pytest.mark.parametrize("code", choices(ReportedCode))
def test_a_failure_keeps_its_code_and_reason(code: ReportedCode) -> None:
    rollout = SmallRollout(2)
    rollout.offer()
    rollout.fetch("r0", "r1")
    rollout.fail("r0", code)
    rollout.succeed("r1")

    assert rollout.shown("r0") == ("Failed", code)
    assert rollout.robot("r0").failure_reason == "exit code 3"
    assert rollout.end == ("Succeeded", None)  # one of two is below the threshold of 100 %


def test_a_robot_that_never_fetches_its_order_does_not_respond() -> None:
    rollout = SmallRollout(2, concurrent_percentage=50)
    rollout.offer()
    rollout.wait(99)
    assert rollout.shown("r0") == ("PendingNewDeployment", None)
    assert rollout.ledger.wake_s() == 1100

    rollout.wait(1)

    assert rollout.shown("r0") == ("NoResponse", "RobotDeploymentNoResponse")
    assert rollout.robot("r0").finished_s == 1100
    assert rollout.cancellations() == {"r0": 1}
    assert rollout.offer() == ["r1"]  # it does not block the others


def test_a_robot_that_falls_silent_loses_its_connection() -> None:
    rollout = SmallRollout(2)
    rollout.offer()
    rollout.succeed("r1")
    rollout.wait(90)
    rollout.fetch("r0")
    rollout.wait(30)
    rollout.progress("r0", "Launching")
    rollout.fetch("r0")  # again, after a loss of power: its time goes on
    rollout.wait(69)
    assert rollout.shown("r0") == ("Deploying", None)

    rollout.wait(1)

    assert rollout.shown("r0") == ("Failed", "RobotAgentConnectionTimeout")
    assert rollout.robot("r0").failure_reason == (
        "the robot did not end within 100 s of fetching its order; it was last heard of 70 s earlier, while Launching"
    )
    assert rollout.cancellations() == {"r0": 1}


def test_a_robot_without_its_architecture_fails_alone() -> None:
    rollout = SmallRollout(3, unfit={"r1"}, threshold_percentage=1)

    assert rollout.offer() == ["r0", "r2"]
    rollout.succeed("r0", "r2")

    assert rollout.shown("r1") == ("Failed", "MissingRobotApplicationArchitecture")
    assert rollout.end == ("Succeeded", None)


def test_a_robot_that_returns_gets_another_order_after_it_answered() -> None:
    rollout = SmallRollout(3)
    rollout.offer()
    rollout.succeed("r1")
    rollout.wait(100)
    assert [rollout.shown(f"r{n}")[0] for n in range(3)] == ["NoResponse", "InSync", "NoResponse"]
    assert rollout.end == ("Succeeded", None)
    assert rollout.offer() == []

    rollout.wait(1e6)
    rollout.give_up("r2")

    assert rollout.offer() == ["r2"]
    assert rollout.number("r2") == 4
    assert rollout.shown("r2") == ("PendingNewDeployment", "RobotDeploymentNoResponse")
    rollout.succeed("r2")
    assert rollout.shown("r2") == ("InSync", None)
    assert rollout.end == ("Succeeded", None)


def test_robots_that_return_while_it_goes_on_keep_to_the_concurrency() -> None:
    rollout = SmallRollout(4, concurrent_percentage=25)
    rollout.offer()
    rollout.wait(100)
    assert rollout.offer() == ["r1"]

    rollout.give_up("r0")

    assert rollout.offer() == []
    rollout.succeed("r1")
    assert [rollout.offer(), rollout.succeed("r2"), rollout.offer(), rollout.succeed("r3")] == [
        ["r2"],
        None,
        ["r3"],
        None,
    ]
    assert rollout.offer() == ["r0"]  # the others come first
    rollout.succeed("r0")
    assert rollout.shown("r0") == ("InSync", None)


def test_a_silent_robot_that_answers_gets_no_other_order() -> None:
    rollout = SmallRollout(2)
    rollout.offer()
    rollout.fetch("r0")
    rollout.succeed("r1")
    rollout.wait(100)
    rollout.give_up("r0")

    assert rollout.offer() == []
    assert rollout.shown("r0") == ("Failed", "RobotAgentConnectionTimeout")
    assert rollout.cancellations() == {}


@pytest.mark.parametrize("refuses", [False, True])
def test_a_robot_that_was_given_up_and_succeeds_is_in_sync(refuses: bool) -> None:
    rollout = SmallRollout(2)
    rollout.offer()
    rollout.fetch("r0")
    rollout.succeed("r1")
    rollout.wait(100)
    if refuses:
        rollout.refuse("r0")
        assert rollout.cancellations() == {}
        assert rollout.shown("r0") == ("Failed", "RobotAgentConnectionTimeout")

    rollout.succeed("r0")

    assert rollout.shown("r0") == ("InSync", None)
    assert rollout.cancellations() == {}


def test_a_result_may_come_before_the_news_that_the_order_was_fetched() -> None:
    rollout = SmallRollout(1)
    rollout.offer()
    rollout.succeed("r0")
    before = rollout.rollout

    rollout.fetch("r0")

    assert rollout.rollout == before
    assert rollout.shown("r0") == ("InSync", None)


def test_a_robot_that_gives_up_by_itself_has_aborted() -> None:
    rollout = SmallRollout(2)
    rollout.offer()
    rollout.fetch("r0")
    rollout.give_up("r0")

    assert rollout.shown("r0") == ("Failed", "RobotDeploymentAborted")


def test_news_of_closed_strange_and_earlier_orders_change_nothing() -> None:
    rollout = SmallRollout(2)
    rollout.offer()
    rollout.fail("r0")
    before = rollout.rollout

    rollout.succeed("r0")
    rollout.give_up("r0")
    rollout.refuse("r0")
    rollout.happen(
        Fetched(robot="r1", action_id=77),
        Failed(robot="r1", action_id=1, code="EtagMismatch"),
        Succeeded(robot="of another fleet", action_id=1),
    )

    assert rollout.rollout == before


def test_an_order_of_an_earlier_rollout_is_answered_first() -> None:
    rollout = SmallRollout(2, earlier={"r0": 900})
    rollout.offer()
    assert rollout.cancellations() == {"r0": 900}
    assert rollout.ledger.unanswered() == {"r0": 900}

    rollout.happen(CancelRefused(robot="r0", action_id=900), Fetched(robot="r0", action_id=900))
    assert rollout.cancellations() == {"r0": 900}

    rollout.happen(Succeeded(robot="r0", action_id=900))  # it has the earlier version now, not this one

    assert rollout.cancellations() == {}
    assert rollout.shown("r0") == ("PendingNewDeployment", None)
    rollout.succeed("r0")
    assert rollout.shown("r0") == ("InSync", None)


def test_a_robot_that_never_answers_an_earlier_order_does_not_respond() -> None:
    rollout = SmallRollout(2, earlier={"r0": 900})
    rollout.offer()
    rollout.succeed("r1")
    rollout.wait(100)

    assert rollout.shown("r0") == ("NoResponse", "RobotDeploymentNoResponse")
    assert rollout.cancellations() == {"r0": 900}


def test_a_robot_is_canceled_when_it_leaves() -> None:
    rollout = SmallRollout(3, concurrent_percentage=67)
    rollout.offer()
    rollout.fetch("r0")
    rollout.happen(RobotGone(robot="r0", how="left"), RobotGone(robot="r2", how="deleted"))
    assert rollout.cancellations() == {"r0": 1}
    assert rollout.shown("r0") == ("Available", None)

    rollout.succeed("r0", "r1")

    assert rollout.offer() == []
    assert rollout.robot("r0").outcome is None
    assert rollout.end == ("Succeeded", None)


def test_an_outage_of_the_service_costs_robots_no_time() -> None:
    rollout = SmallRollout(2)
    rollout.offer()
    rollout.fetch("r0")
    rollout.wait(60)
    rollout.now_s += 5000
    rollout.happen(Outage(since_s=1060), Outage(since_s=1060))

    assert rollout.shown("r0") == ("Deploying", None)
    assert rollout.ledger.wake_s() == 1100 + 5000
    rollout.wait(40)
    assert rollout.shown("r0") == ("Failed", "RobotAgentConnectionTimeout")
    assert rollout.shown("r1") == ("NoResponse", "RobotDeploymentNoResponse")


def test_a_robot_that_begins_while_the_rollout_is_canceled_has_aborted() -> None:
    rollout = SmallRollout(2)
    rollout.offer()
    rollout.happen(Stopped(why="canceled"))
    assert rollout.shown("r0") == ("Registered", None)

    rollout.fetch("r0")
    rollout.give_up("r0")
    rollout.give_up("r1")

    assert rollout.shown("r0") == ("Failed", "RobotDeploymentAborted")
    assert rollout.shown("r1") == ("Registered", None)
    assert rollout.offer() == []
