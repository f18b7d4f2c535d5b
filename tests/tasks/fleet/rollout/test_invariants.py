"""Whatever happens in a rollout, in whichever sequence: what has to stay true."""

from itertools import pairwise
from typing import Any

from helpers.examples import examples
from helpers.rollout_ledger import advance, cancellations, plan_of
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.fleet.rollouts.rollout import (
    Approved,
    Canceled,
    CancelRefused,
    Failed,
    Fetched,
    Offered,
    Outage,
    Paused,
    Progressed,
    Resumed,
    RobotGone,
    Rollout,
    RolloutEvent,
    Stopped,
    Succeeded,
)
from prefect_robomaker.schemas.fleet.rollouts.rollout_plan import RolloutPlan
from prefect_robomaker.tasks.fleet.rollout.ledger import Ledger, begin


def made(kind: Any, **members: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Events of a kind; `builds` would give members under their stored names besides."""
    return st.fixed_dictionaries(members).map(lambda drawn: kind(**drawn))


NAMES = [f"r{number}" for number in range(6)]
ROBOTS = st.sampled_from([*NAMES, "of another fleet"])
NUMBERS = st.integers(1, 12)  # few, so that reports often mean orders that exist

PLANS = st.builds(
    plan_of,
    st.integers(1, 6).map(lambda count: NAMES[:count]),
    unfit=st.sets(st.sampled_from(NAMES[:3]), max_size=1),
    concurrent_percentage=st.integers(1, 100),
    threshold_percentage=st.integers(1, 100),
    robot_timeout_s=st.just(50),
    job_timeout_s=st.just(400),
    canaries=st.sampled_from([(), ("r0",)]),
    requires_approval=st.booleans(),
    windows=st.sampled_from([(), ({"startTime": "00:15", "durationInSeconds": 150},)]),  # it closes at 1050 s
)
REPORTS = st.one_of(
    *(made(kind, robot=ROBOTS, action_id=NUMBERS) for kind in (Offered, Offered, Fetched, Succeeded, Canceled)),
    made(CancelRefused, robot=ROBOTS, action_id=NUMBERS),
    made(Failed, robot=ROBOTS, action_id=NUMBERS, code=st.just("EtagMismatch")),
    made(
        Progressed,
        robot=ROBOTS,
        action_id=NUMBERS,
        step=st.sampled_from([None, "DownloadingExtracting", "Launching"]),
        percent_done=st.none() | st.floats(0, 100),
    ),
)
PEOPLE = st.one_of(
    made(RobotGone, robot=ROBOTS, how=st.sampled_from(["left", "deleted"])),
    made(Stopped, why=st.sampled_from(["canceled", "rejected", "fleet_deleted", "application_deleted", "superseded"])),
    st.just(Paused()),
    st.just(Resumed()),
    st.just(Approved()),
    made(Outage, since_s=st.integers(900, 1400)),
)
EVENTS: st.SearchStrategy[RolloutEvent | None] = st.one_of(REPORTS, REPORTS, REPORTS, st.none(), st.none(), PEOPLE)
"""None: the caller offers what is due."""

History = list[tuple[RolloutEvent | None, int]]
HISTORIES = st.lists(st.tuples(EVENTS, st.sampled_from([0, 0, 1, 7, 49, 50, -5])), max_size=30)


def happen(ledger: Ledger, event: RolloutEvent | None, now_s: float, number: int) -> None:
    """One event; for None, offers with numbers that were not used before."""
    if event is not None:
        ledger.apply(event, now_s)
        return
    ledger.pass_time(now_s)
    for place, robot in enumerate(ledger.offers()):
        ledger.apply(Offered(robot=robot, action_id=number * 6 + place + 1), now_s)


def check(ledger: Ledger) -> None:
    rollout, plan = ledger.rollout(), ledger.rollout().plan
    states = rollout.robots.values()
    assert sum(state.is_open for state in states) == ledger.open_orders <= plan.concurrency
    assert len(ledger.offers()) <= plan.concurrency - ledger.open_orders
    assert not (rollout.held and ledger.offers())
    assert rollout.held or not rollout.paused
    for state in states:
        assert (state.failure_code is not None) == (state.outcome == "failed")
        assert (state.finished_s is not None) == (state.outcome is not None)
        is_held_back = rollout.held and state.order == "offered"
        assert (state.deadline_s is not None) == (state.is_open and not is_held_back)
        assert (state.left_s is not None) == is_held_back
        assert state.deadline_s is None or state.deadline_s > rollout.now_s
        assert not (state.returned and state.is_open)
        assert (state.action_id is None) == (state.order == "none")
    assert (rollout.ended_s is None) == (rollout.status == "InProgress")
    assert (rollout.failure_code is not None) == (rollout.status == "Failed")
    if rollout.status == "Succeeded":
        assert all(state.has_ended for state in states)
    for robot, number in cancellations(ledger.rollout()).items():
        assert number in (ledger.robot(robot).action_id, ledger.robot(robot).earlier_action_id)


@examples(60)
@given(PLANS, HISTORIES)
def test_invariants_hold_whatever_happens(plan: RolloutPlan, history: History) -> None:
    ledger, now_s = Ledger(begin(plan, 1000)), 1000.0
    ends = [ledger.status]
    for number, (event, wait_s) in enumerate(history):
        now_s += wait_s
        happen(ledger, event, now_s, number)
        check(ledger)
        ends.append(ledger.status)
    assert all(after == before for before, after in pairwise(ends) if before != "InProgress")


@examples(40)
@given(PLANS, HISTORIES)
def test_a_repeated_event_changes_nothing(plan: RolloutPlan, history: History) -> None:
    ledger, now_s = Ledger(begin(plan, 1000)), 1000.0
    for number, (event, wait_s) in enumerate(history):
        now_s += wait_s
        happen(ledger, event, now_s, number)
        before = ledger.rollout()
        if event is not None:
            ledger.apply(event, now_s)
        assert ledger.rollout() == before


@examples(30)
@given(PLANS, HISTORIES)
def test_a_rollout_that_is_stored_after_each_event_is_the_same(plan: RolloutPlan, history: History) -> None:
    ledger, now_s = Ledger(begin(plan, 1000)), 1000.0
    stored = ledger.rollout()
    for number, (event, wait_s) in enumerate(history):
        now_s += wait_s
        happen(ledger, event, now_s, number)
        stored = advance(stored, event, now_s)
        if event is None:
            for place, robot in enumerate(Ledger(advance(stored, None, now_s)).offers()):
                stored = advance(stored, Offered(robot=robot, action_id=number * 6 + place + 1), now_s)
        stored = Rollout.of_json(stored.to_json())
        again = Ledger(stored)
        again.pass_time(now_s)
        assert (again.offers(), again.wake_s()) == (ledger.offers(), ledger.wake_s())
        assert stored == ledger.rollout()


@examples(30)
@given(PLANS, HISTORIES)
def test_asking_each_second_or_only_at_events_is_the_same(plan: RolloutPlan, history: History) -> None:
    rarely, often, now_s = Ledger(begin(plan, 1000)), Ledger(begin(plan, 1000)), 1000
    for number, (event, wait_s) in enumerate(history):
        if not isinstance(event, Outage):  # the seconds of an outage are not lived through
            for second in range(now_s, now_s + wait_s):
                often.pass_time(second)
        now_s += wait_s
        happen(rarely, event, now_s, number)
        happen(often, event, now_s, number)
        assert often.rollout() == rarely.rollout()


@examples(30)
@given(PLANS, HISTORIES)
def test_each_rollout_ends(plan: RolloutPlan, history: History) -> None:
    ledger, now_s = Ledger(begin(plan, 1000)), 1000.0
    for number, (event, wait_s) in enumerate(history):
        now_s += wait_s
        happen(ledger, event, now_s, number)
    ledger.apply(Resumed(), now_s)

    for number in range(len(history), len(history) + 50):
        if ledger.status != "InProgress" and not ledger.open_orders:
            break
        happen(ledger, None, ledger.wake_s() or now_s, number)  # no robot says anything any more

    assert ledger.status != "InProgress"
    assert ledger.open_orders == 0
    assert ledger.wake_s() is None
