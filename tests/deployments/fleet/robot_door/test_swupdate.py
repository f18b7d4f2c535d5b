"""Debian's `swupdate`, unmodified, takes orders at the door."""

import hashlib
import random
import secrets
import tarfile
import threading
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path

import pytest
from helpers.processes import wait_for
from helpers.robot_orders import TOKEN, table_of_robots
from helpers.swupdate_robot import SwupdateRobot, needs_swupdate, swupdate_robot
from helpers.tcp_proxy import TcpProxy, tcp_proxy

from prefect_robomaker.deployments.fleet.robot_door.door import RobotDoor
from prefect_robomaker.tasks.fleet.ddi.orders import RobotOrder
from prefect_robomaker.tasks.fleet.ddi.received_reports import (
    CancelFeedback,
    OrderEnd,
    OrderFeedback,
    OrderFetched,
    RobotReport,
)
from prefect_robomaker.tasks.fleet.swu import Release, SigningKey, new_signing_key, wrap

from .conftest import server

pytestmark = [pytest.mark.deep, needs_swupdate]

PROGRAM = random.Random(1).randbytes(6_000_000)
BEGUN_BYTES = 4_000_000
"""More than the sockets on the way hold while the robot has read nothing: 1 MB fitted into them on a busy machine."""


def make_key() -> SigningKey:
    return new_signing_key("fleet", datetime.now(UTC), 30, secrets.token_bytes)


def bundle() -> BytesIO:
    """A `.tar.gz` with one program."""
    packed = BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz", compresslevel=1) as archive:
        member = tarfile.TarInfo("bin/program")
        member.size = len(PROGRAM)
        archive.addfile(member, BytesIO(PROGRAM))
    return packed


class Site:
    """A server with a door, and a robot in front of it, whose line can be cut."""

    def __init__(self, folder: Path, key: SigningKey) -> None:
        self.folder = folder
        self.key = key
        self.orders = table_of_robots("robot1")
        self.orders.expect(["robot1"])  # so that it polls every second
        self.heard: list[RobotReport] = []
        self.sink_error: Exception | None = None
        self.begun: list[int] = []
        self.flows = threading.Event()
        self.flows.set()
        self._files: dict[int, bytes] = {}
        self.door = RobotDoor(
            self.orders, read_part=self._read, sink=self._hear, clock=time.time, chance=random.Random(2).random
        )
        self.proxy: TcpProxy
        self.robot: SwupdateRobot

    def offer(self, action_id: int, key: SigningKey | None = None, hardware: str = "1.0") -> Path:
        """Offers a bundle; returns the program that is there once it is installed."""
        folder = self.folder / "versions" / str(action_id)
        release = Release("app", str(action_id), str(folder), (hardware,))
        target = BytesIO()
        wrap(bundle(), release, key or self.key, target)
        content = self._files[action_id] = target.getvalue()
        order = RobotOrder(
            action_id=action_id,
            robot="robot1",
            name="app",
            version=str(action_id),
            file_name="app.swu",
            size_bytes=len(content),
            sha256=hashlib.sha256(content).hexdigest(),
            sha1=hashlib.sha1(content, usedforsecurity=False).hexdigest(),
            md5=hashlib.md5(content, usedforsecurity=False).hexdigest(),
        )
        self.orders.offer(order)
        return folder / "bin" / "program"

    def wait_until_closed(self) -> OrderFeedback | CancelFeedback:
        """What closed the order that is open."""
        wait_for(lambda: not self.orders.open(), f"an answer; {self.robot.log.read_text()}")
        last = self.heard[-1]
        assert isinstance(last, OrderFeedback | CancelFeedback)
        return last

    def details(self) -> str:
        """All that the robot said, as text."""
        return "\n".join(
            line for each in self.heard if isinstance(each, OrderFeedback) for line in each.feedback.details
        )

    def slow_downloads(self) -> None:
        """Lets downloads trickle after `BEGUN_BYTES`; while nothing arrives at all, swupdate does not poll."""
        self.flows.clear()

    def wait_until_begun(self) -> None:
        """Waits until a download trickles."""
        wait_for(lambda: max(self.begun, default=0) >= BEGUN_BYTES, f"a download; {self.robot.log}")

    def _hear(self, report: RobotReport) -> None:
        if self.sink_error is not None:
            raise self.sink_error
        self.heard.append(report)

    def _read(self, order: RobotOrder, start: int, length: int) -> bytes:
        self.begun.append(start)
        if start >= BEGUN_BYTES:
            self.flows.wait(1)
        return self._files[order.action_id][start : start + length]


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    """A server with a door, and a robot in front of it."""
    site = Site(tmp_path, make_key())
    with (
        server(site.door) as port,
        tcp_proxy(port) as site.proxy,
        swupdate_robot("robot1", TOKEN, site.proxy.port, site.key.certificate_pem) as site.robot,
    ):
        yield site
        site.flows.set()
        site.proxy.cut()


def test_a_robot_installs_and_a_health_check_confirms(site: Site) -> None:
    for action_id in (7, 8):
        program = site.offer(action_id)
        site.robot.wait_until_installed()
        assert program.read_bytes() == PROGRAM
        assert list(site.orders.open()) == ["robot1"], "an installed version is not yet a healthy one"

        site.robot.confirm(action_id, is_healthy=action_id == 7)

        end = site.wait_until_closed()
        assert end.feedback.order_end is (OrderEnd.FINISHED if action_id == 7 else OrderEnd.FAILED)
    fetched = [each.action_id for each in site.heard if isinstance(each, OrderFetched)]
    assert fetched == [7, 8]


def test_a_confirmation_that_is_not_stored_can_be_said_again(site: Site) -> None:
    site.offer(8)
    site.robot.wait_until_installed()
    site.sink_error = OSError("no database")

    assert "NACK" in site.robot.confirm(8)
    assert list(site.orders.open()) == ["robot1"]

    site.sink_error = None
    site.robot.confirm(8)
    assert site.wait_until_closed().feedback.order_end is OrderEnd.FINISHED


def test_a_download_that_is_cut_is_resumed(site: Site) -> None:
    site.slow_downloads()
    program = site.offer(8)
    site.wait_until_begun()

    site.proxy.cut()
    site.flows.set()

    site.robot.wait_until_installed()
    assert program.read_bytes() == PROGRAM
    assert site.begun.count(0) == 1, "what was there is not sent again"
    site.robot.confirm(8)
    assert site.wait_until_closed().feedback.order_end is OrderEnd.FINISHED


@pytest.mark.parametrize("what", ["signature", "hardware"])
def test_what_is_not_meant_for_the_robot_is_refused(site: Site, what: str) -> None:
    offer: dict[str, Callable[[], Path]] = {
        "signature": lambda: site.offer(8, key=make_key()),
        "hardware": lambda: site.offer(8, hardware="2.0"),
    }

    program = offer[what]()

    assert site.wait_until_closed().feedback.order_end is OrderEnd.FAILED
    assert not program.exists()
    cause = {"signature": "ERROR : Authentication of all signatures failed", "hardware": "not compatible"}
    assert cause[what] in site.details(), "the message that closes the order does not say why"


def test_a_robot_gives_up_what_it_downloads_and_takes_the_next_order(site: Site) -> None:
    site.slow_downloads()
    given_up = site.offer(8)
    site.wait_until_begun()

    site.orders.cancel("robot1", 8)
    end = site.wait_until_closed()

    assert isinstance(end, CancelFeedback)
    assert end.feedback.cancel_end is OrderEnd.CANCELED
    assert not given_up.exists()
    site.flows.set()
    program = site.offer(9)
    site.robot.wait_until_installed()
    assert program.read_bytes() == PROGRAM
    assert not given_up.exists()
