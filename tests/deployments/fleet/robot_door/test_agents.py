"""What agents are answered at the door besides orders."""

import hashlib
import json
from typing import Any

import pytest

from prefect_robomaker.deployments.fleet.robot_door.agents import GUESS_WINDOW_S, MOST_GUESSES, GuessLimit
from prefect_robomaker.deployments.fleet.robot_door.downloads import ServedFile
from prefect_robomaker.deployments.fleet.robot_door.robot_answers import DoorRefusal
from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError, ServiceUnavailableException, StorageError

from .conftest import BASE, Answer, Robots

SECRET = "a1" * 20
ENROLMENT = "/DEFAULT/agents/v1/robot1/enrolment"
CONTENT = bytes(range(256)) * 10
BODY = json.dumps({"tokenSha256": "0" * 64}).encode()


class Agents:
    """What the door asks."""

    error: Exception | None = None

    def __init__(self) -> None:
        self.asked: list[tuple[str, str, str]] = []

    def enrol(self, robot: str, secret: str, token_sha256: str) -> str | None:
        self.asked.append((robot, secret, token_sha256))
        if self.error is not None:
            raise self.error
        return '{"signed": {}}' if secret == SECRET else None

    def metadata(self, name: str) -> bytes:
        if self.error is not None:
            raise self.error
        if name != "1.root.json":
            raise ObjectNotFoundError(f"there is no {name}")
        return b'{"root": 1}'

    def target(self, path: str) -> ServedFile:
        if path != "applications/a/bundles/0.x":
            raise ObjectNotFoundError(f"there is no {path}")
        read = lambda start, length: CONTENT[start : start + length]  # noqa: E731
        return ServedFile("the target", len(CONTENT), hashlib.sha256(CONTENT).hexdigest(), read)


@pytest.fixture
def agents() -> Agents:
    return Agents()


@pytest.fixture
def robots(make_robots: Any, agents: Agents) -> Robots:
    return make_robots(agents=agents)


def enrol(robots: Robots, secret: str = SECRET, path: str = ENROLMENT, body: bytes = BODY) -> Answer:
    return robots.ask("POST", path, body, authorization=f"EnrolmentToken {secret}")


def test_an_agent_enrols_with_its_one_time_token(robots: Robots, agents: Agents) -> None:
    answer = enrol(robots)
    assert (answer.status, answer.json) == (200, {"root": '{"signed": {}}'})
    assert agents.asked == [("robot1", SECRET, "0" * 64)]


def test_wrong_tokens_are_refused_and_after_some_not_looked_at(robots: Robots, agents: Agents) -> None:
    for _ in range(MOST_GUESSES):
        assert enrol(robots, "0" * 40).status == 401
    refused = enrol(robots)
    assert (refused.status, refused.headers["retry-after"]) == (429, "60")
    assert len(agents.asked) == MOST_GUESSES
    assert enrol(robots, path="/DEFAULT/agents/v1/robot2/enrolment").status == 200, "each robot has its own"


def test_guesses_are_forgotten_after_a_while_and_names_do_not_pile_up() -> None:
    now = [0.0]
    limit = GuessLimit(lambda: now[0])
    for _ in range(MOST_GUESSES):
        limit.note_wrong("robot1")
    with pytest.raises(DoorRefusal):
        limit.check("robot1")
    now[0] = GUESS_WINDOW_S
    limit.check("robot1")
    for number in range(30_000):
        limit.note_wrong(f"made-up-{number}")
    assert len(limit._guesses) <= 10_000


@pytest.mark.parametrize("header", ["", "TargetToken " + SECRET, "EnrolmentToken short", "EnrolmentToken " + "ä" * 40])
def test_a_header_that_has_no_such_token_is_refused(robots: Robots, agents: Agents, header: str) -> None:
    answer = robots.ask("POST", ENROLMENT, BODY, authorization=header)
    assert (answer.status, agents.asked) == (401, [])
    assert answer.headers["www-authenticate"] == "EnrolmentToken"


@pytest.mark.parametrize("body", [b"", b"[]", b"{}", b'{"tokenSha256": 1}', b"\xff"])
def test_a_body_that_is_not_right_is_refused(robots: Robots, body: bytes) -> None:
    assert enrol(robots, body=body).status == 400


def test_what_cannot_be_stored_is_tried_again(robots: Robots, agents: Agents) -> None:
    agents.error = ServiceUnavailableException("the catalog is away")
    assert (enrol(robots).status, enrol(robots).headers["retry-after"]) == (503, "5")
    agents.error = StorageError("the store is away")
    assert enrol(robots).status == 503
    assert robots.ask("GET", f"{BASE}/repository/metadata/1.root.json").status == 503


def test_the_repository_is_for_robots_with_a_token(robots: Robots) -> None:
    answer = robots.ask("GET", f"{BASE}/repository/metadata/1.root.json")
    assert (answer.status, answer.body) == (200, b'{"root": 1}')
    target = f"{BASE}/repository/targets/applications/a/bundles/0.x"
    assert robots.ask("GET", target).body == CONTENT
    part = robots.ask("GET", target, range="bytes=1000-")
    assert (part.status, part.body) == (206, CONTENT[1000:])
    assert robots.ask("HEAD", target).headers["content-length"] == str(len(CONTENT))
    for path in ("repository/metadata/2.root.json", "repository/targets/applications/a/bundles/1.x", "repository/x"):
        assert robots.ask("GET", f"{BASE}/{path}").status == 404
    for path in (f"{BASE}/repository/metadata/1.root.json", target):
        assert robots.ask("GET", path, authorization="TargetToken wrong").status == 401
        assert robots.ask("POST", path).status == 405
    assert robots.ask("GET", ENROLMENT).status == 405


def test_a_door_without_agents_has_neither(make_robots: Any) -> None:
    robots = make_robots()
    assert enrol(robots).status == 404
    assert robots.ask("GET", f"{BASE}/repository/metadata/1.root.json").status == 404
