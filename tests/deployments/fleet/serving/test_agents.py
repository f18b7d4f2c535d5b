"""Agents at `robomaker serve`: enrolled by one command, they get what their root vouches for."""

import hashlib
import json
import secrets
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from helpers.deployed_robots import deployable
from helpers.endpoint_here import ServeHere
from helpers.fleet_calls import Fleets
from helpers.polling_robot import PollingRobot, carried_out
from helpers.processes import wait_for
from tuf.api.exceptions import DownloadHTTPError
from tuf.ngclient import FetcherInterface, Updater

from prefect_robomaker.tasks.fleet.ddi.robot_tokens import hash_token
from prefect_robomaker.tasks.fleet.fleet_records import enrollable
from prefect_robomaker.tasks.fleet.trust.ceremonies import renew_root
from prefect_robomaker.tasks.fleet.trust.enrolment_tokens import offer
from prefect_robomaker.tasks.fleet.trust.publishing import publisher_of
from prefect_robomaker.tasks.service.service import Service

TOKEN = "0123456789abcdef" * 4


class Fetcher(FetcherInterface):
    """Asks with the robot's token."""

    def __init__(self, robot: PollingRobot) -> None:
        self._robot = robot

    def _fetch(self, url: str) -> Iterator[bytes]:
        try:
            yield self._robot.get(url)
        except urllib.error.HTTPError as error:
            raise DownloadHTTPError(str(error), error.code) from error


class Agent(PollingRobot):
    """A robot that trusts a root."""

    def enrol(self, one_time: str, token: str = TOKEN) -> bytes:
        """Shows its one-time token; returns the root, if it is the one that the token names."""
        secret, _, sha256 = one_time.partition("-")
        body = json.dumps({"tokenSha256": hash_token(token).hex()}).encode()
        url = f"{self.url}/DEFAULT/agents/v1/{self.name}/enrolment"
        headers = {"Authorization": f"EnrolmentToken {secret}", "Content-Type": "application/json"}
        with urllib.request.urlopen(urllib.request.Request(url, body, headers), timeout=200) as answer:
            root = json.loads(answer.read())["root"].encode()
        assert hashlib.sha256(root).hexdigest() == sha256
        return root

    def updater(self, folder: Path, root: bytes) -> Updater:
        repository = f"{self.base_url}/repository"
        folder.mkdir(exist_ok=True)
        return Updater(
            str(folder),
            f"{repository}/metadata/",
            str(folder),
            f"{repository}/targets/",
            Fetcher(self),
            bootstrap=root,
        )


def said(order: dict[str, Any]) -> dict[str, str]:
    """The metadata of an order's chunk."""
    (chunk,) = order["deployment"]["chunks"]
    return {each["key"]: each["value"] for each in chunk["metadata"]}


def test_an_agent_gets_what_its_root_vouches_for(serve_here: ServeHere, service: Service, tmp_path: Path) -> None:
    fleets = Fleets(service)
    fleet = fleets.fleet()
    fleets.robot("rover", fleet, tags={"board": "demo"})
    application = deployable(fleets, "X86_64")
    one_time = offer(enrollable("rover", service), service, secrets.token_bytes, rotate=False)
    renew_root(publisher_of(service), ["timestamp", "snapshot"], [], None)

    with serve_here() as served:
        agent = Agent(served.url, "rover", TOKEN)
        root = agent.enrol(one_time.text)
        assert agent.enrol(one_time.text) == root
        wait_for(lambda: agent.poll_status() == 200, "the agent to be let in")
        job = fleets.deploy(fleet, application)["arn"]
        with carried_out(job, service):
            order = agent.fetch_order()
            updater = agent.updater(tmp_path / "agent", root)
            target = updater.get_targetinfo(said(order)["robomaker.target"])
            assert target is not None
            document = json.loads(Path(updater.download_target(target)).read_bytes())
            assert json.loads(said(order)["robomaker.tags"]) == {"board": "demo"}
            assert (document["job"], document["launch"]["packageName"]) == (job, "my_robot")
            bundle = updater.get_targetinfo(document["bundles"]["X86_64"])
            assert bundle is not None
            folder, _, name = bundle.path.rpartition("/")
            address = f"{agent.base_url}/repository/targets/{folder}/{bundle.hashes['sha256']}.{name}"
            content = agent.get(address, Range="bytes=0-9") + agent.get(address, Range="bytes=10-")
            bundle.verify_length_and_hashes(content)
            assert content == service.store.get_bytes("apps", "X86_64.tar.gz")
            assert agent.say_of(order, "download", "none", "DownloadingExtracting") == 200
            assert agent.say_of(order, "proceeding", "none", "Launching") == 200
            wait_for(lambda: _step(fleets, job) == "Launching", "its step")
            assert agent.say_of(order, "closed", "success", "Finished") == 200
        assert fleets.described(job)["robotDeploymentSummary"][0]["status"] == "InSync"
        _guessed(agent)
    assert "Traceback" not in served.log.read_text()


def _step(fleets: Fleets, job: str) -> str | None:
    (robot,) = fleets.described(job)["robotDeploymentSummary"]
    return robot.get("progressDetail", {}).get("currentProgress")


def _guessed(agent: Agent) -> None:
    statuses = set()
    for _ in range(12):
        try:
            agent.enrol(f"{'0' * 40}-{'0' * 64}")
        except urllib.error.HTTPError as error:
            statuses.add(error.code)
    assert statuses == {401, 429}


def test_serve_signs_again_what_would_expire(serve_here: ServeHere, service: Service) -> None:
    Fleets(service).robot("rover")
    earlier = replace(service, clock=lambda: datetime.now(UTC) - timedelta(hours=7))
    offer(enrollable("rover", earlier), earlier, secrets.token_bytes, rotate=False)
    files = publisher_of(service).files

    def numbers() -> int:
        newest = files.newest_timestamp()
        return 0 if newest is None else newest[0]

    assert numbers() == 1
    with serve_here():
        wait_for(lambda: numbers() == 2, "the timestamp to be signed again")
