"""What a rollout to a hundred agents on this machine costs beyond the transfer and the launch, and where time goes."""

import os
import secrets
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median

import pytest
from helpers.endpoint_process import Serve, Served
from helpers.fleet_calls import Fleets
from helpers.local_agents import LocalAgents, agent_as_on_robots, local_agents
from helpers.processes import descendants, wait_for
from helpers.tuf_repository import bundle

from prefect_robomaker.schemas.rollouts.robots import RobotDeploymentState
from prefect_robomaker.schemas.rollouts.rollout import Rollout
from prefect_robomaker.tasks.fleet.known_robots import enrollable
from prefect_robomaker.tasks.fleet.trust.enrolment import offer
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(1800)]

ROBOTS = int(os.environ.get("BENCHMARK_ROBOTS", "100"))
BUNDLE_BYTES = 10_000_000
HEALTH_S = 0.5
SHARE = 20
"""Per cent of the fleet that have orders at the same time."""

OPTIONS = ("--health-s", str(HEALTH_S), "--stop-s", "2", "--longest-wait-s", "1", "--sandbox", "none")
DRIVES = "#!/bin/sh\nexec sleep 1000\n"


def _cpu_s(pids: Sequence[int]) -> float:
    """Processor time of processes, and of all below them that live or were waited for."""
    ticks = 0
    for each in {below for pid in pids for below in (pid, *descendants(pid))}:
        fields = Path(f"/proc/{each}/stat").read_text().rpartition(")")[2].split()
        ticks += sum(int(field) for field in fields[11:15])
    return ticks / os.sysconf("SC_CLK_TCK")


def _copying_s(folder: Path) -> float:
    """How long it takes to write as many bundles to the disk, as many at a time, without a server in between."""
    content = secrets.token_bytes(BUNDLE_BYTES)

    def copy(number: int) -> None:
        with (folder / f"copy-{number}").open("wb") as target:
            target.write(content)
            os.fsync(target.fileno())

    began_s = time.monotonic()
    with ThreadPoolExecutor(max(1, ROBOTS * SHARE // 100)) as pool:
        list(pool.map(copy, range(ROBOTS)))
    return time.monotonic() - began_s


def _deployed_s(served: Served, fleets: Fleets, fleet: str, application: str) -> tuple[float, str]:
    """Deploys, and waits for the end; returns seconds, and the job's ARN."""
    launch = {"packageName": "courier", "launchFile": "drive"}
    config = {"concurrentDeploymentPercentage": SHARE}
    request = fleets.order(fleet, application, config={"launchConfig": launch}, deploymentConfig=config)
    began_s = time.monotonic()
    job = served.call("CreateDeploymentJob", request)["arn"]
    while (status := fleets.service.catalog.get(job).status) not in ("Succeeded", "Failed"):
        time.sleep(0.2)
    assert status == "Succeeded", fleets.described(job)
    return time.monotonic() - began_s, job


def _parts(rollout: Rollout) -> dict[str, float]:
    """How long a robot was in each part of its order, the median, in seconds."""
    states = list(rollout.robots.values())
    step = lambda state, name: state.step_times.get(name, state.finished_s)  # noqa: E731
    parts = {
        "offered until fetched": lambda state: state.started_s - state.offered_s,
        "validated": lambda state: step(state, "DownloadingExtracting") - state.started_s,
        "downloaded": lambda state: step(state, "ExecutingPreLaunch") - step(state, "DownloadingExtracting"),
        "launched": lambda state: state.finished_s - step(state, "ExecutingPreLaunch"),
    }
    found = {name: median(part(state) for state in states) for name, part in parts.items()}
    return {**found, "its place was free": median(_idle(states))}


def _idle(states: Sequence[RobotDeploymentState]) -> list[float]:
    """How long after the end of a robot another one got its order; the n-th end frees the place of the n-th after."""
    at_once = max(1, ROBOTS * SHARE // 100)
    ends = sorted(state.finished_s or 0.0 for state in states)
    offers = sorted(state.offered_s or 0.0 for state in states)
    return [offer_s - end_s for end_s, offer_s in zip(ends, offers[at_once:], strict=False)] or [0.0]


def _enrol(agents: LocalAgents, fleets: Fleets, fleet: str, url: str) -> None:
    for number in range(ROBOTS):
        fleets.robot(f"r{number}", fleet)
        token = offer(enrollable(f"r{number}", fleets.service), fleets.service, secrets.token_bytes, rotate=False)
        agents.start(f"r{number}", token.text, url)
    seen = "sandbox none"
    wait_for(lambda: all(seen in agent.log.read_text() for agent in agents.agents.values()), "all agents", 300)


def test_a_rollout_to_a_hundred_agents(
    serve: Serve, service: Service, prefect_server: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleets = Fleets(service)
    fleet = fleets.fleet()
    service.store.ensure_bucket("apps")
    packed = bundle({"drive": DRIVES, "map": secrets.token_bytes(BUNDLE_BYTES)})
    service.store.put_bytes("apps", "1.tar.gz", packed)
    application = fleets.application("courier", sources=[{"s3Bucket": "apps", "s3Key": "1.tar.gz"}])
    with (
        serve(PREFECT_API_URL=prefect_server, ROBOMAKER_ROBOT_POLL_S="1") as served,
        local_agents(tmp_path / "robots", *OPTIONS, agent=agent_as_on_robots(tmp_path / "python")) as agents,
    ):
        served.wait_until_ready()
        _enrol(agents, fleets, fleet, served.url)
        robots, ours = [agent.process.pid for agent in agents.agents.values()], [served.process.pid]
        before = [_cpu_s(robots), _cpu_s(ours)]
        took_s, job = _deployed_s(served, fleets, fleet, application)
        used = [_cpu_s(robots) - before[0], _cpu_s(ours) - before[1]]
        copying_s = _copying_s(tmp_path)
    stored = service.catalog.rollout(job)
    assert stored is not None
    launching_s = HEALTH_S * -(-100 // SHARE)
    cores = len(os.sched_getaffinity(0))
    rest_s = took_s - copying_s - launching_s
    with capsys.disabled():
        print(
            f"\n{ROBOTS} agents, {BUNDLE_BYTES / 1e6:g} MB, {SHARE} % at a time: {took_s:.1f} s; of that "
            f"{copying_s:.1f} s to copy the files, {launching_s:.1f} s to watch launches; the rest is "
            f"{rest_s:.1f} s. CPU: agents {used[0]:.1f} s, server and worker {used[1]:.1f} s, on {cores} cores; "
            f"without that of the agents {rest_s - used[0] / cores:.1f} s"
        )
        for name, part_s in _parts(Rollout.of_json(dict(stored.rollout))).items():
            print(f"  {name}: {part_s:.2f} s")
