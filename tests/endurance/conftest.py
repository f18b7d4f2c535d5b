"""Batches on two machines that share a catalog on PostgreSQL, an S3 server and a Prefect server of the test's own."""

import os
import random
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from helpers.batch_invariants import has_ended
from helpers.kill_rounds import Actor
from helpers.mortal_prefect import MortalPrefectServer
from helpers.processes import wait_for
from helpers.s3_server import MortalS3Server

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

ROLE = "arn:aws:iam::000000000000:role/test"
SWING = {"SLEEP_S": "0.005", "TIME_LIMIT_S": "20", "ROBOMAKER_CHECKPOINT_EVERY_S": "0.25"}


@pytest.fixture
def bucket() -> str:
    """Where outputs go."""
    return f"endurance-{uuid4().hex[:8]}"


@pytest.fixture
def variables(postgres_database: str, mortal_s3: MortalS3Server, bucket: str) -> dict[str, str]:
    """What all machines share."""
    return {"ROBOMAKER_CATALOG_URL": postgres_database, "ROBOMAKER_BUCKET": bucket, **mortal_s3.server.environ()}


@pytest.fixture
def service(postgres_database: str, mortal_s3: MortalS3Server, bucket: str, tmp_path: Path) -> Iterator[Service]:
    """The service of the one who orders the batch, before anything goes wrong."""
    shared = {"ROBOMAKER_CATALOG_URL": postgres_database, "ROBOMAKER_BUCKET": bucket, **mortal_s3.server.environ()}
    environ = {**shared, "ROBOMAKER_HOME": str(tmp_path / "laptop"), "ROBOMAKER_MAX_JOBS": "2"}
    service = Service.open(Settings.from_environment(environ), environ)
    yield service
    service.catalog.close()


@pytest.fixture
def prefect_variables(mortal_prefect: MortalPrefectServer) -> dict[str, str]:
    """How the process that runs the batch finds Prefect."""
    return mortal_prefect.variables


@pytest.fixture
def actors(
    variables: dict[str, str], prefect_variables: dict[str, str], tmp_path: Path, batch: str
) -> Iterator[dict[str, Actor]]:
    """The process that runs the batch, and two job workers with homes of their own."""
    made = {}
    for name, words in {"laptop": "perform", "first": "work", "second": "work"}.items():
        own = {"ROBOMAKER_HOME": str(tmp_path / name), "ROBOMAKER_MAX_JOBS": "1", "ROBOMAKER_BACKEND": "by-hand"}
        command = [sys.executable, "-m", "prefect_robomaker", words, batch]
        environ = {**variables, **own, **prefect_variables}
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


def seed_of_the_run() -> int:
    """The seed that `ROBOMAKER_KILLS_SEED` names, else a new one; printed, so that a failure can be repeated."""
    seed = int(os.environ.get("ROBOMAKER_KILLS_SEED") or random.SystemRandom().randrange(10**6))
    print(f"seed {seed}")
    return seed


def keep(actors: Mapping[str, Actor]) -> None:
    """Starts what has ended."""
    for actor in actors.values():
        actor.keep()


def wait_for_the_end(actors: Mapping[str, Actor], url: str, batch: str) -> None:
    """Keeps all going until the batch has ended; then all end by themselves."""

    def ended() -> bool:
        keep(actors)
        return has_ended(url, batch)

    wait_for(ended, "the batch to end", 1200)
    wait_for(lambda: all(actor.has_ended() for actor in actors.values()), "all processes to end by themselves", 120)
