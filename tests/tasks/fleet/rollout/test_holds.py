"""Rollouts that are held: what stands still, what goes on, what waits for a person."""

from helpers.small_rollouts import SmallRollout

from prefect_robomaker.schemas.fleet.rollouts.rollout import Approved, Outage, Paused, Resumed, Stopped
from prefect_robomaker.tasks.fleet.rollout.statuses import in_words, waits_for

UNTIL_1050 = {"startTime": "00:15", "durationInSeconds": 150}  # rollouts begin at 1000 s, which is 00:16:40
FROM_1200 = {"startTime": "00:20", "durationInSeconds": 600}


def test_a_pause_stops_the_time_of_orders_that_were_not_fetched_and_no_other() -> None:
    rollout = SmallRollout(2)
    rollout.offer()
    rollout.fetch("r1")
    rollout.wait(40)
    rollout.happen(Paused(by="ada"))

    rollout.wait(1000)
    assert rollout.shown("r0") == ("PendingNewDeployment", None)
    assert rollout.shown("r1") == ("Failed", "RobotAgentConnectionTimeout"), "it had begun"

    rollout.happen(Resumed())
    rollout.wait(59)
    assert rollout.shown("r0") == ("PendingNewDeployment", None)
    rollout.wait(1)
    assert rollout.shown("r0") == ("NoResponse", "RobotDeploymentNoResponse")


def test_a_robot_that_fetches_as_its_order_is_held_back_goes_on() -> None:
    rollout = SmallRollout(1)
    rollout.offer()
    rollout.happen(Paused())
    rollout.fetch("r0")
    rollout.wait(99)
    rollout.succeed("r0")
    assert rollout.end == ("Succeeded", None)


def test_who_paused_first_is_remembered() -> None:
    rollout = SmallRollout(1)
    rollout.happen(Paused(by="ada"), Paused(by="bob"))
    assert (rollout.rollout.paused_by, rollout.rollout.paused_s) == ("ada", 1000.0)
    rollout.happen(Resumed())
    assert (rollout.rollout.paused_by, rollout.rollout.paused_s) == (None, None)


def test_windows_hold_and_let_go_by_themselves() -> None:
    rollout = SmallRollout(2, windows=[UNTIL_1050, FROM_1200], concurrent_percentage=50)
    assert rollout.offer() == ["r0"]
    rollout.wait(30)
    rollout.fetch("r0")
    rollout.wait(30)
    rollout.succeed("r0")

    assert rollout.offer() == []
    rollout.wait(139)
    assert rollout.offer() == []
    rollout.wait(1)
    assert rollout.offer() == ["r1"]


def test_in_an_outage_windows_open_and_close_and_no_time_is_lost() -> None:
    rollout = SmallRollout(1, windows=[UNTIL_1050, FROM_1200])
    rollout.offer()
    rollout.wait(10)

    rollout.now_s = 1230.0
    rollout.happen(Outage(since_s=1010))

    rollout.wait(89)
    assert rollout.shown("r0") == ("PendingNewDeployment", None)
    rollout.wait(1)
    assert rollout.shown("r0") == ("NoResponse", "RobotDeploymentNoResponse")


def test_the_time_of_the_whole_does_not_stand_still() -> None:
    rollout = SmallRollout(1, requires_approval=True, job_timeout_s=500)
    rollout.happen(Paused())
    rollout.wait(500)
    assert rollout.end == ("Failed", "FleetDeploymentTimeout")


def test_an_approval_counts_once_the_canaries_have_ended() -> None:
    rollout = SmallRollout(2, canaries=("r1",), requires_approval=True)
    rollout.happen(Approved(by="too early"))
    assert rollout.offer() == ["r1"]
    rollout.succeed("r1")
    assert rollout.offer() == []

    rollout.happen(Approved(by="ada"), Approved(by="bob"))
    assert rollout.offer() == ["r0"]
    assert rollout.rollout.approved_by == "ada"


def test_a_rollout_that_is_not_approved_is_canceled_and_one_that_has_ended_is_not() -> None:
    rollout = SmallRollout(1, requires_approval=True)
    rollout.happen(Stopped(why="rejected", by="ada"))
    assert (rollout.end, rollout.rollout.failure_reason) == (
        ("Canceled", None),
        "the deployment was not approved, says ada",
    )
    ended = SmallRollout(1)
    ended.offer()
    ended.succeed("r0")
    ended.happen(Stopped(why="rejected", by="ada"))
    assert ended.end == ("Succeeded", None)


def test_what_it_waits_for_is_said() -> None:
    rollout = SmallRollout(1, requires_approval=True, windows=[FROM_1200])
    rollout.happen(Paused(by="ada"))
    found = waits_for(rollout.rollout, rollout.now_s)
    assert [wait.cause for wait in found] == ["PAUSED", "APPROVAL", "MAINTENANCE_WINDOW"]
    words = [in_words(wait, "arn:job") for wait in found]
    assert words[0] == "paused by ada; `robomaker fleet resume arn:job` lets it go on"
    assert words[1] == "waits for approval; `robomaker fleet approve arn:job`, or `reject`, decides"
    assert words[2] == "waits for its maintenance window, which opens at 1970-01-01T00:20+00:00"
    rollout.happen(Stopped(why="canceled"))
    assert waits_for(rollout.rollout, rollout.now_s) == []
