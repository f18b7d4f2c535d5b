import threading

import pytest
from helpers.robot_orders import TOKEN, robot_order, table_of_robots
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from prefect_robomaker.schemas.wire.errors import ResourceNotFoundException, StateConflictError
from prefect_robomaker.tasks.fleet.ddi.open_orders import OpenOrders
from prefect_robomaker.tasks.fleet.ddi.robot_tokens import hash_token

ROBOTS = ("robot1", "robot2")
IDS = st.integers(1, 6)
ROBOT = st.sampled_from(ROBOTS)


def test_a_robot_is_let_in_by_its_own_token_only() -> None:
    orders = table_of_robots("robot1")
    orders.enrol("robot2", hash_token("another"))

    assert orders.check_token("robot1", TOKEN.encode()) == orders.state("robot1")
    for robot, token in [
        ("robot2", TOKEN),
        ("robot3", TOKEN),
        ("robot1", TOKEN[:-1]),
        ("robot1", TOKEN.upper()),
        ("robot1", ""),
    ]:
        assert orders.check_token(robot, token.encode()) is None
    assert orders.check_token("robot1", None) is None


def test_no_token_lets_in_even_where_its_hash_is_known() -> None:
    orders = table_of_robots()
    orders.enrol("robot1", hash_token(""))

    assert orders.check_token("robot1", None) is None
    assert orders.check_token("robot1", b"") is None


def test_a_new_token_takes_the_place_of_the_old_one_and_the_order_stays() -> None:
    orders = table_of_robots()
    orders.offer(robot_order())

    orders.enrol("robot1", hash_token("new"))

    assert orders.check_token("robot1", TOKEN.encode()) is None
    assert orders.check_token("robot1", b"new") is not None
    assert orders.state("robot1").order == robot_order()


def test_an_expelled_robot_is_not_let_in() -> None:
    orders = table_of_robots()

    orders.expel("robot1")

    assert orders.check_token("robot1", TOKEN.encode()) is None
    with pytest.raises(ResourceNotFoundException, match="robot1"):
        orders.offer(robot_order())


def test_an_order_is_not_exchanged_under_a_robot() -> None:
    orders = table_of_robots()
    orders.offer(robot_order(action_id=8))
    orders.cancel("robot1", 8)

    with pytest.raises(StateConflictError, match="robot1 has order 8 open: close it before order 9, or cancel it"):
        orders.offer(robot_order(action_id=9))

    orders.close("robot1", 8)
    orders.offer(robot_order(action_id=9))
    assert not orders.state("robot1").is_cancelling


def test_an_order_that_ended_is_not_offered_again() -> None:
    orders = table_of_robots()
    orders.offer(robot_order(action_id=8))
    orders.close("robot1", 8)

    with pytest.raises(StateConflictError, match="order 8 needs a larger action id"):
        orders.offer(robot_order(action_id=8))


def test_feedback_counts_by_order() -> None:
    orders = table_of_robots()
    orders.offer(robot_order(action_id=1))

    assert [orders.count_feedback("robot1", 1) for _ in range(3)] == [1, 2, 3]
    assert orders.count_feedback("robot1", 2) == orders.count_feedback("robot9", 1) == 0
    orders.close("robot1", 1)
    orders.offer(robot_order(action_id=2))
    assert orders.count_feedback("robot1", 2) == 1


def test_an_expected_robot_stays_so_until_told() -> None:
    orders = table_of_robots()

    orders.expect(["robot1", "robot9"])
    assert orders.state("robot1").is_expected
    orders.expect(["robot1"], is_expected=False)
    assert not orders.state("robot1").is_expected


def test_of_many_threads_one_closes_an_order() -> None:
    orders = table_of_robots()
    orders.offer(robot_order())
    closed = []
    threads = [threading.Thread(target=lambda: closed.append(orders.close("robot1", 8))) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert closed.count(True) == 1


class Table(RuleBasedStateMachine):
    """The table against a plain list of what happened: one order at a time, ids that only grow."""

    def __init__(self) -> None:
        super().__init__()
        self.orders: OpenOrders = table_of_robots(*ROBOTS)
        self.open: dict[str, int] = {}
        self.cancelling: set[str] = set()
        self.newest: dict[str, int] = dict.fromkeys(ROBOTS, 0)

    @rule(robot=ROBOT, number=IDS)
    def offer(self, robot: str, number: int) -> None:
        allowed = number == self.open.get(robot) or (robot not in self.open and number > self.newest[robot])
        try:
            self.orders.offer(robot_order(robot=robot, action_id=number))
            assert allowed
        except StateConflictError:
            assert not allowed
            return
        if robot not in self.open:
            self.open[robot] = self.newest[robot] = number

    @rule(robot=ROBOT, number=IDS)
    def cancel(self, robot: str, number: int) -> None:
        assert self.orders.cancel(robot, number) == (self.open.get(robot) == number)
        if self.open.get(robot) == number:
            self.cancelling.add(robot)

    @rule(robot=ROBOT, number=IDS)
    def close(self, robot: str, number: int) -> None:
        assert self.orders.close(robot, number) == (self.open.get(robot) == number)
        if self.open.get(robot) == number:
            del self.open[robot]
            self.cancelling.discard(robot)

    @invariant()
    def the_table_says_the_same(self) -> None:
        assert {robot: order.action_id for robot, order in self.orders.open().items()} == self.open
        assert {robot for robot in ROBOTS if self.orders.state(robot).is_cancelling} == self.cancelling


Table.TestCase.settings = settings(max_examples=50, stateful_step_count=30)
TestTable = Table.TestCase
