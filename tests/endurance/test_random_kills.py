"""A batch on two machines whose processes and servers are killed at random: nothing is lost, doubled or half-written.

`ROBOMAKER_KILLS_SEED` repeats a run. The long one is `pytest -m endurance`.
"""

import json
import os
import random
import re
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, LiteralString
from uuid import uuid4

import psycopg
import pytest
from helpers.kill_rounds import Actor, kill_at_random
from helpers.postgres_server import NEEDS_POSTGRESQL, PostgresServer
from helpers.processes import wait_for, working_below
from helpers.s3_server import MortalS3Server

from prefect_robomaker.deployments.prefect_server.local_server import ensure_server, server_status, stop_server
from prefect_robomaker.deployments.prefect_server.secret import auth_string
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

pytestmark = NEEDS_POSTGRESQL
KILLED = r"3 job workers died, one after the other|each of 3 attempts was killed"
NO_PROFILE = {"PREFECT_PROFILES_PATH": "/nowhere"}
ROLE = "arn:aws:iam::000000000000:role/test"
SWING = {"SLEEP_S": "0.005", "TIME_LIMIT_S": "20", "ROBOMAKER_CHECKPOINT_EVERY_S": "0.25"}


@pytest.fixture
def variables(postgres_database: str, mortal_s3: MortalS3Server) -> dict[str, str]:
    """What all machines share."""
    bucket = f"kills-{uuid4().hex[:8]}"
    return {"ROBOMAKER_CATALOG_URL": postgres_database, "ROBOMAKER_BUCKET": bucket, **mortal_s3.server.environ()}


@pytest.fixture
def service(variables: dict[str, str], tmp_path: Path) -> Iterator[Service]:
    """The service of the machine that runs the batch."""
    environ = {**variables, "ROBOMAKER_HOME": str(tmp_path / "laptop"), "ROBOMAKER_MAX_JOBS": "2"}
    service = Service.open(Settings.from_environment(environ), environ)
    yield service
    service.catalog.close()


class MortalPrefectServer:
    """A Prefect server of its own, that comes back at the address it had.

    Args:
        home: where it keeps its database.
    """

    def __init__(self, home: Path) -> None:
        self._settings = Settings.from_environment({"ROBOMAKER_HOME": str(home)})
        url = ensure_server(self._settings, NO_PROFILE)
        self.variables = {"PREFECT_API_URL": url, "PREFECT_API_AUTH_STRING": auth_string(self._settings)}

    def kill(self) -> None:
        """Kills it and starts it again."""
        pid = server_status(self._settings, NO_PROFILE).pid
        assert pid is not None
        with suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)
        assert ensure_server(self._settings, NO_PROFILE) == self.variables["PREFECT_API_URL"]

    def stop(self) -> None:
        """Ends it for good."""
        stop_server(self._settings)


@pytest.fixture
def mortal_prefect(tmp_path: Path) -> Iterator[MortalPrefectServer]:
    server = MortalPrefectServer(tmp_path / "prefect")
    yield server
    server.stop()


@pytest.fixture
def actors(
    variables: dict[str, str], tmp_path: Path, mortal_prefect: MortalPrefectServer, batch: str
) -> Iterator[dict[str, Actor]]:
    """The process that runs the batch, and two job workers with homes of their own."""
    made = {}
    for name, words in {"laptop": "perform", "first": "work", "second": "work"}.items():
        own = {"ROBOMAKER_HOME": str(tmp_path / name), "ROBOMAKER_MAX_JOBS": "1", "ROBOMAKER_BACKEND": "by-hand"}
        command = [sys.executable, "-m", "prefect_robomaker", words, batch]
        environ = {**variables, **own, **mortal_prefect.variables}
        made[name] = Actor(name, command, environ, tmp_path / f"{name}.log")
    yield made
    for actor in made.values():
        actor.end()


@pytest.fixture
def batch(service: Service, swing: Any, request: pytest.FixtureRequest) -> str:
    """ARN of a batch of jobs that all end in the same state."""
    launch = {"packageName": "swinger", "launchFile": "make_environment", "environmentVariables": SWING}
    push = {"packageName": "swinger", "launchFile": "make_agent"}
    job = {
        "maxJobDurationInSeconds": 600,
        "iamRole": ROLE,
        "seed": 3,
        "simulationApplications": [{"application": "swing", "launchConfig": launch}],
        "robotApplications": [{"application": "pusher", "launchConfig": push}],
    }
    jobs = request.param
    policy = {"maxConcurrency": 2}
    ordered = {"createSimulationJobRequests": [job] * jobs, "batchPolicy": policy}
    return call("StartSimulationJobBatch", ordered, service)["arn"]


def rows(url: str, query: LiteralString, *values: str) -> list[Any]:
    """Rows of the catalog's database, read without our code; it may be starting again."""
    with psycopg.connect(url.replace("postgresql+psycopg", "postgresql"), connect_timeout=5) as connection:
        return connection.execute(query, values).fetchall()


def has_ended(url: str, batch: str) -> bool:
    try:
        [[status]] = rows(url, "SELECT status FROM resources WHERE arn = %s", batch)
    except psycopg.OperationalError:
        return False
    return status in ("Completed", "Failed", "Canceled", "TimedOut")


def check_invariants(url: str, batch: str, jobs: int, s3: Any, bucket: str, most_failed: int) -> None:
    """Looks from outside at what is left of a batch that was killed at all ends.

    Chance may kill one job three times in a row before it comes further, and such a job fails with these words: at most
    `most_failed` may.
    """
    [[status, held]] = rows(url, "SELECT status, lease_owner FROM resources WHERE arn = %s", batch)
    assert (status, held) == ("Completed", None)
    query = "SELECT id, status, lease_owner, document FROM resources WHERE parent = %s AND kind = 'simulation-job'"
    made = rows(url, query, batch)
    assert sorted(document["requestIndex"] for _, _, _, document in made) == list(range(jobs)), "each request, once"
    failed = [document["failureReason"] for _, status, _, document in made if status == "Failed"]
    assert all(re.match(KILLED, reason) for reason in failed), failed
    assert len(failed) <= most_failed, "each of these was killed three times"
    whole = [(job, document) for job, status, _, document in made if status != "Failed"]
    ends = {(status, held, document.get("verdict")) for _, status, held, document in made if status != "Failed"}
    assert ends == {("Completed", None, "PASS")}
    digests = set()
    for job, document in whole:
        prefix = document["outputs"]["prefix"]
        manifest = json.load(s3.get_object(Bucket=bucket, Key=f"{prefix}/manifest.json")["Body"])
        for file in manifest["files"]:
            head = s3.head_object(Bucket=bucket, Key=f"{prefix}/{file['path']}")
            assert head["ContentLength"] == file["size_bytes"], f"{job}: {file['path']} is half-written"
        digests.add(json.load(s3.get_object(Bucket=bucket, Key=f"{prefix}/result.json")["Body"])["state_digest"])
    assert len(digests) == 1, "equal jobs end in the same state, whatever was killed meanwhile"


@pytest.mark.parametrize(
    ("batch", "kills"),
    [
        pytest.param(16, 25, marks=[pytest.mark.deep, pytest.mark.timeout(900)], id="a sample"),
        pytest.param(400, 500, marks=[pytest.mark.endurance, pytest.mark.timeout(14_400)], id="many"),
    ],
    indirect=["batch"],
)
def test_nothing_is_lost_doubled_or_half_written(
    batch: str,
    kills: int,
    actors: dict[str, Actor],
    variables: dict[str, str],
    postgres_server: PostgresServer,
    mortal_s3: MortalS3Server,
    mortal_prefect: MortalPrefectServer,
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:
    jobs = request.node.callspec.params["batch"]
    seed = int(os.environ.get("ROBOMAKER_KILLS_SEED") or random.SystemRandom().randrange(10**6))

    url = variables["ROBOMAKER_CATALOG_URL"]
    chance = random.Random(seed + 1)
    targets: dict[str, Callable[[], object]] = {
        "coordinator": actors["laptop"].kill,
        "job worker 1": actors["first"].kill,
        "job worker 2": actors["second"].kill,
        "a process below job worker 1": lambda: actors["first"].kill_one_below(chance),
        "a process below job worker 2": lambda: actors["second"].kill_one_below(chance),
        "PostgreSQL": lambda: (postgres_server.kill(), postgres_server.start()),
        "Prefect server": mortal_prefect.kill,
        "S3": lambda: (mortal_s3.kill(), mortal_s3.come_back()),
    }

    def keep() -> None:
        for actor in actors.values():
            actor.keep()

    def ended() -> bool:
        keep()
        return has_ended(url, batch)

    print(f"seed {seed}")
    killed = kill_at_random(seed, kills, targets, keep, lambda: has_ended(url, batch))
    wait_for(ended, "the batch to end", 1200)
    wait_for(lambda: all(actor.has_ended() for actor in actors.values()), "all processes to end by themselves", 120)
    print(f"seed {seed}: {sum(killed.values())} kills, {dict(killed)}")
    of_jobs = sum(times for name, times in killed.items() if "job worker" in name)
    s3 = mortal_s3.server.client("s3")
    check_invariants(url, batch, jobs, s3, variables["ROBOMAKER_BUCKET"], of_jobs // 3)
    homes = [tmp_path / name for name in actors]
    wait_for(lambda: not any(map(working_below, homes)), "simulations to die with their job workers")

    assert sum(killed.values()) >= min(kills, jobs) // 2, "else the batch has shown little"
