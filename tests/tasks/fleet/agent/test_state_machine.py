"""The agent's state machine: whatever fails and whenever the power goes, the journal names versions that are there."""

from dataclasses import replace

import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.tasks.fleet.agent.deployment import Deployment, File, Launch, Order, Version
from prefect_robomaker.tasks.fleet.agent.errors import NUMBERS
from prefect_robomaker.tasks.fleet.agent.state_machine import (
    BEFORE_SWITCH,
    MAX_ENDS,
    MAX_RESTARTS,
    TRIED,
    Cancelled,
    Checked,
    Delivered,
    End,
    Ended,
    Event,
    Failed,
    Ordered,
    Passed,
    Phase,
    Restarted,
    State,
    Steady,
    Trusted,
    Withdrawn,
    advance,
    kept,
    wanted,
)

SCRIPTED = Launch("courier", "drive", before="before", after="after")
BARE = Launch("courier", "drive")


def version(number: int, launch: Launch = SCRIPTED) -> Version:
    return Version("courier", str(number), f"{number:064x}", launch, f"job-{number}")


def deployment(number: int, *, has_condition: bool = False, newness: "int | None" = None) -> Deployment:
    bundle = File("x", 1, f"{number:064x}")
    condition = File("y", 1, "0" * 64) if has_condition else None
    return Deployment(version(number), bundle, condition, newness or number)


def order(number: int) -> Order:
    return Order(number, f"applications/courier/deployments/{number}.json")


def state_in(phase: Phase, **changes: object) -> State:
    """A state with order 2 in a phase, while version 1 is good."""
    found = None if phase is Phase.VALIDATING else deployment(2)
    failure = ("RobotDeploymentAborted", "it was unhealthy") if phase is Phase.RETURNING else None
    return replace(State(phase, order(2), found, version(1), failure=failure), **changes)  # type: ignore[arg-type]


class Robot:
    """A robot as the state machine sees it: a disk with complete versions, and a journal."""

    def __init__(self) -> None:
        self.state = State()
        self.disk: set[str] = set()
        self.offered = 0
        self.ends: dict[int, list[End]] = {}

    def take(self, event: Event) -> None:
        """The journal has the next state, then its effect may begin."""
        self.state = advance(self.state, event)
        named = [wanted(self.state), self.state.good, self.state.previous]
        assert {each.folder for each in named if each is not None} <= self.disk

    def effect(self, is_done: bool) -> None:
        """The effect of the phase reaches the disk, or is cut before that."""
        if self.state.phase is Phase.DOWNLOADING and is_done and self.state.deployment is not None:
            self.disk.add(self.state.deployment.version.folder)
        if self.state.phase is Phase.IDLE and is_done:
            self.disk &= kept(self.state)

    def passed(self) -> Event:
        """What happens when the effect works."""
        if self.state.phase is Phase.VALIDATING:
            number = self.state.order.action_id if self.state.order else 0
            return Checked(deployment(1 + number % 3, has_condition=number % 2 == 0, newness=max(1, number)))
        return Passed(self.state.phase)

    def deliver(self) -> None:
        """The server hears how the order ended."""
        if self.state.end is not None and not self.state.end.is_delivered:
            self.ends.setdefault(self.state.end.order.action_id, []).append(self.state.end)
            self.take(Delivered(self.state.end.order))


STEPS = st.lists(
    st.tuples(
        st.sampled_from(["order", "same", "pass", "pass", "pass", "fail", "kill", "cancel", "withdraw", "deliver"]),
        st.booleans(),
        st.sampled_from(sorted(NUMBERS)),
    ),
    max_size=60,
)


@examples(400)
@given(STEPS)
def test_the_journal_always_names_versions_that_are_on_disk(steps: list[tuple[str, bool, str]]) -> None:
    robot = Robot()
    for what, is_done, code in steps:
        if what == "order":
            robot.offered += robot.state.order is None
            robot.take(Ordered(order(robot.offered)))
        elif what == "same":
            robot.take(Ordered(order(max(1, robot.offered))))
        elif what == "pass":
            robot.effect(is_done=True)
            robot.take(robot.passed())
        elif what == "fail":
            robot.effect(is_done)
            robot.take(Failed(robot.state.phase, code, "it failed"))
        elif what == "kill":
            robot.effect(is_done)
            robot.take(Restarted())
        elif what == "cancel":
            robot.take(Cancelled(robot.offered))
        elif what == "withdraw":
            robot.take(Withdrawn())
        else:
            robot.deliver()

    for ends in robot.ends.values():
        assert all(end == ends[0] for end in ends), "an order ends once, or the same again"


@given(STEPS)
def test_every_order_comes_to_an_end(steps: list[tuple[str, bool, str]]) -> None:
    """Whatever has happened: where everything works from now on, a few steps lead to the end."""
    robot = Robot()
    robot.take(Ordered(order(1)))
    for what, is_done, code in steps:
        if what == "kill":
            robot.take(Restarted())
        elif what == "fail":
            robot.effect(is_done)
            robot.take(Failed(robot.state.phase, code, "it failed"))
        elif what == "pass":
            robot.effect(is_done=True)
            robot.take(robot.passed())
    for _ in range(len(Phase)):
        robot.effect(is_done=True)
        robot.take(robot.passed())

    assert robot.state.phase is Phase.IDLE
    assert robot.state.end is not None
    assert (robot.state.end.finished == "success") == (robot.state.good is not None)


@pytest.mark.parametrize(
    ("launch", "expected"),
    [
        (SCRIPTED, [Phase.PRE_LAUNCH, Phase.LAUNCHING, Phase.POST_LAUNCH, Phase.WATCHING]),
        (replace(SCRIPTED, after=None), [Phase.PRE_LAUNCH, Phase.LAUNCHING, Phase.WATCHING]),
        (replace(SCRIPTED, before=None), [Phase.LAUNCHING, Phase.POST_LAUNCH, Phase.WATCHING]),
        (BARE, [Phase.LAUNCHING, Phase.WATCHING]),
    ],
)
def test_phases_of_scripts_that_there_are_not_are_passed_over(launch: Launch, expected: list[Phase]) -> None:
    asked = replace(deployment(2), version=version(2, launch))
    state = state_in(Phase.DOWNLOADING, deployment=asked)
    found: list[Phase] = []
    while (state := advance(state, Passed(state.phase))).phase is not Phase.IDLE:
        found.append(state.phase)

    assert found == expected


@pytest.mark.parametrize("phase", BEFORE_SWITCH)
def test_before_the_switch_an_order_is_given_up(phase: Phase) -> None:
    after = advance(state_in(phase), Cancelled(2))

    assert (after.phase, after.good) == (Phase.IDLE, version(1))
    assert after.end is not None
    assert after.end.execution == "canceled"


@pytest.mark.parametrize("phase", [*TRIED, Phase.RETURNING])
def test_after_the_switch_an_order_goes_on(phase: Phase) -> None:
    assert advance(state_in(phase), Cancelled(2)) == state_in(phase)
    assert advance(state_in(phase), Withdrawn()) == state_in(phase)


@pytest.mark.parametrize("phase", TRIED)
def test_a_version_that_fails_makes_room_for_the_good_one(phase: Phase) -> None:
    going = advance(state_in(phase), Failed(phase, "RobotDeploymentAborted", "it was unhealthy"))
    assert (going.phase, wanted(going)) == (Phase.RETURNING, version(1))

    after = advance(going, Passed(Phase.RETURNING))
    assert after.good == version(1)
    assert after.end is not None
    assert after.end.code == NUMBERS["RobotDeploymentAborted"]
    assert "went back to version 1" in after.end.details[1]


def test_a_healthy_version_is_the_good_one_and_the_last_one_stays() -> None:
    after = advance(state_in(Phase.WATCHING), Passed(Phase.WATCHING))

    assert (after.good, after.previous) == (version(2), version(1))
    assert kept(after) == {version(1).folder, version(2).folder}


def test_the_same_version_again_leaves_the_one_before() -> None:
    again = state_in(Phase.WATCHING, deployment=deployment(1), previous=version(3))

    assert advance(again, Passed(Phase.WATCHING)).previous == version(3)


def test_a_version_that_restarts_the_robot_again_and_again_is_given_up() -> None:
    state = state_in(Phase.WATCHING)
    for _ in range(MAX_RESTARTS):
        state = advance(state, Restarted())
        assert state.phase is Phase.WATCHING

    assert advance(state, Restarted()).phase is Phase.RETURNING


def test_an_order_that_comes_again_after_its_end_gets_the_same_answer() -> None:
    ended = advance(state_in(Phase.WATCHING), Passed(Phase.WATCHING))
    delivered = advance(ended, Delivered(order(2)))
    assert delivered.end is not None
    assert delivered.end.is_delivered

    assert advance(delivered, Ordered(order(2))) == ended


def test_no_other_order_begins_before_the_end_of_the_last_is_known() -> None:
    ended = advance(state_in(Phase.WATCHING), Passed(Phase.WATCHING))

    assert advance(ended, Ordered(order(3))) == ended
    assert advance(advance(ended, Delivered(order(2))), Ordered(order(3))).phase is Phase.VALIDATING


def test_another_order_replaces_one_that_was_not_switched_to() -> None:
    assert advance(state_in(Phase.DOWNLOADING), Ordered(order(3))).order == order(3)
    assert advance(state_in(Phase.WATCHING), Ordered(order(3))).order == order(2)


def test_an_order_that_never_came_is_canceled_at_once() -> None:
    after = advance(State(good=version(1)), Cancelled(7))

    assert after.end == End(Order(7, ""), "canceled", "success")


@pytest.mark.parametrize("number", [2, 3])
def test_a_deployment_that_is_not_newer_than_the_last_one_is_refused(number: int) -> None:
    state = state_in(Phase.VALIDATING, good=version(1), number=3)

    after = advance(state, Checked(deployment(number)))

    assert (after.phase, after.number) == (Phase.IDLE, 3)
    assert after.end is not None
    assert (after.end.finished, after.end.code) == ("failure", NUMBERS["RobotDeploymentAborted"])
    assert f"job-{number} has number {number}, and the robot has carried out number 3" in after.end.details[1]


def test_the_deployment_that_runs_succeeds_again_without_a_restart() -> None:
    state = state_in(Phase.VALIDATING, good=version(3), number=3)

    after = advance(state, Checked(deployment(3)))

    assert after.end == End(order(2), "closed", "success", None, ("Finished",))
    assert (after.phase, after.good) == (Phase.IDLE, version(3))


def test_an_order_that_was_cancelled_may_come_again() -> None:
    cancelled = advance(state_in(Phase.DOWNLOADING), Cancelled(2))
    assert cancelled.number == 0
    assert cancelled.end is not None

    again = advance(advance(cancelled, Delivered(order(2))), Ordered(order(3)))

    assert advance(again, Checked(deployment(2))).phase is Phase.DOWNLOADING


@pytest.mark.parametrize("phase", [Phase.PRE_LAUNCH, Phase.RETURNING, Phase.WATCHING])
def test_the_end_of_a_deployment_is_remembered_whatever_it_was(phase: Phase) -> None:
    ended = advance(state_in(phase), Failed(phase, "RobotDeploymentAborted", "it failed"))
    if ended.phase is Phase.RETURNING:
        ended = advance(ended, Passed(Phase.RETURNING))

    assert ended.number == 2


def test_floors_and_the_clock_never_go_back() -> None:
    state = advance(State(), Trusted({"root": 3, "timestamp": 8}, 1000.0))
    state = advance(state, Trusted({"timestamp": 7, "snapshot": 2}, 900.0))

    assert state.floors == {"root": 3, "timestamp": 8, "snapshot": 2}
    assert state.newest_s == 1000.0


def test_an_event_of_a_phase_that_is_over_changes_nothing() -> None:
    state = state_in(Phase.WATCHING)

    assert advance(state, Passed(Phase.DOWNLOADING)) == state
    assert advance(state, Failed(Phase.PRE_LAUNCH, "PreLaunchFileFailure", "late")) == state
    assert advance(state, Checked(deployment(3))) == state


def test_a_version_that_keeps_ending_before_it_was_steady_is_taken_back_and_its_order_fails() -> None:
    good = advance(state_in(Phase.WATCHING), Passed(Phase.WATCHING))
    assert (good.good, good.end and good.end.finished) == (version(2), "success")
    once = advance(good, Ended("exit code 1"))
    assert once.good == version(2)
    assert {version(1).folder, version(2).folder} <= kept(once)

    back = once
    for _ in range(MAX_ENDS - 1):
        back = advance(back, Ended("exit code 1"))
    assert (back.good, back.probation, wanted(back)) == (version(1), None, version(1))
    assert back.end is not None
    assert (back.end.order, back.end.finished, back.end.is_delivered) == (order(2), "failure", False)
    assert back.end.code == NUMBERS["RobotDeploymentAborted"]
    assert "keeps restarting, 3 times" in back.end.details[1]
    assert back.end.details[1].endswith("the last time exit code 1; the robot went back to version 1")
    assert advance(back, Ended("exit code 1")) == back, "the version before is started again for ever"
    # The server may have closed the order by then, and refuse this end: the attributes say it.
    assert back.trouble == "version 2 kept restarting, so the robot went back to version 1: exit code 1"
    again = replace(back, phase=Phase.WATCHING, order=order(3), deployment=deployment(3))
    assert advance(again, Passed(Phase.WATCHING)).trouble == ""

    steady = advance(once, Steady())
    assert steady.probation is None
    assert advance(advance(advance(steady, Ended("x")), Ended("x")), Ended("x")) == steady


def test_ends_of_the_version_before_do_not_count_while_a_new_one_is_tried() -> None:
    good = advance(state_in(Phase.WATCHING), Passed(Phase.WATCHING))
    for phase in (*TRIED, Phase.RETURNING):
        tried = replace(good, phase=phase, order=order(3), deployment=deployment(3))
        assert advance(tried, Ended("x")) == tried
