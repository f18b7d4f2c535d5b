"""Update server for robots within `robomaker serve`: mounts it, enrols agents, renews the TUF metadata."""

import asyncio
import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ...schemas.fleet.settings import FleetSettings
from ...schemas.wire.errors import ObjectNotFoundError, RobomakerError, StorageError
from ...tasks.fleet.bundle_files import BundleFiles
from ...tasks.fleet.control.rollbacks import EndedRollouts
from ...tasks.fleet.ddi.open_orders import OpenOrders
from ...tasks.fleet.ddi.orders import RobotOrder
from ...tasks.fleet.fleet_records import KnownRobots
from ...tasks.fleet.kept_rollouts import report, served_rollouts
from ...tasks.fleet.order_keeping import OrderKeeper
from ...tasks.fleet.order_refresh import OrderWatch
from ...tasks.fleet.robot_reports import RobotReports
from ...tasks.fleet.trust.roles import RepositoryReader
from ...tasks.service.service import Service
from .robot_door.door import DoorSettings, RobotDoor
from .robot_door.downloads import ServedFile, reader_of_files


class ServedAgents:
    """Connects the update server with enrolment and update repository; usable from any thread.

    Args:
        service: The service, with its catalog and object store.
        enrolled: Called when an agent was enrolled, so that it is known soon.
    """

    def __init__(self, service: Service, enrolled: Callable[[], None]) -> None:
        self._service = service
        self._enrolled = enrolled
        self._reader = RepositoryReader(service)

    def enrol(self, robot: str, secret: str, token_sha256: str) -> str | None:
        """Enrols a robot's agent; returns the TUF root to trust, or `None` if its one-time token is refused."""
        from ...tasks.fleet.trust.enrolment_tokens import take  # it needs the extra `fleet`

        root = take(robot, secret, token_sha256, self._service)
        if root is not None:
            self._enrolled()
        return root

    def metadata(self, name: str) -> bytes:
        """Returns a TUF metadata file; see `RepositoryReader.metadata`."""
        return self._reader.metadata(name)

    def target(self, path: str) -> ServedFile:
        """Returns an update file of the store's folder: its size, SHA-256 and a function that reads parts of it.

        Raises ObjectNotFoundError if there is no such file.
        """
        here = self._reader.target(path)
        try:
            size_bytes = here.stat().st_size
        except OSError as error:
            raise ObjectNotFoundError(f"there is no target {path}: {error.strerror}") from error
        # The name begins with the content's hash.
        sha256 = path.rpartition("/")[2].partition(".")[0]
        return ServedFile(f"the target {path}", size_bytes, sha256, lambda start, length: _read(here, start, length))


def _read(path: Path, start: int, length: int) -> bytes:
    try:
        with path.open("rb") as file:
            file.seek(start)
            return file.read(length)
    except OSError as error:
        raise StorageError(f"{path.name} cannot be read: {error.strerror}") from error


LOGGER = logging.getLogger("robomaker.robots")

PAUSE_S = 600.0
"""Interval between two checks of the metadata, in seconds; the timestamp is signed again every six hours."""


class TrustUpkeep:
    """Thread that regularly renews expiring signatures of the update repository.

    Args:
        service: The service, with its catalog and object store.
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._stopped = threading.Event()
        self._problem = ""
        self._thread = threading.Thread(target=self._keep_up, name="trust-upkeep", daemon=True)

    def start(self) -> None:
        """Starts the thread that renews expiring signatures."""
        self._thread.start()

    def stop(self) -> None:
        """Stops the thread that renews expiring signatures, after its current check."""
        self._stopped.set()
        self._thread.join()

    def _keep_up(self) -> None:
        while not self._stopped.is_set():
            self._tell(self._problem_now())
            self._stopped.wait(PAUSE_S)

    def _problem_now(self) -> str:
        if not (self._service.settings.home / "robots" / "trust" / "root.json").exists():
            return ""  # no agent has been enrolled from here
        try:
            from ...tasks.fleet.trust.publishing import publisher_of  # it needs the extra `fleet`

            publisher_of(self._service).keep_up()
        except (RobomakerError, ImportError) as error:
            return f"the robots' repository is not signed again: {error}"
        except Exception as error:
            LOGGER.exception("the robots' repository is not signed again")
            return str(error)
        return ""

    def _tell(self, problem: str) -> None:
        """Logs a problem once, and once that it is over."""
        if problem != self._problem:
            LOGGER.warning("%s", problem or "the robots' repository is signed again")
        self._problem = problem


class RobotsBeside:
    """ASGI application that serves robots, and passes all other requests on.

    Args:
        endpoint: The application of all other paths.
        service: The service, with its catalog and object store.

    Raises:
        ConfigurationError: The setting `robots_url` is not right.
    """

    def __init__(self, endpoint: ASGIApp, service: Service) -> None:
        self.checks_signatures = getattr(endpoint, "checks_signatures", False)
        """Whether API requests of clients must be signed."""

        self._endpoint = endpoint
        settings = FleetSettings.of(service.settings)
        orders = OpenOrders()
        robots = KnownRobots(orders)
        keeper = OrderKeeper(orders, robots)
        files = BundleFiles(service, keeper)
        self._reports = RobotReports(service, robots, keeper, report)
        self._watch = OrderWatch(service, robots, keeper, files, served_rollouts, EndedRollouts(service).tend)
        self._read_file = reader_of_files(files.path_of)
        self._door = RobotDoor(
            orders,
            read_part=self._read_part,
            sink=self._reports.take,
            clock=time.time,
            chance=service.chance.random,
            settings=DoorSettings(public_url=settings.robots_url, idle_sleep_s=settings.robot_poll_s),
            agents=ServedAgents(service, self._watch.wake_for_robots),
        )
        self._upkeep = TrustUpkeep(service)

    def wake(self) -> None:
        """Makes the server poll for new orders at once."""
        self._watch.wake()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves one HTTP request, or the server's start and end (ASGI)."""
        if scope["type"] == "http" and scope["path"].startswith(self._door.prefixes):
            await self._door(scope, receive, send)
        elif scope["type"] == "lifespan":
            await self._endpoint(scope, receive, self._with_life(send))
        else:
            await self._endpoint(scope, receive, send)

    def _with_life(self, send: Send) -> Send:
        """Returns a sender that starts and stops the update server's threads together with the endpoint."""

        async def sent(message: Message) -> None:
            if message["type"] == "lifespan.startup.complete":
                self._watch.start()
                self._upkeep.start()
            elif message["type"] == "lifespan.shutdown.complete":
                await self._door.close()
                await asyncio.to_thread(self._watch.stop)
                await asyncio.to_thread(self._upkeep.stop)
            await send(message)

        return sent

    def _read_part(self, order: RobotOrder, start: int, length: int) -> bytes:
        try:
            part = self._read_file(order, start, length)
        except StorageError as error:
            self._reports.note_withheld(order, error)
            raise
        self._reports.note_sent(order, start + length, time.time())
        return part


def beside(application: ASGIApp, service: Service) -> RobotsBeside:
    """Adds the update server for robots to the API server's application."""
    return RobotsBeside(application, service)
