import asyncio
import json
from collections.abc import Callable
from typing import Any

import pytest
from helpers.examples import examples
from helpers.processes import wait_for
from helpers.robot_orders import TOKEN, robot_order
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.deployments.fleet.robot_door.door import DoorSettings
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.fleet.ddi.received_reports import (
    Attributes,
    AttributesSent,
    CancelFeedback,
    Execution,
    Feedback,
    Finished,
    OrderEnd,
    OrderFeedback,
    OrderFetched,
    RobotsSeen,
)

from .conftest import BASE, NOW, Robots

ORDER = f"{BASE}/deploymentBase/8"
CANCEL = f"{BASE}/cancelAction/8"


def sleep_of(robots: Robots) -> str:
    return robots.poll().json["config"]["polling"]["sleep"]


def test_an_order_goes_from_offer_to_end(robots: Robots) -> None:
    assert set(robots.poll().links) == {"configData"}
    robots.orders.offer(robot_order())

    path = robots.poll().links["deploymentBase"]
    assert path == ORDER
    assert robots.ask("GET", path).json["id"] == "8"
    assert robots.ask("GET", path).status == 200
    assert robots.say(path, result={"finished": "none", "progress": {"cnt": 1, "of": 4}}).body == b""
    answer = robots.say(path, "closed", "success", details=["health ok"])

    assert (answer.status, answer.headers["content-type"]) == (200, "application/hal+json")
    assert set(robots.poll().links) == {"configData"}
    proceeding = Feedback(8, Execution.PROCEEDING, Finished.NONE, 1, 4)
    closed = Feedback(8, Execution.CLOSED, Finished.SUCCESS, details=("health ok",))
    assert robots.heard == [
        OrderFetched("robot1", 8, NOW),
        OrderFeedback("robot1", proceeding, NOW),
        OrderFeedback("robot1", closed, NOW),
    ]


@pytest.mark.parametrize(
    ("execution", "finished", "is_open"),
    [("closed", "failure", False), ("canceled", "none", False), ("rejected", "none", True), ("closed", "none", False)],
)
def test_an_order_that_has_ended_is_not_shown_again(
    robots: Robots, execution: str, finished: str, is_open: bool
) -> None:
    robots.orders.offer(robot_order())

    assert robots.say(ORDER, execution, finished).status == 200

    assert ("deploymentBase" in robots.poll().links) is is_open


def test_a_robot_gives_an_order_up(robots: Robots) -> None:
    robots.orders.offer(robot_order())
    robots.orders.cancel("robot1", 8)

    path = robots.poll().links["cancelAction"]
    assert path == CANCEL
    assert robots.ask("GET", path).json == {"id": "8", "cancelAction": {"stopId": "8"}}
    assert robots.ask("GET", ORDER).status == 404, "it is not to be carried out any more"
    assert robots.say(path, "closed", "success").status == 200

    assert "cancelAction" not in robots.poll().links
    (report,) = robots.heard
    assert isinstance(report, CancelFeedback)
    assert report.feedback.cancel_end is OrderEnd.CANCELED


def test_a_robot_may_keep_an_order_that_it_shall_give_up(robots: Robots) -> None:
    robots.orders.offer(robot_order())
    robots.orders.cancel("robot1", 8)

    assert robots.say(CANCEL, "rejected").status == 200
    robots.orders.carry_on("robot1", 8)
    assert list(robots.poll().links) == ["deploymentBase", "configData"]
    assert robots.say(ORDER, "closed", "success").status == 200

    assert robots.orders.open() == {}
    assert [type(report) for report in robots.heard] == [CancelFeedback, OrderFeedback]


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/DEFAULT/controller/v1/robot1/deploymentBase/9", 404),
        ("POST", f"{BASE}/deploymentBase/9/feedback", 404),
        ("POST", f"{BASE}/deploymentBase/5/feedback", 410),
        ("POST", f"{BASE}/cancelAction/8/feedback", 405),
        ("GET", CANCEL, 404),
        ("GET", f"{BASE}/cancelAction/5", 404),
        ("GET", f"{BASE}/deploymentBase/99999999999", 404),
        ("GET", f"{BASE}/deploymentBase/2147483648", 404),
        ("GET", f"{BASE}/deploymentBase/x", 404),
        ("GET", f"{BASE}/installedBase/8", 404),
        ("GET", f"{BASE}/softwaremodules/8/artifacts/other.swu", 404),
        ("GET", f"{BASE}/softwaremodules/9/artifacts/app.swu", 404),
        ("GET", "/OTHER/controller/v1/robot1", 404),
        ("GET", "/DEFAULT/controller/v2/robot1", 404),
        ("GET", "/DEFAULT/controller/v1/robot2", 401),
        ("GET", "/DEFAULT/controller/v1/", 404),
        ("POST", BASE, 405),
        ("PUT", ORDER, 405),
        ("GET", f"{ORDER}/feedback", 405),
        ("GET", f"{BASE}/configData", 405),
    ],
)
def test_what_is_refused_is_refused_as_hawkbit_does(robots: Robots, method: str, path: str, status: int) -> None:
    robots.orders.offer(robot_order(action_id=5))
    robots.orders.close("robot1", 5)
    robots.orders.offer(robot_order(action_id=8))
    body = b'{"status": {"execution": "closed", "result": {"finished": "success"}}}' if method == "POST" else b""

    answer = robots.ask(method, path, body)

    assert (answer.status, bool(answer.json["message"])) == (status, True)
    assert ("allow" in answer.headers) == (status == 405 and "cancelAction" not in path)
    assert robots.heard == []
    assert list(robots.orders.open()) == ["robot1"]


@pytest.mark.parametrize(
    "authorization", ["", "TargetToken wrong", f"Bearer {TOKEN}", f"GatewayToken {TOKEN}", "TargetToken", "ÿ"]
)
@pytest.mark.parametrize("path", ["", "/deploymentBase/8", "/softwaremodules/8/artifacts/app.swu"])
def test_without_its_token_a_robot_learns_nothing(robots: Robots, path: str, authorization: str) -> None:
    robots.orders.offer(robot_order())

    answer = robots.ask("GET", BASE + path, authorization=authorization)

    assert answer.status == 401
    assert b"8" not in answer.body
    assert robots.heard == []


def test_the_end_of_an_order_may_be_said_again_by_a_robot_that_saw_no_answer(robots: Robots) -> None:
    robots.orders.offer(robot_order())
    first = robots.say(ORDER, "closed", "success")

    assert first == robots.say(ORDER, "closed", "success")
    assert robots.say(ORDER, "closed", "failure").status == 410
    assert len(robots.heard) == 1


def test_an_order_stays_open_until_its_end_is_stored(robots: Robots) -> None:
    robots.orders.offer(robot_order())
    robots.sink_error = OSError("no database")

    answer = robots.say(ORDER, "closed", "success")
    assert (answer.status, answer.headers["retry-after"]) == (503, "5")
    assert "no database" not in answer.json["message"]
    assert robots.ask("GET", ORDER).status == 503
    assert list(robots.orders.open()) == ["robot1"]

    robots.sink_error = None
    assert robots.say(ORDER, "closed", "success").status == 200
    assert robots.orders.open() == {}


def test_progress_is_limited_and_the_end_is_always_taken(robots: Robots) -> None:
    robots.orders.offer(robot_order())

    answers = [robots.say(ORDER).status for _ in range(1001)]

    assert answers == [200] * 1000 + [429]
    assert len(robots.heard) == 1000
    assert robots.say(ORDER, "closed", "success").status == 200
    assert len(robots.heard) == 1001


@pytest.mark.parametrize(
    ("body", "headers", "status"),
    [
        (b"{", {}, 400),
        (b"x" * 65_537, {}, 413),
        ([b"x" * 40_000, b"x" * 40_000], {}, 413),
        (b"", {"content_length": "65537"}, 413),
        (b"", {"content_length": "9" * 50}, 413),
    ],
)
@pytest.mark.parametrize(("method", "path"), [("POST", f"{ORDER}/feedback"), ("PUT", f"{BASE}/configData")])
def test_bodies_that_are_wrong_or_too_long_are_refused(
    robots: Robots, method: str, path: str, body: bytes | list[bytes], headers: dict[str, str], status: int
) -> None:
    robots.orders.offer(robot_order())

    assert robots.ask(method, path, body, **headers).status == status
    assert robots.heard == []


def test_a_robot_says_what_it_is_and_is_not_asked_again(robots: Robots) -> None:
    path = robots.poll().links["configData"]

    assert robots.ask("PUT", path, b'{"mode": "merge", "data": {"hw": "demo"}}').status == 200

    assert robots.heard == [AttributesSent("robot1", Attributes("merge", {"hw": "demo"}), NOW)]
    assert robots.poll().links == {}


@pytest.mark.parametrize(("chance", "idle"), [(0.0, "00:00:27"), (0.5, "00:00:30"), (0.999999, "00:00:33")])
def test_robots_poll_apart_and_often_while_there_is_something_to_do(
    make_robots: Callable[..., Robots], chance: float, idle: str
) -> None:
    robots = make_robots(chance=chance)

    assert sleep_of(robots) == idle
    robots.orders.expect(["robot1"])
    assert sleep_of(robots) == "00:00:01"
    robots.orders.expect(["robot1"], is_expected=False)
    assert sleep_of(robots) == idle
    robots.orders.offer(robot_order())
    assert sleep_of(robots) == "00:00:01"
    robots.orders.close("robot1", 8)
    assert sleep_of(robots) == idle


def test_many_robots_with_orders_poll_less_often(make_robots: Callable[..., Robots]) -> None:
    robots = make_robots(chance=0.5, settings=DoorSettings(active_polls_per_s=250))
    robots.orders.offer(robot_order())

    for active, sleep in [(1, "00:00:01"), (1000, "00:00:04"), (100_000, "00:00:30")]:
        robots.orders.active = active
        assert sleep_of(robots) == sleep


def test_polls_are_reported_together(make_robots: Callable[..., Robots], monkeypatch: pytest.MonkeyPatch) -> None:
    robots = make_robots(settings=DoorSettings(last_seen_s=2.0))
    loop, now_s = robots.runner.get_loop(), [1000.0]
    monkeypatch.setattr(loop, "time", lambda: now_s[0])

    def heard() -> list[Any]:
        for _ in range(5):
            robots.runner.run(asyncio.sleep(0))
        return robots.heard

    for polls in (1, 2):
        for _ in range(polls):
            robots.poll()
        now_s[0] += 1.9
        assert heard() == []
        now_s[0] += 0.2
        wait_for(heard, "the report")
        assert robots.heard == [RobotsSeen({"robot1": NOW})]
        robots.heard.clear()


def test_polls_are_reported_when_the_server_ends(robots: Robots) -> None:
    robots.poll()

    robots.runner.run(robots.door.close())

    assert robots.heard == [RobotsSeen({"robot1": NOW})]


def test_links_lead_to_where_the_robot_asked_or_to_the_public_address(make_robots: Callable[..., Robots]) -> None:
    def link(settings: DoorSettings, **headers: str) -> str:
        prefix = f"/{settings.tenant}/controller/v1/robot1"
        answer = make_robots(settings=settings).ask("GET", prefix, **headers)
        return answer.json["_links"]["configData"]["href"]

    assert link(DoorSettings(), host="[::1]:80") == f"http://[::1]:80{BASE}/configData"
    proxied = DoorSettings(public_url="https://fleet.example.com/", tenant="mine")
    assert link(proxied) == "https://fleet.example.com/mine/controller/v1/robot1/configData"


@pytest.mark.parametrize("host", ["", "a b", 'x"', "a/b", "x@y", "a:b"])
def test_a_host_that_is_none_gets_into_no_link(robots: Robots, host: str) -> None:
    answer = robots.ask("GET", BASE, host=host)

    assert answer.status == 400
    assert "Host" in answer.json["message"]


@pytest.mark.parametrize(
    "settings",
    [
        DoorSettings(public_url="fleet.example.com"),
        DoorSettings(public_url="https://fleet.example.com/robots"),
        DoorSettings(public_url="ftp://fleet"),
        DoorSettings(tenant="a/b"),
        DoorSettings(tenant=""),
    ],
)
def test_addresses_that_cannot_be_are_refused(make_robots: Callable[..., Robots], settings: DoorSettings) -> None:
    with pytest.raises(ConfigurationError, match=r"tenant|public URL"):
        make_robots(settings=settings)


@examples(100)
@given(
    st.lists(
        st.sampled_from(["DEFAULT", "controller", "v1", "robot1", "deploymentBase", "8", "feedback", "..", "é", ""])
    ),
    st.sampled_from(["GET", "POST", "PUT", "HEAD", "DELETE"]),
    st.binary(max_size=30),
)
def test_every_request_has_an_answer(parts: list[str], method: str, body: bytes) -> None:
    robots = Robots()
    robots.orders.offer(robot_order())
    try:
        answer = robots.ask(method, "/" + "/".join(parts), body)
        assert answer.status in (200, 400, 401, 404, 405, 410)
    finally:
        robots.close()


def test_a_robot_that_hangs_up_while_it_speaks_is_not_heard(robots: Robots) -> None:
    robots.orders.offer(robot_order())
    messages = [{"type": "http.request", "body": b"{", "more_body": True}, {"type": "http.disconnect"}]

    async def receive() -> dict[str, Any]:
        return messages.pop(0)

    assert robots.send("POST", f"{ORDER}/feedback", receive) == []
    assert robots.heard == []


def test_an_order_that_ends_while_its_feedback_arrives_is_gone(robots: Robots) -> None:
    robots.orders.offer(robot_order())
    body = json.dumps({"status": {"execution": "proceeding", "result": {"finished": "none"}}}).encode()

    async def receive() -> dict[str, Any]:
        robots.orders.close("robot1", 8)
        return {"type": "http.request", "body": body}

    assert robots.send("POST", f"{ORDER}/feedback", receive)[0]["status"] == 410


def test_a_robot_that_is_taken_out_while_it_speaks_is_unknown(robots: Robots) -> None:
    robots.orders.offer(robot_order())

    async def receive() -> dict[str, Any]:
        robots.orders.expel("robot1")
        return {"type": "http.request", "body": b'{"status": {"execution": "closed", "result": {"finished": "none"}}}'}

    assert robots.send("POST", f"{ORDER}/feedback", receive)[0]["status"] == 404
