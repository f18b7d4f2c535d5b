"""Several processes and threads on one catalog."""

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from typing import Any

import pytest

from prefect_robomaker.tasks.catalog import Catalog, NewResource

PROCESSES = 3
ROUNDS = 10

# Each process does what it is told, line by line, when all are told.
PROGRAM = """
import json, os, sys
from datetime import UTC, datetime
from prefect_robomaker.schemas.wire.errors import RobomakerError
from prefect_robomaker.tasks.catalog import Catalog, ClientToken, Resource

sys.stdin.readline()
catalog = Catalog.open(sys.argv[1], clock=lambda: datetime.now(UTC))
me = str(os.getpid())

def new(number, **members):
    resource_id = f"sim-{number}-{me}"
    arn = f"arn:aws:robomaker:us-east-1:111122223333:simulation-job/{resource_id}"
    return Resource.new(arn=arn, kind="simulation-job", id=resource_id, status="Pending", **members)

def create_with_token(number):
    return catalog.create(new(number), token=ClientToken("CreateSimulationJob", f"t-{number}", "h")).arn

def create_with_name(number):
    return catalog.create(new(number, name=f"n-{number}"), token=None, unique_name=True).arn

def count(arn):
    for _ in range(25):
        catalog.update(arn, lambda document: {"n": document["n"] + 1})

def start(arn):
    return catalog.transition(arn, "start", document_changes={"by": me}).document["by"]

def claim(arn):
    return catalog.claim(arn, me, 60)

def fork_and_count(arn):
    child = os.fork()
    count(arn)
    if child == 0:
        os._exit(0)
    return os.waitpid(child, 0)[1]

print("open", flush=True)
for line in sys.stdin:
    name, argument = json.loads(line)
    try:
        answer = globals()[name](argument)
    except RobomakerError as error:
        answer = type(error).__name__
    print(json.dumps(answer), flush=True)
"""

Crowd = Callable[..., list[Any]]


@pytest.fixture
def shared_catalog(shared_url: str) -> Iterator[Catalog]:
    opened = Catalog.open(shared_url, clock=lambda: datetime.now(UTC))
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def crowd(shared_url: str) -> Iterator[Crowd]:
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", PROGRAM, shared_url],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        for _ in range(PROCESSES)
    ]

    def all_do(*command: Any) -> list[str]:
        for process in processes:
            assert process.stdin is not None
            process.stdin.write(json.dumps(command) + "\n")
        answers = []
        for process in processes:
            assert process.stdout is not None
            answers.append(process.stdout.readline().strip())
        return answers

    assert all_do("open") == ["open"] * PROCESSES  # a new catalog, made by all of them at once
    yield lambda *command: [json.loads(answer) for answer in all_do(*command)]
    for process in processes:
        process.communicate()
        assert process.returncode == 0


def test_of_many_processes_one_wins(
    crowd: Crowd, shared_catalog: Catalog, make_resource: Callable[..., NewResource]
) -> None:
    for number in range(ROUNDS):
        assert len(set(crowd("create_with_token", number))) == 1

        outcomes = Counter(crowd("create_with_name", number))
        assert outcomes.pop("ResourceAlreadyExistsException") == PROCESSES - 1
        assert outcomes.total() == 1

        job = shared_catalog.create(make_resource(number, kind="world-export-job", document={"n": 0}), token=None)
        starts = crowd("start", job.arn)
        assert starts.count("StateConflictError") == PROCESSES - 1
        assert shared_catalog.get(job.arn).document["by"] in starts

        assert sorted(crowd("claim", job.arn)) == [False] * (PROCESSES - 1) + [True]
    assert len(shared_catalog.list("simulation-job").resources) == 2 * ROUNDS


def test_no_change_is_lost_between_processes_and_their_forks(
    crowd: Crowd, shared_catalog: Catalog, make_resource: Callable[..., NewResource]
) -> None:
    job = shared_catalog.create(make_resource(99, kind="world", document={"n": 0}), token=None)

    crowd("count", job.arn)
    assert crowd("fork_and_count", job.arn) == [0] * PROCESSES

    assert shared_catalog.get(job.arn).document == {"n": 3 * 25 * PROCESSES}


def test_no_change_is_lost_between_threads(catalog: Catalog, make_resource: Callable[..., NewResource]) -> None:
    job = catalog.create(make_resource(1, document={"n": 0}), token=None)

    def count(_: int) -> None:
        catalog.update(job.arn, lambda document: {"n": document["n"] + 1})

    with ThreadPoolExecutor(20) as pool:
        list(pool.map(count, range(200)))

    assert catalog.get(job.arn).document == {"n": 200}
