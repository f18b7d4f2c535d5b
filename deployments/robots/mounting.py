"""The door for robots and the endpoint for clients as one ASGI application.

Robots have tokens of their own, which the door checks; all other paths are the endpoint's, with its access keys.
"""

import asyncio
import time

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ...schemas.wire.errors import StorageError
from ...tasks.fleet.bundle_files import BundleFiles
from ...tasks.fleet.control.tending import EndedRollouts
from ...tasks.fleet.ddi.open_orders import OpenOrders
from ...tasks.fleet.ddi.orders import RobotOrder
from ...tasks.fleet.known_robots import KnownRobots
from ...tasks.fleet.order_keeping import OrderKeeper
from ...tasks.fleet.order_watch import OrderWatch
from ...tasks.fleet.robot_reports import RobotReports
from ...tasks.fleet.stored_rollouts import report, served_rollouts
from ...tasks.service.service import Service
from ..robot_door.door import DoorSettings, RobotDoor
from ..robot_door.downloads import reader_of_files
from .agents import ServedAgents
from .upkeep import TrustUpkeep


class RobotsBeside:
    """Serves robots, and passes everything else on.

    Args:
        endpoint: the application of all other paths.
        service: where robots, rollouts and files are stored.

    Raises:
        ConfigurationError: the service's `robots_url` is not right.
    """

    def __init__(self, endpoint: ASGIApp, service: Service) -> None:
        self.checks_signatures = getattr(endpoint, "checks_signatures", False)
        """Whether requests of clients have to be signed."""

        self._endpoint = endpoint
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
            settings=DoorSettings(public_url=service.settings.robots_url, idle_sleep_s=service.settings.robot_poll_s),
            agents=ServedAgents(service, self._watch.wake_for_robots),
        )
        self._upkeep = TrustUpkeep(service)

    def wake(self) -> None:
        """Has orders looked for at once."""
        self._watch.wake()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves one request, or the server's start and end."""
        if scope["type"] == "http" and scope["path"].startswith(self._door.prefixes):
            await self._door(scope, receive, send)
        elif scope["type"] == "lifespan":
            await self._endpoint(scope, receive, self._with_life(send))
        else:
            await self._endpoint(scope, receive, send)

    def _with_life(self, send: Send) -> Send:
        """Begins and ends together with the endpoint."""

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
