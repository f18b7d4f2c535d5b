"""The door behind a real server, over real connections."""

import http.client
import json
import random
from collections.abc import Iterator
from contextlib import closing

import pytest
from helpers.processes import wait_for
from helpers.robot_orders import TOKEN, robot_order

from prefect_robomaker.tasks.fleet.ddi.received_reports import RobotsSeen

from .conftest import BASE, Robots, server

CONTENT = random.Random(1).randbytes(1_000_000)
FILE = f"{BASE}/softwaremodules/8/artifacts/app.swu"


@pytest.fixture
def port(robots: Robots) -> Iterator[int]:
    """Where the door of `robots` is served; its robot has an order."""
    robots.content = CONTENT
    robots.orders.offer(robot_order(CONTENT))
    with server(robots.door) as port:
        yield port


def ask(port: int, method: str, path: str, body: str | None = None, **headers: str) -> tuple[int, bytes]:
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=200)) as connection:
        connection.request(method, path, body, {"Authorization": f"TargetToken {TOKEN}", **headers})
        answer = connection.getresponse()
        return answer.status, answer.read()


def test_an_order_is_carried_out_by_its_links(port: int, robots: Robots) -> None:
    def path_of(link: dict[str, str]) -> str:
        return link["href"].removeprefix(f"http://127.0.0.1:{port}")

    path = path_of(json.loads(ask(port, "GET", BASE)[1])["_links"]["deploymentBase"])
    (chunk,) = json.loads(ask(port, "GET", path)[1])["deployment"]["chunks"]
    file = path_of(chunk["artifacts"][0]["_links"]["download"])
    assert ask(port, "GET", file) == (200, CONTENT)
    assert ask(port, "GET", file, Range="bytes=600000-") == (206, CONTENT[600_000:])
    assert ask(port, "HEAD", file) == (200, b"")
    closed = json.dumps({"status": {"execution": "closed", "result": {"finished": "success"}}})
    assert ask(port, "POST", f"{path}/feedback", closed) == (200, b"")

    assert "deploymentBase" not in json.loads(ask(port, "GET", BASE)[1])["_links"]
    assert ask(port, "GET", file)[0] == 404


def test_a_connection_serves_several_requests(port: int) -> None:
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=200)) as connection:
        for token, status in [(TOKEN, 200), ("wrong", 401), (TOKEN, 200)]:
            connection.request("GET", FILE, headers={"Authorization": f"TargetToken {token}"})
            answer = connection.getresponse()
            assert (answer.status, len(answer.read()) > 10) == (status, True)


def test_a_file_that_became_another_does_not_arrive_whole(port: int, robots: Robots) -> None:
    robots.content = CONTENT[:600_000]

    with pytest.raises((http.client.IncompleteRead, ConnectionError)):
        ask(port, "GET", FILE)

    assert ask(port, "GET", BASE)[0] == 200


def test_polls_are_reported_when_the_server_stops(robots: Robots) -> None:
    with server(robots.door) as port:
        ask(port, "GET", BASE)

    wait_for(lambda: robots.heard, "the report")
    (report,) = robots.heard
    assert isinstance(report, RobotsSeen)
    assert set(report.last_seen_s) == {"robot1"}
