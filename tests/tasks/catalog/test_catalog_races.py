"""Several processes and threads on one catalog."""

import json
import socket
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any

from prefect_robomaker.tasks.catalog import Catalog, NewResource

PROCESSES = 3
ROUNDS = 3
COUNTS = 10

# Each process does what it is told, line by line, when all are told. They are forks, which have to import nothing.
PROGRAM = """
import json, os, socket, sys
from datetime import UTC, datetime
from prefect_robomaker.schemas.wire.errors import RobomakerError
from prefect_robomaker.tasks.catalog import Catalog, ClientToken, Resource

children = []
for file in map(int, sys.argv[3:]):
    if child := os.fork():
        children.append(child)
    else:
        break
else:
    sys.exit(any([os.waitpid(child, 0)[1] for child in children]))

lines = socket.socket(fileno=file).makefile("rw", buffering=1)
lines.readline()
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
    for _ in range(int(sys.argv[2])):
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

print("open", file=lines)
for line in lines:
    name, argument = json.loads(line)
    try:
        answer = globals()[name](argument)
    except RobomakerError as error:
        answer = type(error).__name__
    print(json.dumps(answer), file=lines)
"""

Crowd = Callable[..., list[Any]]


@contextmanager
def crowd_of(url: str) -> Iterator[Crowd]:
    """Has all processes do the same at once, and returns their answers."""
    pairs = [socket.socketpair() for _ in range(PROCESSES)]
    theirs = [other.fileno() for _, other in pairs]
    words = [sys.executable, "-c", PROGRAM, url, str(COUNTS), *map(str, theirs)]
    with subprocess.Popen(words, pass_fds=theirs) as processes:
        for _, other in pairs:
            other.close()
        lines = [ours.makefile("rw", buffering=1) for ours, _ in pairs]

        def all_do(*command: Any) -> list[str]:
            for each in lines:
                each.write(json.dumps(command) + "\n")
            return [each.readline().strip() for each in lines]

        try:
            assert all_do("open") == ["open"] * PROCESSES  # a new catalog, made by all of them at once
            yield lambda *command: [json.loads(answer) for answer in all_do(*command)]
        finally:
            for each, (ours, _) in zip(lines, pairs, strict=True):
                each.close()
                ours.close()
    assert processes.returncode == 0


def test_of_many_processes_one_wins_and_no_change_is_lost_between_them_and_their_forks(
    url: str, make_resource: Callable[..., NewResource]
) -> None:
    with crowd_of(url) as crowd:
        catalog = Catalog.open(url, clock=lambda: datetime.now(UTC))
        for number in range(ROUNDS):
            assert len(set(crowd("create_with_token", number))) == 1

            outcomes = Counter(crowd("create_with_name", number))
            assert outcomes.pop("ResourceAlreadyExistsException") == PROCESSES - 1
            assert outcomes.total() == 1

            job = catalog.create(make_resource(number, kind="world-export-job", document={"n": 0}), token=None)
            starts = crowd("start", job.arn)
            assert starts.count("StateConflictError") == PROCESSES - 1
            assert catalog.get(job.arn).document["by"] in starts

            assert sorted(crowd("claim", job.arn)) == [False] * (PROCESSES - 1) + [True]
        assert len(catalog.list("simulation-job").resources) == 2 * ROUNDS

        counted = catalog.create(make_resource(99, kind="world", document={"n": 0}), token=None)
        crowd("count", counted.arn)
        assert crowd("fork_and_count", counted.arn) == [0] * PROCESSES
        assert catalog.get(counted.arn).document == {"n": 3 * COUNTS * PROCESSES}
        catalog.close()


def test_no_change_is_lost_between_threads(catalog: Catalog, make_resource: Callable[..., NewResource]) -> None:
    job = catalog.create(make_resource(1, document={"n": 0}), token=None)

    def count(_: int) -> None:
        catalog.update(job.arn, lambda document: {"n": document["n"] + 1})

    with ThreadPoolExecutor(10) as pool:
        list(pool.map(count, range(50)))

    assert catalog.get(job.arn).document == {"n": 50}
