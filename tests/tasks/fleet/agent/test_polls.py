"""Polls in the course of time: silence while the server is away, and what is said when it is back."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import pytest

from prefect_robomaker.tasks.fleet.agent.deployment import Order
from prefect_robomaker.tasks.fleet.agent.errors import TryLater
from prefect_robomaker.tasks.fleet.agent.polls import Polls
from prefect_robomaker.tasks.fleet.agent.server import Poll
from prefect_robomaker.tasks.fleet.agent.state_machine import (
    Cancelled,
    Delivered,
    End,
    Ordered,
    Phase,
    State,
    Withdrawn,
)

ORDER = Order(7, "applications/courier/deployments/7.json")


@dataclass
class Server:
    """A server that is away, or says what it is told to."""

    is_away: bool = False
    answer: Poll = field(default_factory=lambda: Poll(30.0))
    calls: list[str] = field(default_factory=list)
    takes_ends: bool = True
    takes_attributes: bool = True
    is_away_for_attributes: bool = False

    def _heard(self, call: str) -> None:
        if self.is_away:
            raise TryLater("connection refused")
        self.calls.append(call)

    def poll(self) -> Poll:
        self._heard("poll")
        return self.answer

    def order(self, action_id: int) -> Order | None:
        self._heard(f"order {action_id}")
        return ORDER if action_id == ORDER.action_id else None

    def tell_end(self, end: End) -> bool:
        self._heard(f"end {end.order.action_id} {end.finished}")
        return self.takes_ends

    def tell_step(self, action_id: int, step: str, percent: int | None) -> None:
        self._heard(f"step {step} {percent}")

    def refuse_cancellation(self, action_id: int) -> None:
        self._heard(f"refuse {action_id}")

    def tell_attributes(self, attributes: Mapping[str, str]) -> bool:
        self._heard(f"attributes {dict(attributes)}")
        if self.is_away_for_attributes:
            raise TryLater("connection reset")
        return self.takes_attributes


@dataclass
class Agent:
    """Polls, with a clock that only the test moves."""

    now_s: float = 0.0
    log: list[str] = field(default_factory=list)
    chance: float = 0.999

    def __post_init__(self) -> None:
        self.server = Server()
        self.attributes: dict[str, str] = {}
        self.polls = Polls(
            self.server,
            lambda: self.now_s,
            lambda: self.chance,
            300.0,
            lambda _state: dict(self.attributes),
            self.log.append,
        )

    def poll(self, state: State | None = None, percent: int | None = None) -> list[object]:
        """Polls when it is due."""
        self.now_s = max(self.now_s, self.polls.due_s)
        return list(self.polls.poll(state or State(), percent))


def test_a_server_that_is_away_for_weeks_is_two_lines_and_few_polls() -> None:
    agent = Agent()
    agent.server.is_away = True
    polls = 0
    while agent.now_s < 14 * 86400:
        agent.poll()
        polls += 1
    assert polls < 14 * 86400 / 290
    assert len(agent.log) == 1

    agent.server.is_away = False
    agent.poll()
    agent.poll()
    assert agent.log == ["the server is away: connection refused", "the server is back"]


def test_pauses_grow_and_differ_between_robots() -> None:
    early, late = Agent(chance=0.0), Agent()
    for agent in (early, late):
        agent.server.is_away = True
        pauses = []
        for _ in range(12):
            agent.poll()
            pauses.append(round(agent.polls.due_s - agent.now_s, 3))
        assert pauses == sorted(pauses)
        assert 100 < pauses[-1] <= 300
    assert early.polls.due_s < late.polls.due_s


def test_the_server_says_when_to_poll_again() -> None:
    agent = Agent()
    agent.server.answer = Poll(17.0)
    agent.poll()

    assert agent.polls.due_s == agent.now_s + 17.0


def test_an_order_is_read_once_and_its_steps_are_told_once() -> None:
    agent = Agent()
    agent.server.answer = Poll(1.0, order=7)
    assert agent.poll() == [Ordered(ORDER)]

    state = State(Phase.DOWNLOADING, ORDER)
    for percent in (3, 3, 4):
        assert agent.poll(state, percent) == []
    told = [call for call in agent.server.calls if call.startswith("step")]
    assert told == ["step DownloadingExtracting 3", "step DownloadingExtracting 4"]


def test_an_order_is_withdrawn_when_it_is_missed_three_times() -> None:
    agent = Agent()
    state = State(Phase.DOWNLOADING, ORDER)

    assert [agent.poll(state) for _ in range(3)] == [[], [], [Withdrawn()]]


def test_a_cancellation_is_refused_once_the_new_version_is_tried() -> None:
    agent = Agent()
    agent.server.answer = Poll(1.0, cancel=7)
    assert agent.poll(State(Phase.DOWNLOADING, ORDER)) == [Cancelled(7)]
    assert agent.poll(State(Phase.WATCHING, ORDER)) == []

    assert "refuse 7" in agent.server.calls


def test_attributes_are_told_again_when_they_are_others() -> None:
    """The server asks once; what runs changes, and trouble comes, after a deployment has succeeded."""
    agent = Agent()
    agent.attributes = {"version": "2", "trouble": ""}
    agent.poll()
    agent.poll()
    assert agent.server.calls == ["poll", f"attributes {agent.attributes}", "poll"]
    agent.attributes = {"version": "1", "trouble": "version 2 kept restarting"}
    agent.server.is_away = True
    agent.poll()
    agent.server.is_away = False
    agent.poll()
    agent.poll()
    assert agent.server.calls[3:] == ["poll", f"attributes {agent.attributes}", "poll"]


def test_attributes_that_the_server_refuses_are_told_again() -> None:
    agent = Agent()
    agent.attributes = {"trouble": "version 2 kept restarting"}
    agent.server.takes_attributes = False
    agent.poll()
    agent.server.takes_attributes = True
    agent.poll()
    agent.poll()

    assert agent.server.calls == ["poll", told := f"attributes {agent.attributes}", "poll", told, "poll"]


@pytest.mark.parametrize(
    ("answer", "events"), [(Poll(1.0, order=7), [Ordered(ORDER)]), (Poll(1.0, cancel=7), [Cancelled(7)])]
)
def test_an_order_stays_when_the_server_goes_away_before_the_attributes(answer: Poll, events: list[object]) -> None:
    agent = Agent()
    agent.attributes = {"version": "2"}
    agent.server.answer, agent.server.is_away_for_attributes = answer, True
    assert agent.poll(State(Phase.DOWNLOADING, ORDER) if answer.cancel else None) == events

    agent.server.is_away_for_attributes = False
    agent.server.answer = Poll(1.0)
    agent.poll()
    assert agent.server.calls[-1] == f"attributes {agent.attributes}"


def test_an_end_is_told_until_it_is_taken_and_never_without_a_step() -> None:
    agent = Agent()
    agent.server.takes_ends = False
    end = End(ORDER, "closed", "success")
    assert agent.polls.deliver(end) == []
    agent.server.takes_ends = True
    assert agent.polls.deliver(end) == [], "not at once"
    agent.now_s += 2
    assert agent.polls.deliver(end) == [Delivered(ORDER)]

    assert agent.server.calls[:2] == ["step ExecutingPostLaunch None", "end 7 success"]
