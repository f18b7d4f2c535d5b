"""What robots say reaches the rollout it is about, or their own document."""

from dataclasses import replace
from typing import Any

import pytest
from helpers.fleet_calls import Fleets
from helpers.kept_orders import open_rollout, order
from helpers.robot_orders import TOKEN

from prefect_robomaker.schemas.fleet.documents import RobotDocument
from prefect_robomaker.schemas.fleet.rollouts.rollout import Failed, Progressed, Report, Succeeded
from prefect_robomaker.schemas.wire.errors import (
    ObjectNotFoundError,
    ResourceNotFoundException,
    ServiceUnavailableException,
    StorageAccessDeniedError,
    StorageError,
)
from prefect_robomaker.tasks.fleet.ddi.open_orders import OpenOrders
from prefect_robomaker.tasks.fleet.ddi.received_reports import (
    Attributes,
    AttributesSent,
    Execution,
    Feedback,
    Finished,
    OrderFeedback,
    OrderFetched,
    RobotsSeen,
)
from prefect_robomaker.tasks.fleet.fleet_records import KnownRobots, enrol
from prefect_robomaker.tasks.fleet.order_keeping import OrderKeeper
from prefect_robomaker.tasks.fleet.robot_reports import PROGRESS_EVERY_S, RobotReports
from prefect_robomaker.tasks.service.service import Service


class Desk:
    """Takes the reports of one robot, which has order 8."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self.arn = Fleets(service).robot("rover")
        enrol("rover", service, lambda count: bytes.fromhex(TOKEN)[:count], rotate=False)
        self.orders = OpenOrders()
        robots = KnownRobots(self.orders)
        robots.refresh(service)
        self.keeper = OrderKeeper(self.orders, robots)
        self.events: list[tuple[str, Report, float]] = []
        self.error: Exception | None = None
        self.reports = RobotReports(service, robots, self.keeper, self._hear)
        rollout = open_rollout(x=order(8, "fetched"))
        states = {self.arn: rollout.rollout.robots["arn:x"]}
        meant = rollout.rollout.model_copy(update={"robots": states})
        self.keeper.sync([replace(rollout, rollout=meant, artifacts={self.arn: rollout.artifacts["arn:x"]})])

    def say(self, execution: str, finished: str = "none", *details: str) -> None:
        feedback = Feedback(8, Execution(execution), Finished(finished), details=details)
        self.reports.take(OrderFeedback("rover", feedback, 5.0))

    def document(self) -> RobotDocument:
        return RobotDocument.of(self.service.catalog.get(self.arn))

    def _hear(self, service: Service, job: str, event: Report, at_s: float) -> None:
        if self.error is not None:
            raise self.error
        self.events.append((job, event, at_s))


@pytest.fixture
def desk(service: Service) -> Desk:
    return Desk(service)


def test_what_is_installed_is_known_once_the_robot_said_so(desk: Desk) -> None:
    desk.say("proceeding")
    assert desk.document().installed_version is None

    desk.say("closed", "success")

    assert desk.events[-1] == ("job", Succeeded(robot=desk.arn, action_id=8), 5.0)
    assert (desk.document().installed_name, desk.document().installed_version) == ("courier", "3")
    assert desk.document().installed_by == "job"


def test_what_could_not_be_stored_can_be_said_again(desk: Desk) -> None:
    desk.error = ServiceUnavailableException("no database")
    with pytest.raises(ServiceUnavailableException):
        desk.say("proceeding", "none", "ERROR : no space")
    desk.error = None

    desk.say("proceeding", "none", "ERROR : no space")
    desk.say("closed", "failure")

    event = desk.events[-1][1]
    assert isinstance(event, Failed)
    assert event.reason == "no space", "and counts once"


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ObjectNotFoundError("gone"), "ResourceNotFound"),
        (StorageAccessDeniedError("no"), "BadPermissionError"),
        (StorageError("slow"), "ExtractingBundleFailure"),
    ],
)
def test_a_file_that_was_withheld_is_why_it_failed(desk: Desk, error: StorageError, code: str) -> None:
    desk.reports.note_withheld(desk.orders.open()["rover"], error)
    desk.say("closed", "failure")
    event = desk.events[-1][1]
    assert isinstance(event, Failed)
    assert event.code == code


def test_how_much_was_sent_is_reported_now_and_then_and_not_after_it_was_installed(desk: Desk) -> None:
    opened = desk.orders.open()["rover"]
    for sent_bytes, now_s in [(100, 10.0), (200, 10.1), (300, 10 + PROGRESS_EVERY_S), (400, 10.2 + PROGRESS_EVERY_S)]:
        desk.reports.note_sent(opened, sent_bytes, now_s)
    percents = [event.percent_done for _, event, _ in desk.events if isinstance(event, Progressed)]
    assert percents == [30.0]

    desk.say("proceeding", "none", "Installed Chunk.")
    before = len(desk.events)
    desk.reports.note_sent(opened, 1000, 1000.0)
    assert len(desk.events) == before


def test_when_it_was_seen_is_stored_each_time(desk: Desk) -> None:
    for at_s in (1000.0, 1003.0):
        desk.reports.take(RobotsSeen({"rover": at_s, "stranger": at_s}))
        assert desk.document().last_seen_s == at_s


@pytest.mark.parametrize(
    ("mode", "after"),
    [
        ("merge", {"a": "1", "b": "3", "c": "4"}),
        ("replace", {"b": "3", "c": "4"}),
        ("remove", {"a": "1"}),
    ],
)
def test_attributes_are_merged_replaced_or_removed(desk: Desk, mode: Any, after: dict[str, str]) -> None:
    desk.reports.take(AttributesSent("rover", Attributes("merge", {"a": "1", "b": "2"}), 1.0))
    desk.reports.take(AttributesSent("rover", Attributes(mode, {"b": "3", "c": "4"}), 1.0))
    assert desk.document().attributes == after


def test_a_robot_that_is_not_enrolled_any_more_is_told_to_say_it_elsewhere(desk: Desk) -> None:
    with pytest.raises(ResourceNotFoundException, match="stranger"):
        desk.reports.take(OrderFetched("stranger", 8, 1.0))
