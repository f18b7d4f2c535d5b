"""A batch on two machines whose processes and servers are killed at random: nothing is lost, doubled or half-written.

`ROBOMAKER_KILLS_SEED` repeats a run. The long one is `pytest -m endurance`.
"""

import random
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.batch_invariants import check_invariants, has_ended
from helpers.kill_rounds import Actor, kill_at_random
from helpers.mortal_prefect import MortalPrefectServer
from helpers.postgres_server import NEEDS_POSTGRESQL, PostgresServer
from helpers.processes import wait_for, working_below
from helpers.s3_server import MortalS3Server

from .conftest import keep, seed_of_the_run, wait_for_the_end

pytestmark = NEEDS_POSTGRESQL


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
    postgres_database: str,
    bucket: str,
    postgres_server: PostgresServer,
    mortal_s3: MortalS3Server,
    mortal_prefect: MortalPrefectServer,
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:
    jobs = request.node.callspec.params["batch"]
    seed = seed_of_the_run()
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
    killed = kill_at_random(seed, kills, targets, lambda: keep(actors), lambda: has_ended(postgres_database, batch))
    wait_for_the_end(actors, postgres_database, batch)
    print(f"seed {seed}: {sum(killed.values())} kills, {dict(killed)}")
    of_jobs = sum(times for name, times in killed.items() if "job worker" in name)
    check_invariants(postgres_database, batch, jobs, mortal_s3.server.client("s3"), bucket, of_jobs // 3)
    homes = [tmp_path / name for name in actors]
    wait_for(lambda: not any(map(working_below, homes)), "simulations to die with their job workers")
    assert sum(killed.values()) >= min(kills, jobs) // 2, "else the batch has shown little"
