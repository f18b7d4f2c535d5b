"""The agent's loop: each state is in the journal before anything is done about it, and all at once is one write."""

from dataclasses import dataclass, field
from typing import Any

from prefect_robomaker.tasks.fleet.agent.deployment import Deployment, File, Launch, Order, Version
from prefect_robomaker.tasks.fleet.agent.loop import Agent
from prefect_robomaker.tasks.fleet.agent.state_machine import Checked, Event, Ordered, Passed, Phase, State, Trusted

ORDER = Order(1, "applications/courier/deployments/job-1.json")
VERSION = Version("courier", "1", "0" * 64, Launch("courier", "drive"), "job-1")
TRUSTED = Trusted({"timestamp": 3}, 1000.0)
CHECKED = Checked(Deployment(VERSION, File("x", 1, "0" * 64), None, 1))


class Nothing:
    """Stands for what is told and says nothing: no application runs, nobody listens."""

    due_s = interval_s = None

    def __getattr__(self, _name: str) -> Any:
        return lambda *_args, **_members: None


class Polls(Nothing):
    """A server with one order, which hears its end at the third time."""

    due_s = 0.0
    tries = 0

    def poll(self, _state: State, _percent: int | None) -> list[Event]:
        self.due_s = 30.0
        return [Ordered(ORDER)]

    def deliver(self, _end: object) -> list[Event]:
        return []


@dataclass
class Robot:
    """A disk and effects that pass at once, with all that happened in turn."""

    done: list[str] = field(default_factory=list)
    is_full: bool = False

    def save(self, state: State) -> None:
        if self.is_full:
            raise OSError(28, "No space left on device")
        self.done.append(f"saved {state.phase.value} {dict(state.floors)}")

    def begin(self, state: State) -> list[Event]:
        self.done.append(f"began {state.phase.value}")
        if state.phase is Phase.VALIDATING:
            return [TRUSTED, CHECKED]
        return [] if state.phase is Phase.IDLE else [Passed(state.phase)]


def agent_of(robot: Robot) -> Agent:
    nothing: Any = Nothing()
    polls: Any = Polls()
    effects: Any = robot
    return Agent(State(), robot, polls, effects, nothing, lambda: 1.0, lambda *_: None, nothing, lambda _: None)


def test_what_happened_together_is_saved_once_and_before_anything_is_done_about_it() -> None:
    robot = Robot()
    agent_of(robot).step()

    seen = {"timestamp": 3}
    assert robot.done == [
        "began idle",
        *("saved validating {}", "began validating"),
        *(f"saved downloading {seen}", "began downloading"),
        *(f"saved launching {seen}", "began launching"),
        *(f"saved watching {seen}", "began watching"),
        *(f"saved idle {seen}", "began idle"),
    ]


def test_what_cannot_be_saved_is_not_done_and_not_forgotten() -> None:
    robot = Robot(is_full=True)
    agent = agent_of(robot)
    agent.step()
    assert robot.done == ["began idle"]

    robot.is_full, agent._held_until_s = False, 0.0
    agent.step()

    assert robot.done[1:3] == ["saved validating {}", "began validating"]
    assert robot.done[-1] == "began idle"
