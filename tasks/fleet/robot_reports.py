"""Stores the reports of robots: about orders in their rollouts, about themselves in their documents."""

import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace

from ...schemas.fleet.documents import RobotAttributes, RobotDocument, RobotInstallation, RobotSighting
from ...schemas.fleet.rollouts.rollout import Progressed, Report, ReportedCode, Succeeded
from ...schemas.wire.errors import (
    ObjectNotFoundError,
    ResourceNotFoundException,
    RobomakerError,
    StorageAccessDeniedError,
)
from ..service.service import Service
from .ddi.orders import RobotOrder
from .ddi.received_reports import Attributes, AttributesSent, OrderFetched, RobotReport, RobotsSeen
from .fleet_records import KnownRobots
from .order_keeping import OrderKeeper, OrderKey, OrderReport, event_of, heard

_logger = logging.getLogger(__name__)

PROGRESS_EVERY_S = 2.0
"""Interval between two records of a robot's download progress, in seconds."""

ReportEvent = Callable[[Service, str, Report, float], None]
"""Function that stores an event of a rollout, such as a robot's report: `kept_rollouts.report`."""


class RobotReports:
    """Receives the reports of robots and stores them for their rollouts; usable from any thread.

    Args:
        service: The service, with its catalog and object store.
        robots: The enrolled robots.
        keeper: Knows their orders.
        report: Takes in events of rollouts.
    """

    def __init__(self, service: Service, robots: KnownRobots, keeper: OrderKeeper, report: ReportEvent) -> None:
        self._service = service
        self._robots = robots
        self._keeper = keeper
        self._report = report
        self._sent: dict[str, float] = {}
        self._lock = threading.Lock()

    def take(self, report: RobotReport) -> None:
        """Stores a robot's report; it is stored when this returns.

        Raises:
            ServiceError: The report could not be stored; the robot has to send it again.
        """
        match report:
            case RobotsSeen():
                self._take_seen(report.last_seen_s)
            case AttributesSent():
                self._service.catalog.update(
                    self._arn(report.robot), lambda stored: _with_attributes(stored, report.attributes)
                )
                if trouble := report.attributes.values.get("trouble"):
                    _logger.warning("robot %s says: %s", report.robot, trouble)
            case _:
                self._take_order_report(report)

    def note_sent(self, order: RobotOrder, sent_bytes: int, now_s: float) -> None:
        """Records how many bytes of its installation file a robot has downloaded, not more often than is useful.

        Args:
            order: The robot's order.
            sent_bytes: Up to which byte.
            now_s: The time, in seconds since the epoch.
        """
        key = (order.robot, order.action_id)
        with self._lock:
            if now_s - self._sent.setdefault(order.robot, now_s) < PROGRESS_EVERY_S:
                return
            self._sent[order.robot] = now_s
        arn = self._robots.arn(order.robot)
        if arn is None or self._keeper.said(key).installed:
            return
        percent = min(100.0, 100.0 * sent_bytes / order.size_bytes)
        progress = Progressed(robot=arn, action_id=order.action_id, step="DownloadingExtracting", percent_done=percent)
        self._pass_on(key, progress, now_s)

    def note_withheld(self, order: RobotOrder, error: RobomakerError) -> None:
        """Records why a robot could not be sent its file, as the reason if the robot gives up."""
        codes: dict[type[RobomakerError], ReportedCode] = {
            ObjectNotFoundError: "ResourceNotFound",
            StorageAccessDeniedError: "BadPermissionError",
        }
        if (code := codes.get(type(error))) is not None:
            key = (order.robot, order.action_id)
            self._keeper.remember(key, replace(self._keeper.said(key), withheld=code))

    def _take_order_report(self, report: OrderReport) -> None:
        arn = self._arn(report.robot)
        if isinstance(report, OrderFetched):
            key = (report.robot, report.action_id)
            known = self._keeper.said(key)
        else:
            key = (report.robot, report.feedback.action_id)
            known = heard(self._keeper.said(key), report.feedback)
        event = event_of(report, arn, known)
        self._pass_on(key, event, report.at_s)
        self._keeper.remember(key, known)
        if isinstance(event, Succeeded):
            self._note_installed(key, arn)

    def _pass_on(self, key: OrderKey, event: Report, at_s: float) -> None:
        if (job := self._keeper.job(key)) is not None:
            self._report(self._service, job, event, at_s)

    def _note_installed(self, key: OrderKey, arn: str) -> None:
        artifact = self._keeper.ordered(key)
        if artifact is not None:
            installed = RobotInstallation(
                installed_name=artifact.name, installed_version=artifact.version, installed_by=self._keeper.job(key)
            )
            self._service.catalog.update(arn, installed)

    def _take_seen(self, seen: Mapping[str, float]) -> None:
        """Stores when robots polled last, all in one transaction."""
        arns = {self._robots.arn(robot): at_s for robot, at_s in seen.items()}
        sightings = {arn: RobotSighting(last_seen_s=at_s) for arn, at_s in arns.items() if arn is not None}
        self._service.catalog.update_many(sightings)

    def _arn(self, robot: str) -> str:
        arn = self._robots.arn(robot)
        if arn is None:
            raise ResourceNotFoundException(f"robot {robot} is not enrolled any more")
        return arn


def _with_attributes(stored: dict[str, object], sent: Attributes) -> RobotAttributes:
    before = RobotDocument.model_validate(stored).attributes or {}
    match sent.mode:
        case "replace":
            after = sent.values
        case "remove":
            after = {name: value for name, value in before.items() if name not in sent.values}
        case "merge":
            after = before | sent.values
    return RobotAttributes(attributes=after)
