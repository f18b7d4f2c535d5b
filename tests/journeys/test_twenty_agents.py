"""Twenty agents at one server, with S3 and PostgreSQL behind it: four deployments, and what goes wrong on robots."""

import secrets
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from helpers.application_calls import Applications
from helpers.endpoint_process import Serve, Served
from helpers.fleet_calls import Fleets
from helpers.local_agents import NEEDS_COMPILER, LocalAgent, LocalAgents, local_agents
from helpers.machines_apart import NEEDS_NAMESPACES
from helpers.postgres_server import NEEDS_POSTGRESQL
from helpers.processes import wait_for
from helpers.s3_server import S3Server
from helpers.tcp_proxy import TcpProxy, tcp_proxy
from helpers.tuf_repository import bundle

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.fleet.fleet_records import enrollable
from prefect_robomaker.tasks.fleet.trust.enrolment_tokens import offer
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.deep, NEEDS_NAMESPACES, NEEDS_COMPILER, NEEDS_POSTGRESQL]

GOOD = tuple(f"good-{number}" for number in range(14))
TROUBLED = ("bad", "refusing", "full", "ahead", "behind", "cut")
ROBOTS = (*GOOD, *TROUBLED)
PATIENCE_S = 120.0
DISK_MB = 16
MAP_BYTES = 3_000_000
"""Of the second version: more than the full disk has free, and enough for a network to be cut meanwhile."""

DRIVES = "#!/bin/sh\nexec sleep 1000\n"
BREAKS = "#!/bin/sh\nexit 7\n"
BREAKS_ON_ONE = f'#!/bin/sh\n[ "$AWS_ROBOMAKER_ROBOT_TAG_KEY_role" = bad ] && exit 7\n{DRIVES.partition(chr(10))[2]}'
CONDITION = b"""#!/bin/sh
[ "$AWS_ROBOMAKER_ROBOT_TAG_KEY_role" != refusing ] || { echo the battery is low; exit 1; }
"""


@pytest.fixture
def environ(s3_server: S3Server, postgres_database: str) -> Mapping[str, str]:
    """What makes both servers the service's."""
    servers = {"ROBOMAKER_CATALOG_URL": postgres_database, **s3_server.environ()}
    return {**servers, "ROBOMAKER_BUCKET": f"home-{uuid4().hex[:12]}"}


@pytest.fixture
def settings(tmp_path: Path, environ: Mapping[str, str]) -> Settings:
    return Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "data"), **environ})


@pytest.fixture
def service(settings: Settings, environ: Mapping[str, str]) -> Iterator[Service]:
    service = Service.open(settings, environ)
    yield service
    service.catalog.close()


class Site:
    """A fleet of twenty agents, and an application that gets one version after the other."""

    def __init__(self, served: Served, service: Service) -> None:
        self.served, self.service, self.fleets = served, service, Fleets(service)
        self.bucket = f"apps-{uuid4().hex[:12]}"
        self.fleet = self.fleets.fleet()
        self.application = ""
        self.number = 0

    def enrol(self, name: str, agents: LocalAgents, url: str) -> LocalAgent:
        self.fleets.robot(name, self.fleet, tags={"role": name})
        token = offer(enrollable(name, self.service), self.service, secrets.token_bytes, rotate=False)
        disk_mb = DISK_MB if name in TROUBLED else None
        return agents.start(name, token.text, url, disk_mb=disk_mb, has_clock=name in ("ahead", "behind"))

    def deploy(self, program: str, files: Mapping[str, bytes] | None = None, **config: Any) -> str:
        """Makes the next version of the application, and deploys it."""
        self.number += 1
        store, key = self.service.store, f"{self.number}.tar.gz"
        store.ensure_bucket(self.bucket)
        store.put_bytes(self.bucket, key, bundle({"drive": program, **(files or {})}))
        sources, applications = [{"s3Bucket": self.bucket, "s3Key": key}], Applications.of("Robot", self.service)
        if self.application:
            applications.update(self.application, sources=sources)
        else:
            self.application = applications.create("courier", sources=sources)["arn"]
        applications.version(self.application)
        launch = {"packageName": "courier", "launchFile": "drive"}
        version = {"applicationVersion": str(self.number), "launchConfig": launch}
        request = self.fleets.order(
            self.fleet, self.application, f"job-{self.number}", config=version, deploymentConfig=config
        )
        return self.served.call("CreateDeploymentJob", request)["arn"]

    def described(self, job: str) -> dict[str, Any]:
        return self.served.call("DescribeDeploymentJob", {"job": job})

    def ended(self, job: str) -> dict[str, Any]:
        statuses = ("Succeeded", "Failed", "Canceled")
        wait_for(lambda: self.described(job)["status"] in statuses, self.served.log.read_text(), PATIENCE_S)
        return self.described(job)


def by_robot(job: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """How each robot stands, by its name."""
    return {robot["arn"].split("/")[1]: robot for robot in job["robotDeploymentSummary"]}


def failed(job: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    """Code and reason of the robots that failed."""
    robots = by_robot(job).items()
    return {name: (each["failureCode"], each["failureReason"]) for name, each in robots if each["status"] == "Failed"}


def cut_for_a_while(site: Site, job: str, proxy: TcpProxy, agent: LocalAgent) -> None:
    """Cuts a robot's network in the middle of its download, until its agent has noticed."""
    downloading = lambda: by_robot(site.described(job))["cut"].get("progressDetail", {}).get("percentDone", 0)  # noqa: E731
    wait_for(lambda: 5 < downloading() < 95, "the download", PATIENCE_S)
    proxy.silence()
    proxy.cut()
    wait_for(lambda: "the download has to wait" in agent.log.read_text(), "the agent to notice", PATIENCE_S)
    proxy.restore()


@pytest.mark.endurance
@pytest.mark.timeout(900)
def test_twenty_agents_through_good_and_bad_days(
    serve: Serve, service: Service, environ: Mapping[str, str], prefect_server: str, tmp_path: Path
) -> None:
    with ExitStack() as stack:
        served = stack.enter_context(serve(PREFECT_API_URL=prefect_server, ROBOMAKER_ROBOT_POLL_S="1", **environ))
        agents = stack.enter_context(local_agents(tmp_path / "robots"))
        proxy = stack.enter_context(tcp_proxy(int(served.url.rpartition(":")[2])))
        site = Site(served, service)
        for name in ROBOTS:
            site.enrol(name, agents, f"http://127.0.0.1:{proxy.port}" if name == "cut" else served.url)
        robots = agents.agents

        _normal_rollout(site, agents)
        robots["full"].fill_disk(free_bytes=1_000_000)
        robots["ahead"].set_clock(3)
        robots["behind"].set_clock(-400)
        _a_day_with_troubles(site, agents, proxy)
        after = agents.versions()
        _a_version_that_breaks_everywhere(site)
        wait_for(lambda: agents.versions() == after, "all to have gone back", PATIENCE_S)
        robots["full"].free_disk()
        robots["ahead"].set_clock(0)
        _all_are_well_again(site, agents)
    assert "Traceback" not in served.log.read_text()


def _normal_rollout(site: Site, agents: LocalAgents) -> None:
    job = site.ended(site.deploy(DRIVES, concurrentDeploymentPercentage=50))
    assert (job["status"], failed(job)) == ("Succeeded", {})
    assert {robot["status"] for robot in job["robotDeploymentSummary"]} == {"InSync"}
    assert agents.versions() == dict.fromkeys(ROBOTS, "1")


def _a_day_with_troubles(site: Site, agents: LocalAgents, proxy: TcpProxy) -> None:
    site.service.store.put_bytes(site.bucket, "condition", CONDITION)
    proxy.slow(0.1)
    job = site.deploy(
        BREAKS_ON_ONE,
        {"map": secrets.token_bytes(MAP_BYTES)},
        concurrentDeploymentPercentage=100,
        failureThresholdPercentage=50,
        downloadConditionFile={"bucket": site.bucket, "key": "condition"},
    )
    cut_for_a_while(site, job, proxy, agents.agents["cut"])
    ended = site.ended(job)
    reasons = failed(ended)
    assert ended["status"] == "Succeeded"
    assert {name: code for name, (code, _) in reasons.items()} == {
        "bad": "RobotDeploymentAborted",
        "refusing": "DownloadConditionFailed",
        "full": "EnvironmentSetupError",
        "ahead": "RobotDeploymentAborted",
    }
    assert "the robot went back to version 1" in reasons["bad"][1]
    assert "the battery is low" in reasons["refusing"][1]
    assert "the disk is full" in reasons["full"][1]
    assert "ExpiredMetadataError" in reasons["ahead"][1]
    assert agents.versions() == {name: "1" if name in reasons else "2" for name in ROBOTS}


def _a_version_that_breaks_everywhere(site: Site) -> None:
    job = site.ended(site.deploy(BREAKS, concurrentDeploymentPercentage=20, failureThresholdPercentage=20))
    assert (job["status"], job["failureCode"]) == ("Failed", "FailureThresholdBreached")
    assert 4 <= len(failed(job)) <= 7, "the threshold, and those that had begun"


def _all_are_well_again(site: Site, agents: LocalAgents) -> None:
    job = site.ended(site.deploy(DRIVES, concurrentDeploymentPercentage=50))
    assert (job["status"], failed(job)) == ("Succeeded", {})
    assert agents.versions() == dict.fromkeys(ROBOTS, "4")
    assert all(agent.runs for agent in agents.agents.values())
