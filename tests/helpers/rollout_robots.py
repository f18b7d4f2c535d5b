"""A fleet of simulated robots that follow scripts, second by second; they speak with any `RolloutService`."""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import Literal, Protocol

from prefect_robomaker.schemas.fleet.operations.deployment_jobs import RobotDeploymentStep
from prefect_robomaker.schemas.fleet.rollouts.rollout import (
    Canceled,
    CancelRefused,
    Failed,
    Fetched,
    Outage,
    Progressed,
    Report,
    ReportedCode,
    RolloutEvent,
    Succeeded,
)

CODES: tuple[ReportedCode, ...] = (
    "DownloadConditionFailed",
    "ExtractingBundleFailure",
    "PreLaunchFileFailure",
    "PostLaunchFileFailure",
)


@dataclass(frozen=True)
class Attempt:
    """What a robot does with one order; times in seconds."""

    fetch_s: int | None = 1
    """After it saw the order; nothing: it never fetches it."""
    end: Literal["success"] | ReportedCode | None = "success"
    """`success`, a failure code, or nothing: it falls silent."""
    end_s: int = 3
    """After it fetched the order."""
    reports: tuple[tuple[int, RobotDeploymentStep, float | None], ...] = ()
    """Seconds after it fetched the order, step, percent."""
    cancel: Literal["give up", "refuse", "ignore"] = "give up"
    cancel_s: int = 1


@dataclass(frozen=True)
class Script:
    """What a robot does, order for order; the last attempt repeats."""

    attempts: tuple[Attempt, ...] = (Attempt(),)
    off: tuple[tuple[int, int], ...] = ()
    """Seconds in which it has no power, from and until."""


class RolloutService(Protocol):
    """What robots and people deal with: the product's ledger, or the model."""

    def tick(self, now_s: int) -> None: ...
    def shown(self) -> dict[str, tuple[str, int]]: ...
    def report(self, event: RolloutEvent, now_s: int) -> None: ...
    def turns(self) -> Sequence[str]: ...
    def offer(self, robot: str, number: int, now_s: int) -> None: ...
    def facts(self) -> dict[str, object]: ...


@dataclass
class _Agent:
    name: str
    script: Script
    doing: int | None = None
    fetched: bool = False
    clock: int = 0
    cancel_clock: int = 0
    was_off: bool = False
    refused: set[int] = field(default_factory=set)
    done: set[int] = field(default_factory=set)
    orders: int = 0

    @property
    def attempt(self) -> Attempt:
        return self.script.attempts[min(self.orders, len(self.script.attempts)) - 1]

    def second(self, now_s: int, shown: tuple[str, int] | None, say: Callable[[Report], None]) -> None:
        if any(begin <= now_s < end for begin, end in self.script.off):
            self.was_off = True
            return
        if self.was_off:
            self.was_off, self.clock, self.fetched = False, 0, False
        if shown is not None:
            what, number = shown
            if what == "cancel":
                self._told_to_stop(number, say)
            elif number not in self.done and self.doing != number:
                self.doing, self.clock, self.fetched, self.cancel_clock = number, 0, False, 0
                self.orders += 1
        if self.doing is not None:
            self._work(self.doing, say)

    def _told_to_stop(self, number: int, say: Callable[[Report], None]) -> None:
        self.cancel_clock += 1
        attempt = self.attempt
        if self.cancel_clock < attempt.cancel_s or (self.doing and attempt.cancel == "ignore"):
            return
        if self.doing == number and attempt.cancel == "refuse":
            if number not in self.refused:
                self.refused.add(number)
                say(CancelRefused(robot=self.name, action_id=number))
            return
        if self.doing == number:
            self.doing = None
        self.cancel_clock = 0
        self.done.add(number)
        say(Canceled(robot=self.name, action_id=number))

    def _work(self, number: int, say: Callable[[Report], None]) -> None:
        attempt = self.attempt
        self.clock += 1
        if attempt.fetch_s is None or self.clock < attempt.fetch_s:
            return
        if not self.fetched:
            self.fetched = True
            say(Fetched(robot=self.name, action_id=number))
        at_s = self.clock - attempt.fetch_s
        for when_s, step, percent in attempt.reports:
            if when_s == at_s:
                say(Progressed(robot=self.name, action_id=number, step=step, percent_done=percent))
        if attempt.end is not None and at_s >= attempt.end_s:
            self.doing = None
            self.done.add(number)
            if attempt.end == "success":
                say(Succeeded(robot=self.name, action_id=number))
            else:
                say(Failed(robot=self.name, action_id=number, code=attempt.end, reason="it said so"))


def watch(
    service: RolloutService,
    scripts: dict[str, Script],
    seconds: int,
    people: dict[int, list[RolloutEvent]] | None = None,
    repeats_seed: int | None = None,
    outage: tuple[int, int] | None = None,
    start_s: int = 1000,
    facts_every_s: int = 1,
) -> list[dict[str, object]]:
    """Lets a fleet live for some seconds; the service's facts, after each unless said otherwise.

    Args:
        service: What the robots poll.
        scripts: What each robot does.
        seconds: How long.
        people: What people do, by second.
        repeats_seed: From what reports are drawn that are sent again, at once or late; nothing: none are.
        outage: Seconds in which robots cannot reach the service, from and until.
        start_s: When it begins.
        facts_every_s: How often facts are noted; besides, they are at the end.
    """
    agents = [_Agent(name, script) for name, script in scripts.items()]
    repeats = _Repeats(repeats_seed)
    numbers, facts = count(1), []
    for second in range(seconds):
        now_s = start_s + second
        if outage is not None and outage[0] <= second < outage[1]:
            continue
        if outage is not None and second == outage[1]:
            service.report(Outage(since_s=start_s + outage[0]), now_s)
        service.tick(now_s)
        said = [event for report in _said(agents, service.shown(), second) for event in repeats.of(report)]
        for event in [*said, *(people or {}).get(second, [])]:
            service.report(event, now_s)
        for robot in tuple(service.turns()):
            service.offer(robot, next(numbers), now_s)
        if second % facts_every_s == 0 or second == seconds - 1:
            facts.append(service.facts())
    return facts


def _said(agents: list[_Agent], shown: dict[str, tuple[str, int]], second: int) -> list[Report]:
    said: list[Report] = []
    for agent in agents:
        if agent.doing is not None or agent.name in shown:
            agent.second(second, shown.get(agent.name), said.append)
    return said


class _Repeats:
    """Sends a fifth of the reports twice, and an old one in between."""

    def __init__(self, seed: int | None) -> None:
        self._rng = None if seed is None else random.Random(seed)
        self._sent: list[Report] = []

    def of(self, report: Report) -> list[Report]:
        self._sent.append(report)
        if self._rng is None or self._rng.random() > 0.2:
            return [report]
        return [report, self._rng.choice(self._sent), report]
