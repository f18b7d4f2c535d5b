"""The table of open orders follows the rollouts, and never exchanges an order under a robot."""

import json

from helpers.kept_orders import ARTIFACT, LAUNCH, Table, open_rollout, order
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from prefect_robomaker.tasks.fleet.ddi.open_orders import order_document
from prefect_robomaker.tasks.fleet.ddi.received_reports import Execution, Feedback, Finished
from prefect_robomaker.tasks.fleet.order_keeping import SaidBefore


def test_orders_are_opened_given_up_and_closed_as_the_rollout_says() -> None:
    table = Table("r1", "r2", "r3")

    table.sync(open_rollout(r1=order(1), r2=order(2, "fetched"), r3={}))
    assert table.shown() == {"r1": ("deploy", 1), "r2": ("deploy", 2)}
    opened = table.orders.open()["r1"]
    assert (opened.sha256, opened.version, opened.launch) == (ARTIFACT.sha256, "3", LAUNCH)
    assert table.orders.state("r3").is_expected, "its turn comes soon"

    table.sync(open_rollout(r1=order(1, "canceling"), r2=order(2, "fetched"), r3=order(3)))
    assert table.shown() == {"r1": ("cancel", 1), "r2": ("deploy", 2), "r3": ("deploy", 3)}
    assert not table.orders.state("r3").is_expected

    table.sync(open_rollout(r1=order(1, "refused"), r2=order(2, "fetched"), r3=order(3)))
    assert table.shown()["r1"] == ("deploy", 1)

    answered = open_rollout(r1=order(1, "closed"), r2=order(2, "closed"), r3=order(3, "closed"))
    table.sync(answered)
    assert len(table.shown()) == 3, "a rollout that takes them over may not have been read"
    table.sync(answered)
    assert table.shown() == {}


def test_an_order_that_is_held_back_is_hidden_and_comes_again() -> None:
    table = Table("r1", "r2", "r3")
    robots = {"r1": order(3), "r2": order(4, "fetched"), "r3": {}}
    table.sync(open_rollout(**robots))

    table.sync(open_rollout(held=True, **robots))
    assert table.shown() == {"r2": ("deploy", 4)}, "not as one to be given up"
    assert not table.orders.state("r3").is_expected
    table.sync(open_rollout(held=True, **robots))
    table.sync(open_rollout(**robots))
    assert table.shown() == {"r1": ("deploy", 3), "r2": ("deploy", 4)}


def test_an_order_that_the_robot_has_just_read_is_not_hidden() -> None:
    table = Table("r1")
    table.sync(open_rollout(r1=order(3)))
    table.orders.mark_fetched("r1", 3)

    table.sync(open_rollout(held=True, r1=order(3)))

    assert table.shown() == {"r1": ("deploy", 3)}


def test_robots_behind_an_approval_do_not_poll_often() -> None:
    table = Table("r1", "r2")
    planned = {"canaries": ("arn:r1",), "requires_approval": True}

    table.sync(open_rollout(planned=planned, r1={}, r2={}))

    assert [table.orders.state(robot).is_expected for robot in ("r1", "r2")] == [True, False]


def test_an_order_for_an_agent_names_its_document_and_the_tags_of_the_robot() -> None:
    table, rollout = Table("r1", "r2"), open_rollout(r1=order(1), r2=order(2))
    target = "applications/courier/deployments/deployment-1.json"
    rollout.artifacts["arn:r1"] = ARTIFACT.model_copy(update={"target": target})

    table.sync(rollout)

    ((mine,), (others,)) = (
        json.loads(order_document("http://door", table.orders.open()[robot]))["deployment"]["chunks"]
        for robot in ("r1", "r2")
    )
    assert mine["metadata"][1:] == [
        {"key": "robomaker.target", "value": target},
        {"key": "robomaker.tags", "value": '{"board": "r1"}'},
    ]
    assert [each["key"] for each in others["metadata"]] == ["robomaker.launch"]


def test_what_the_robot_closed_does_not_come_back_while_the_catalog_is_behind() -> None:
    table = Table("r1")
    behind = open_rollout(r1=order(1, "fetched"))
    table.sync(behind)

    table.orders.close("r1", 1, Feedback(1, Execution.CLOSED, Finished.SUCCESS))
    table.sync(behind)

    assert table.shown() == {}


def test_an_order_of_an_earlier_rollout_is_given_up_first() -> None:
    table = Table("r1")  # of a server that has just started
    both = [open_rollout("old", "Canceled", r1=order(1, "closed")), open_rollout("new", r1={"earlier_action_id": 1})]
    table.sync(*both)
    assert table.shown() == {"r1": ("cancel", 1)}
    assert table.keeper.job(("r1", 1)) == "new", "which waits for the answer"

    table.orders.close("r1", 1)
    table.sync(open_rollout("new", r1=order(2)))
    assert table.shown() == {"r1": ("deploy", 2)}


def test_a_robot_with_an_order_that_no_rollout_has_any_more_is_asked_to_give_it_up() -> None:
    table = Table("r1")
    table.sync(open_rollout(r1=order(1)))

    table.sync()

    assert table.shown() == {"r1": ("cancel", 1)}
    assert table.keeper.job(("r1", 1)) == "job"


def test_a_server_that_starts_knows_from_the_rollout_what_was_said() -> None:
    table = Table("r1", "r2", "r3")
    table.sync(
        open_rollout(
            r1=order(1, "fetched"),
            r2=order(2, "fetched", step="DownloadingExtracting"),
            r3=order(3, "fetched", step="ExecutingPostLaunch"),
        )
    )
    said = [table.keeper.said((f"r{number}", number)) for number in (1, 2, 3)]
    assert said == [SaidBefore(), SaidBefore(True), SaidBefore(True, True)]


def test_only_robots_whose_turn_comes_soon_poll_often() -> None:
    table = Table("r1", "r2", "r3", "r4")
    waiting = open_rollout(r1={"outcome": "failed"}, r2={}, r3={}, r4={})

    table.sync(waiting)
    expected = [robot for robot in ("r1", "r2", "r3", "r4") if table.orders.state(robot).is_expected]
    assert expected == ["r2", "r3"], "half of four robots at a time"
    assert table.orders.active == 2

    table.sync(open_rollout(status="Canceled", r2={}, r3={}))
    assert table.orders.active == 0


class Robots(RuleBasedStateMachine):
    """A robot, and a rollout that goes on in any way, also behind the table's back."""

    def __init__(self) -> None:
        super().__init__()
        self.table = Table("r1")
        self.number = 0
        self.state: dict[str, object] = {}
        self.seen: int | None = None

    @rule()
    def is_offered(self) -> None:
        if self.state.get("order") in (None, "closed"):
            self.number += 1
            self.state = order(self.number)

    @rule(to=st.sampled_from(["fetched", "canceling", "refused", "closed"]))
    def goes_on(self, to: str) -> None:
        if self.state:
            self.state = order(self.number, to)

    @rule()
    def is_replaced(self) -> None:
        if self.state.get("order") not in (None, "closed"):
            self.state = {"earlier_action_id": self.number}

    @rule(answers=st.booleans())
    def is_synced(self, answers: bool) -> None:
        self.table.sync(open_rollout(r1=self.state))
        shown = self.table.orders.open().get("r1")
        if shown is not None and answers:
            self.table.orders.close("r1", shown.action_id)

    @invariant()
    def an_order_is_replaced_only_after_it_was_closed_and_by_a_newer_one(self) -> None:
        opened = self.table.orders.open().get("r1")
        if opened is not None:
            assert self.seen is None or opened.action_id >= self.seen
            self.seen = opened.action_id


TestRobots = Robots.TestCase
