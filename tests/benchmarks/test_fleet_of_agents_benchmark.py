"""What a rollout to a hundred agents on this machine costs beyond the transfer and the launch, and where time goes.

Transfer is what the same files take, as many at a time, from a server that does nothing else to the same disk.
"""

import http.client
import os
import re
import secrets
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median

import pytest
from helpers.endpoint_process import Serve, Served
from helpers.fleet_calls import Fleets
from helpers.local_agents import LocalAgents, agent_as_on_robots, local_agents
from helpers.processes import descendants, started, wait_for
from helpers.tuf_repository import bundle

from prefect_robomaker.schemas.fleet.rollouts.rollout import RobotDeploymentState, Rollout
from prefect_robomaker.tasks.fleet.catalog_rollouts import Rollouts
from prefect_robomaker.tasks.fleet.fleet_records import enrollable
from prefect_robomaker.tasks.fleet.trust.enrolment_tokens import offer
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(1800)]

ROBOTS = int(os.environ.get("BENCHMARK_ROBOTS", "100"))
BUNDLE_BYTES = 10_000_000
HEALTH_S = 0.5
SHARE = 20
"""Per cent of the fleet that have orders at the same time."""

_CHUNK_BYTES = 1 << 18
OPTIONS = ("--health-s", str(HEALTH_S), "--stop-s", "2", "--longest-wait-s", "1", "--sandbox", "none")
DRIVES = "#!/bin/sh\nexec sleep 1000\n"


def _cpu_s(pids: Sequence[int]) -> float:
    """Processor time of processes, and of all below them that live or were waited for."""
    ticks = 0
    for each in {below for pid in pids for below in (pid, *descendants(pid))}:
        fields = Path(f"/proc/{each}/stat").read_text().rpartition(")")[2].split()
        ticks += sum(int(field) for field in fields[11:15])
    return ticks / os.sysconf("SC_CLK_TCK")


def _written_s(folder: Path, chunks: Callable[[], Iterable[bytes]]) -> float:
    """How long it takes to write as many bundles to the disk, as many at a time, from wherever they come."""

    def write(number: int) -> None:
        with (folder / f"copy-{number}").open("wb") as target:
            target.writelines(chunks())
            target.flush()
            os.fsync(target.fileno())

    began_s = time.monotonic()
    with ThreadPoolExecutor(max(1, ROBOTS * SHARE // 100)) as pool:
        list(pool.map(write, range(ROBOTS)))
    return time.monotonic() - began_s


def _copying_s(folder: Path) -> float:
    """How long it takes without a server in between."""
    content = secrets.token_bytes(BUNDLE_BYTES)
    return _written_s(folder, lambda: [content])


def _transfer_s(folder: Path) -> float:
    """How long it takes from a server that does nothing but send a file: Python's own."""
    (folder / "bundle").write_bytes(secrets.token_bytes(BUNDLE_BYTES))
    log = folder / "server.log"
    command = [sys.executable, "-u", "-m", "http.server", "0", "--bind", "127.0.0.1", "--directory", str(folder)]
    with log.open("w") as output, started(command, {}, stdout=output, stderr=output):
        found = wait_for(lambda: re.findall(r"port (\d+)", log.read_text()), "the bare server")

        def fetch() -> Iterator[bytes]:
            link = http.client.HTTPConnection("127.0.0.1", int(found[0]))
            link.request("GET", "/bundle")
            answer = link.getresponse()
            yield from iter(lambda: answer.read(_CHUNK_BYTES), b"")
            link.close()

        return _written_s(folder, fetch)


def _deployed(served: Served, fleets: Fleets, fleet: str, application: str) -> tuple[float, float, str]:
    """Deploys, and waits for the end; returns when it began, seconds, and the job's ARN."""
    launch = {"packageName": "courier", "launchFile": "drive"}
    config = {"concurrentDeploymentPercentage": SHARE}
    request = fleets.order(fleet, application, config={"launchConfig": launch}, deploymentConfig=config)
    began_at_s, began_s = time.time(), time.monotonic()
    job = served.call("CreateDeploymentJob", request)["arn"]
    while (status := fleets.service.catalog.get(job).status) not in ("Succeeded", "Failed"):
        time.sleep(0.2)
    assert status == "Succeeded", fleets.described(job)
    return began_at_s, time.monotonic() - began_s, job


def _parts(rollout: Rollout, began_s: float, took_s: float) -> dict[str, float]:
    """How long the job was in each part, and the median robot in each of its order, in seconds."""
    states = list(rollout.robots.values())
    step = lambda state, name: state.step_times.get(name, state.finished_s)  # noqa: E731
    parts = {
        "offered until fetched": lambda state: state.started_s - state.offered_s,
        "validated": lambda state: step(state, "DownloadingExtracting") - state.started_s,
        "downloaded": lambda state: step(state, "Launching") - step(state, "DownloadingExtracting"),
        "launched": lambda state: state.finished_s - step(state, "Launching"),
    }
    found = {name: median(part(state) for state in states) for name, part in parts.items()}
    moments = [(state.offered_s, state.started_s, state.finished_s) for state in states]
    offered_s, started_s, finished_s = ([moment or 0.0 for moment in each] for each in zip(*moments, strict=True))
    first_s, last_s = min(offered_s), max(finished_s)
    return {
        "until the first order": first_s - began_s,
        "until it was fetched": min(started_s) - first_s,
        "from the first order to the last end": last_s - first_s,
        "until the job had ended": began_s + took_s - last_s,
        **found,
        "its place was free": median(_idle(states)),
    }


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
        began_s, took_s, job = _deployed(served, fleets, fleet, application)
        used = [_cpu_s(robots) - before[0], _cpu_s(ours) - before[1]]
        copying_s, transfer_s = _copying_s(tmp_path), _transfer_s(tmp_path)
    stored = Rollouts(service.catalog).rollout(job)
    assert stored is not None
    launching_s = HEALTH_S * -(-100 // SHARE)
    cores = len(os.sched_getaffinity(0))
    rest_s = took_s - transfer_s - launching_s
    with capsys.disabled():
        print(
            f"\n{ROBOTS} agents, {BUNDLE_BYTES / 1e6:g} MB, {SHARE} % at a time: {took_s:.1f} s; of that "
            f"{transfer_s:.1f} s to fetch the files from a bare server ({copying_s:.1f} s to copy them without one), "
            f"{launching_s:.1f} s to watch launches; the rest is "
            f"{rest_s:.1f} s. CPU: agents {used[0]:.1f} s, server and worker {used[1]:.1f} s, on {cores} cores; "
            f"without that of the agents {rest_s - used[0] / cores:.1f} s"
        )
        for name, part_s in _parts(Rollout.of_json(dict(stored.rollout)), began_s, took_s).items():
            print(f"  {name}: {part_s:.2f} s")
