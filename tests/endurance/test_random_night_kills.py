"""Nights of Prefect workers whose processes are killed at random: each ends, or is named with the command for it.

`ROBOMAKER_KILLS` says how many kills there are, `ROBOMAKER_KILLS_SEED` repeats their order, and
`ROBOMAKER_KILLS_RECORD` names a file to which a line of JSON with commit, seed, kills and the ends of all nights is
added.
"""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest
from helpers.kill_rounds import Actor, kill_at_random
from helpers.mortal_prefect import MortalPrefectServer
from helpers.night_invariants import check_nights, flow_runs, unfinished_runs
from helpers.paths import BUNDLES, REPOSITORY
from helpers.processes import wait_for, working_below
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.actions import WorkPoolCreate
from prefect.exceptions import PrefectException

from prefect_robomaker.tasks.execution.schedule_overlaps import OVERLAP, RUNS_AT_ONCE

from .conftest import seed_of_the_run

ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
POOL = "nights"
JOBS = {"drive": 4, "after": 2}
DEPLOYMENTS = 2
"""Each has one night at a time, and another that waits for its place."""

LEASE_S = 330.0
"""How long a flow run keeps its place whose Prefect worker was killed as it began: Prefect's lease of 300 s.

Prefect leaves such a run `Pending` for ever; it has no process, no folder and no place then.
"""

LEFT_TO_PEOPLE = "so that it may be what kills them"


def night() -> str:
    """A night of two batches, the second of which follows the first."""
    request = {
        "maxJobDurationInSeconds": 300,
        "robotApplications": [{"application": "watcher", "launchConfig": {"launchFile": "make_agent"}}],
        "simulationApplications": [
            {
                "application": "room",
                "launchConfig": {"launchFile": "make_environment", "environmentVariables": {"DURATION_S": "2.0"}},
            }
        ],
    }
    suite = {"environment": {"uri": "python://sleeper"}, "robotSoftwareSuite": {"name": "General"}}
    room = {"name": "room", "simulationSoftwareSuite": {"name": "SimulationRuntime"}, **suite}
    made = {"room": {"operation": "CreateSimulationApplication", "input": room, "ifExists": "reuse"}}
    made["watcher"] = {
        "operation": "CreateRobotApplication",
        "input": {"name": "watcher", **suite},
        "ifExists": "reuse",
    }
    needs = list(made)
    for name, jobs in JOBS.items():
        batch = {"createSimulationJobRequests": [request] * jobs, "batchPolicy": {"maxConcurrency": 2}}
        made[name] = {"operation": "StartSimulationJobBatch", "needs": list(needs), "input": batch}
        needs.append(name)
    return json.dumps({"version": 1, "name": "night", "steps": made})


class Nights:
    """Deployments whose nights are ordered so that one of each always waits.

    Args:
        variables: How Prefect is found.
    """

    def __init__(self, variables: Mapping[str, str]) -> None:
        self.client = SyncPrefectClient(
            variables["PREFECT_API_URL"],
            auth_string=variables["PREFECT_API_AUTH_STRING"],
            httpx_settings={"timeout": 20},
        )
        self.client.create_work_pool(WorkPoolCreate(name=POOL, type="process"))
        flow = self.client.create_flow_from_name("RunPipeline")
        self.deployments = [
            self.client.create_deployment(
                flow_id=flow,
                name=f"night-{number}",
                work_pool_name=POOL,
                entrypoint="prefect_robomaker.flows.pipelines:RunPipeline",
                pull_steps=[],
                parameters={"text": night(), "origin": "night.yaml"},
                concurrency_limit=RUNS_AT_ONCE,
                concurrency_options=OVERLAP,
            )
            for number in range(DEPLOYMENTS)
        ]
        self._next_look_s = 0.0

    def order(self) -> None:
        """Orders nights where fewer than two are under way; a server that is away is asked later."""
        if time.monotonic() < self._next_look_s:
            return
        self._next_look_s = time.monotonic() + 5.0
        with suppress(httpx.HTTPError, PrefectException, RuntimeError):
            for deployment in self.deployments:
                if len(self.open_runs(deployment)) < 2:
                    self.client.create_flow_run_from_deployment(deployment)

    def open_runs(self, deployment: Any) -> list[Any]:
        """The flow runs of a deployment that have not ended, but for those that were lost before they began."""
        lost = datetime.now(UTC) - timedelta(seconds=LEASE_S)
        return [
            run
            for run in flow_runs(self.client, deployment)
            if run.state is None
            or not (run.state.is_final() or (run.state.is_pending() and run.state.timestamp < lost))
        ]

    def have_ended(self) -> bool:
        """Whether no flow run is open."""
        try:
            return not any(map(self.open_runs, self.deployments))
        except (httpx.HTTPError, PrefectException, RuntimeError):
            return False

    def states(self) -> Counter[str]:
        """How many flow runs ended in which state."""
        found = [run.state for deployment in self.deployments for run in flow_runs(self.client, deployment)]
        return Counter(f"flow run {state.type.value}" for state in found if state is not None)


@pytest.fixture
def environ(mortal_prefect: MortalPrefectServer, tmp_path: Path) -> dict[str, str]:
    """Variables of all processes."""
    return {
        **mortal_prefect.variables,
        "ROBOMAKER_HOME": str(tmp_path / "home"),
        "ROBOMAKER_MAX_JOBS": "2",
        "PREFECT_HOME": str(tmp_path / "prefect-clients"),
        "PREFECT_WORKER_QUERY_SECONDS": "1",
        "PYTHONPATH": str(BUNDLES / "sleeper"),
        "PYTHONDONTWRITEBYTECODE": "1",
        "CI": "true",
    }


@pytest.fixture
def night_actors(environ: dict[str, str], tmp_path: Path) -> Iterator[dict[str, Actor]]:
    """Two Prefect workers, and the service beside them."""
    worker = [sys.executable, "-m", "prefect", "worker", "start", "--pool", POOL, "--type", "process"]
    commands = {"first": worker, "second": worker, "serve": [*ROBOMAKER, "serve", "--port", "0"]}
    made = {name: Actor(name, words, environ, tmp_path / f"{name}.log") for name, words in commands.items()}
    yield made
    for actor in made.values():
        actor.end()
    for pid in processes_of(tmp_path / "home"):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def processes_of(home: Path) -> list[int]:
    """All processes that have a data home, also those that outlived what started them."""
    words = f"ROBOMAKER_HOME={home}".encode()
    found: list[int] = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            if words in path.read_bytes().split(b"\0"):
                found.append(int(path.parent.name))
    return sorted(found)


def left_to_people(environ: Mapping[str, str]) -> dict[str, str]:
    """The lines of `robomaker doctor` about runs that no process finishes by itself, by their names."""
    command = [*ROBOMAKER, "doctor", "-o", "json"]
    told = subprocess.run(command, env={**os.environ, **environ}, capture_output=True, text=True, timeout=300)
    found = [each for each in json.loads(told.stdout)["findings"] if each["subject"] == "broken-off runs"]
    remedies = "\n".join(each.get("remedy", "") for each in found)
    lines = [line for each in found for line in each["found"].splitlines() if LEFT_TO_PEOPLE in line]
    names = [line.partition(":")[0] for line in lines]
    assert all(f"robomaker perform {name}" in remedies for name in names), "each is named with its command"
    return dict(zip(names, lines, strict=True))


def finish(home: Path, nights: Nights, keep: Callable[[], None], environ: Mapping[str, str]) -> int:
    """Waits until all nights have ended, and types the commands that the doctor names.

    Returns:
        How many runs were left to people.
    """
    performed: set[str] = set()

    def is_over() -> bool:
        keep()
        if not unfinished_runs(home) and nights.have_ended():
            return True
        names = left_to_people(environ).keys() if unfinished_runs(home) else set[str]()
        for name in names - performed:
            performed.add(name)
            command = [*ROBOMAKER, "perform", name]
            done = subprocess.run(
                command, env={**os.environ, **environ}, capture_output=True, text=True, timeout=900, check=False
            )
            print(f"{name}: exit code {done.returncode}: {done.stderr[-300:]}")
        return False

    wait_for(is_over, "all nights to end", 1800)
    return len(performed)


@pytest.mark.parametrize(
    "kills",
    [
        pytest.param(15, marks=[pytest.mark.deep, pytest.mark.timeout(2700)], id="a sample"),
        pytest.param(500, marks=[pytest.mark.endurance, pytest.mark.timeout(14_400)], id="many"),
    ],
)
def test_each_night_ends_or_is_named(
    kills: int,
    environ: dict[str, str],
    night_actors: dict[str, Actor],
    mortal_prefect: MortalPrefectServer,
    tmp_path: Path,
) -> None:
    home = tmp_path / "home"
    kills = int(os.environ.get("ROBOMAKER_KILLS") or kills)
    seed = seed_of_the_run()
    chance = random.Random(seed + 1)
    nights = Nights(mortal_prefect.variables)

    def start() -> None:
        for actor in night_actors.values():
            actor.keep()

    def keep() -> None:
        start()
        nights.order()

    def kill_any() -> None:
        if found := processes_of(home):
            with suppress(ProcessLookupError):
                os.kill(chance.choice(found), signal.SIGKILL)

    targets: dict[str, Callable[[], object]] = {
        "Prefect worker 1": night_actors["first"].kill,
        "Prefect worker 2": night_actors["second"].kill,
        "a process below Prefect worker 1": lambda: night_actors["first"].kill_one_below(chance),
        "a process below Prefect worker 2": lambda: night_actors["second"].kill_one_below(chance),
        "serve": night_actors["serve"].kill,
        "a process below serve": lambda: night_actors["serve"].kill_one_below(chance),
        "any process of the data home": kill_any,
        "Prefect server": mortal_prefect.kill,
    }
    keep()
    wait_for(lambda: (home / "runs").is_dir(), "the first night", 600)
    # Longer than in a batch: each Prefect worker and each night takes some 10 s to begin.
    killed = kill_at_random(seed, kills, targets, keep, lambda: False, pause_s=(1.0, 8.0))
    left = finish(home, nights, start, environ)

    told = check_nights(home, JOBS)
    told.update(nights.states())
    for limit in nights.client.read_global_concurrency_limits(limit=200):
        assert not limit.active_slots, f"{limit.name} has a place that is not given back"
    wait_for(lambda: not working_below(home), "simulations to die with their job workers")
    commit = subprocess.run(
        ["git", "-C", str(REPOSITORY), "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    record = {
        "commit": commit.stdout.strip(),
        "seed": seed,
        "kills": dict(killed),
        "left_to_people": left,
        "ended": dict(told),
    }
    print(json.dumps(record))
    if path := os.environ.get("ROBOMAKER_KILLS_RECORD"):
        with Path(path).open("a") as file:
            file.write(json.dumps(record) + "\n")
    assert sum(killed.values()) == kills
    assert not told["night canceled"], "nobody cancelled one: a process that ended itself said so"
    assert told["night succeeded"], "else the nights have shown little"
