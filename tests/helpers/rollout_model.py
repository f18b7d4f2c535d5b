"""A rollout by brute force, second by second, from what the service's guide says; it knows nothing of the product's.

Each rule looks at every robot anew; nothing is counted ahead, nothing is sorted.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any


@dataclass
class Member:
    """A robot of the fleet."""

    name: str
    canary: bool = False
    unfit: str | None = None
    number: int | None = None  # of its latest order
    asked_s: int | None = None  # the order waits for it to fetch it
    working_s: int | None = None  # it fetched the order, which is in force
    told_to_stop: bool = False  # the order was taken back, and it has not answered
    goes_on: bool = False  # it said that it will carry out the order nevertheless
    began: bool = False  # it has shown that it has the order
    result: str | None = None
    code: str | None = None
    gone: bool = False
    back: bool = False  # it was away, and answers again
    extra_s: int = 0  # the service was out of reach for so long

    @property
    def busy(self) -> bool:
        return self.asked_s is not None or self.working_s is not None

    @property
    def has_order(self) -> bool:
        return self.busy or self.told_to_stop or self.goes_on

    @property
    def counts(self) -> bool:
        return self.unfit is None and not (self.gone and self.result is None)


class RolloutModel:
    """The service's side of a rollout."""

    def __init__(
        self,
        names: Iterable[str],
        now_s: int,
        *,
        at_once_percent: int,
        threshold_percent: int,
        robot_timeout_s: int,
        job_timeout_s: int,
        canaries: Iterable[str] = (),
        unfit: Iterable[str] = (),
        needs_yes: bool = False,
        opening_hours: Iterable[tuple[int, int]] = (),
    ) -> None:
        first, poor = list(canaries), set(unfit)
        self.fleet = [
            Member(name, name in first, "MissingRobotApplicationArchitecture" if name in poor else None)
            for name in names
        ]
        for member in self.fleet:
            if member.unfit:
                member.result, member.code = "failed", member.unfit
        self.named = {member.name: member for member in self.fleet}
        self.first = first
        self.at_once = max(int(len(self.fleet) * at_once_percent / 100 + 1e-9), 1)
        self.threshold = threshold_percent / 100 - 1e-9
        self.robot_timeout_s, self.job_timeout_s = robot_timeout_s, job_timeout_s
        self.began_s = now_s
        self.status, self.code = "InProgress", None
        self.paused = False
        self.needs_yes, self.yes = needs_yes, False
        self.opening_hours = list(opening_hours)
        self.last_s = now_s
        self.nothing_begins = self.shut(now_s)
        self.closed = False  # nobody gets an order any more
        self.check()

    # Time

    def shut(self, now_s: int) -> bool:
        hours = self.opening_hours
        return bool(self.paused or (hours and not [1 for begin, end in hours if begin <= now_s < end]))

    def tick(self, now_s: int) -> None:
        for member in self.fleet:
            if self.nothing_begins and member.asked_s is not None:
                member.extra_s += now_s - self.last_s
        self.last_s = now_s
        self.time_outs(now_s)
        self.nothing_begins = self.shut(now_s)

    def time_outs(self, now_s: int) -> None:
        for member in self.fleet:
            if member.asked_s is not None and now_s >= member.asked_s + self.robot_timeout_s + member.extra_s:
                member.asked_s, member.told_to_stop = None, True
                self.fail(member, "RobotDeploymentNoResponse")
            if member.working_s is not None and now_s >= member.working_s + self.robot_timeout_s + member.extra_s:
                member.working_s, member.told_to_stop = None, True
                self.fail(member, "RobotAgentConnectionTimeout")
        if self.status == "InProgress" and now_s >= self.began_s + self.job_timeout_s:
            self.status, self.code = "Failed", "FleetDeploymentTimeout"
            self.take_back("FleetDeploymentTimeout")

    # The end

    def check(self) -> None:
        if self.status != "InProgress":
            return
        everyone = [member for member in self.fleet if member.counts]
        for group in ([member for member in everyone if member.canary], everyone):
            bad = [member for member in group if member.result == "failed"]
            if bad and len(bad) / len(group) >= self.threshold:
                self.status, self.code, self.closed = "Failed", "FailureThresholdBreached", True
                self.take_back(None)
                return
        if not everyone:
            unfit = [member.unfit for member in self.fleet if member.unfit]
            self.status, self.closed = "Failed", True
            self.code = unfit[0] if unfit else "RobotDeploymentAborted"
            self.take_back(None)
        elif all(member.result for member in everyone):
            self.status = "Succeeded"

    def take_back(self, code: str | None) -> None:
        """Takes orders back: all, failing robots that began with the code; or only those that were not fetched."""
        for member in self.fleet:
            if member.asked_s is not None or (member.working_s is not None and code is not None):
                begun = member.working_s is not None
                member.asked_s = member.working_s = None
                member.told_to_stop = True
                if begun and member.result is None and not member.gone:
                    member.result, member.code = "failed", code

    def fail(self, member: Member, code: str) -> None:
        if not (member.gone and member.result is None):
            member.result, member.code, member.back = "failed", code, False
        self.check()

    # What robots see and say

    def shown(self) -> dict[str, tuple[str, int]]:
        pages: dict[str, tuple[str, int]] = {}
        for member in self.fleet:
            hidden = self.nothing_begins and member.asked_s is not None
            if member.number is not None and member.has_order and not hidden:
                pages[member.name] = ("cancel" if member.told_to_stop else "order", member.number)
        return pages

    def report(self, event: Any, now_s: int) -> None:
        kind = event.kind
        if kind == "stopped":
            self.stop(event.why)
        elif kind in ("paused", "resumed"):
            self.paused = kind == "paused"
            self.nothing_begins = self.shut(now_s)
        elif kind == "approved":
            self.yes = self.yes or (self.status == "InProgress" and self.first_have_ended())
        elif kind == "outage":
            self.tick(int(event.since_s))
            for member in self.fleet:
                member.extra_s += now_s - int(event.since_s)
            self.last_s = now_s
        else:
            member = self.named.get(event.robot)
            if member is not None and kind == "robot_gone":
                self.leave(member)
            elif member is not None and member.number == event.action_id and member.has_order:
                self.said(member, event, now_s)
        if kind not in ("fetched", "progressed"):  # these decide nothing, and are most of all that is said
            self.check()

    def said(self, member: Member, event: Any, now_s: int) -> None:
        if event.kind in ("fetched", "progressed"):
            self.has_begun(member, now_s)
        elif event.kind == "cancel_refused":
            if member.told_to_stop:
                self.has_begun(member, now_s)
                member.told_to_stop, member.goes_on = False, True
        elif event.kind == "canceled":
            unasked = member.busy
            self.nothing_open(member)
            if unasked:
                self.fail(member, "RobotDeploymentAborted")
            elif member.code == "RobotDeploymentNoResponse" and not member.gone:
                member.back = True
        else:
            self.nothing_open(member)
            if event.kind == "failed":
                self.fail(member, event.code)
            elif not (member.gone and member.result is None):
                member.result, member.code = "succeeded", None

    def has_begun(self, member: Member, now_s: int) -> None:
        if member.began:
            return
        member.began = True
        if member.asked_s is not None:
            member.asked_s, member.working_s, member.extra_s = None, now_s, 0
        elif member.result is None:
            self.fail(member, "RobotDeploymentAborted")

    @staticmethod
    def nothing_open(member: Member) -> None:
        member.asked_s = member.working_s = None
        member.told_to_stop = member.goes_on = False

    # People

    def leave(self, member: Member) -> None:
        member.gone, member.back = True, False
        if member.busy:
            member.asked_s = member.working_s = None
            member.told_to_stop = True

    def stop(self, why: str) -> None:
        if why in ("canceled", "rejected") and self.status != "InProgress":
            return
        code = {
            "application_deleted": "RobotApplicationDoesNotExist",
            "fleet_deleted": "DeploymentFleetDoesNotExist",
        }.get(why)
        if self.status == "InProgress":
            self.status, self.code = ("Failed", code) if code else ("Canceled", None)
        self.closed = True
        self.take_back(code or "RobotDeploymentAborted")

    # Whose turn it is

    def first_have_ended(self) -> bool:
        return all(self.named[name].result or self.named[name].gone for name in self.first)

    def turns(self) -> list[str]:
        free = self.at_once - len([member for member in self.fleet if member.busy])
        if self.nothing_begins or self.closed or free <= 0:
            return []
        waiting: list[str] = []
        if self.status == "InProgress":
            untouched = [
                member.name
                for member in self.fleet
                if member.number is None and member.result is None and not member.gone
            ]
            waiting = [name for name in self.first if name in untouched]
            if self.first_have_ended() and (self.yes or not self.needs_yes):
                waiting += [name for name in untouched if name not in self.first]
        again = [member.name for member in self.fleet if member.back]
        return (waiting + again)[:free]

    def offer(self, robot: str, number: int, now_s: int) -> None:
        member = self.named[robot]
        member.number, member.asked_s, member.began = number, now_s, False
        member.back, member.extra_s = False, 0

    # What a test compares

    def facts(self) -> dict[str, object]:
        robots = {
            member.name: (
                "asked"
                if member.asked_s is not None
                else "working"
                if member.working_s is not None
                else "told to stop"
                if member.told_to_stop
                else "goes on"
                if member.goes_on
                else "nothing",
                member.number,
                member.result,
                member.code,
            )
            for member in self.fleet
        }
        return {"status": self.status, "code": self.code, "robots": robots}
