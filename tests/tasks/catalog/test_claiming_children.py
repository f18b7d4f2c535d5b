"""Claiming the jobs of a batch: each once, never more than the batch says, however many ask at once."""

import threading
import time
from collections.abc import Callable
from typing import Any

from prefect_robomaker.tasks.catalog import Catalog

BATCH = "simulation-job-batch"
JOB = "simulation-job"


def make_batch(catalog: Catalog, make_resource: Any, jobs: int, concurrency: int) -> tuple[str, list[str]]:
    """A batch that is under way, with jobs that wait."""
    batch = catalog.create(make_resource(0, kind=BATCH), token=None).arn
    catalog.transition(batch, "start")
    catalog.update(batch, lambda document: {**document, "concurrency": concurrency})
    return batch, [catalog.create(make_resource(1 + n, parent=batch), token=None).arn for n in range(jobs)]


def claimer(catalog: Catalog, batch: str) -> Callable[[str], str | None]:
    """Claims a job of the batch for an owner."""
    places = ("InProgress", "Completing")
    return lambda owner: catalog.claim_child(
        batch, JOB, owner, 10, most="concurrency", parent_in=places, finishing="simulatedAt"
    )


def test_jobs_are_given_out_oldest_first_and_no_more_than_the_batch_says(
    catalog: Catalog, make_resource: Any, clock: Any
) -> None:
    batch, jobs = make_batch(catalog, make_resource, jobs=4, concurrency=2)
    claim = claimer(catalog, batch)

    assert [claim("a:1:x"), claim("b:1:x"), claim("c:1:x")] == [jobs[0], jobs[1], None]
    catalog.release(jobs[0], "a:1:x")
    assert claim("c:1:x") == jobs[0]

    clock.advance(20)  # all holders have died: theirs are free, and counted as lost
    assert [claim("d:1:x"), claim("d:1:y"), claim("d:1:z")] == [jobs[0], jobs[1], None]
    assert catalog.lost_workers(jobs[1]) == 1


def test_those_that_only_finish_are_counted_beside_the_others_as_many_as_may_run(
    catalog: Catalog, make_resource: Any
) -> None:
    batch, jobs = make_batch(catalog, make_resource, jobs=5, concurrency=1)
    claim = claimer(catalog, batch)

    def finish(job: str) -> None:
        catalog.update(job, lambda document: {**document, "simulatedAt": "2026-11-28T23:00:00+00:00"})

    assert [claim("a:1:x"), claim("b:1:x")] == [jobs[0], None]
    assert catalog.count_alive(batch, JOB, having="simulatedAt") == {}
    finish(jobs[0])
    assert [claim("b:1:x"), claim("c:1:x")] == [jobs[1], None]
    finish(jobs[1])
    assert claim("c:1:x") is None, "one may finish beside one that simulates, no more"
    assert sum(catalog.count_alive(batch, JOB, having="simulatedAt").values()) == 2
    catalog.update(jobs[0], lambda document: {**document, "simulatedAt": None})  # it is run again
    assert claim("c:1:x") is None
    catalog.release(jobs[0], "a:1:x")
    assert claim("c:1:x") == jobs[0]


def test_a_lower_number_is_followed_and_a_batch_that_stops_gives_out_none(catalog: Catalog, make_resource: Any) -> None:
    batch, jobs = make_batch(catalog, make_resource, jobs=3, concurrency=2)
    claim = claimer(catalog, batch)
    assert claim("a:1:x") == jobs[0]

    catalog.update(batch, lambda document: {**document, "concurrency": 1})
    assert claim("a:1:y") is None
    catalog.release(jobs[0], "a:1:x")
    assert claim("a:1:y") == jobs[0]

    catalog.update(batch, lambda document: {**document, "concurrency": 3})
    catalog.transition(batch, "cancel")
    assert claim("a:1:z") is None


def test_a_batch_that_names_no_number_gives_out_none(catalog: Catalog, make_resource: Any) -> None:
    batch = catalog.create(make_resource(0, kind=BATCH), token=None).arn
    catalog.transition(batch, "start")
    catalog.create(make_resource(1, parent=batch), token=None)

    assert claimer(catalog, batch)("a:1:x") is None


def test_many_workers_at_once_never_hold_more_than_allowed_and_no_job_twice(
    catalog: Catalog, make_resource: Any
) -> None:
    batch, jobs = make_batch(catalog, make_resource, jobs=12, concurrency=3)
    claim, held, lock = claimer(catalog, batch), [0], threading.Lock()
    most, given = [0], []

    def work(worker: int) -> None:
        for number in range(12):
            owner = f"w:{worker}:{number}"
            if (arn := claim(owner)) is None:
                continue
            with lock:
                held[0] += 1
                most[0] = max(most[0], held[0])
                given.append(arn)
            time.sleep(0.02)  # so that the others ask meanwhile
            for event in ("prepare", "start", "finish"):
                catalog.transition(arn, event, owner=owner)
            with lock:  # before it ends, since another may be claimed as soon as it has
                held[0] -= 1
            catalog.transition(arn, "complete", owner=owner)
            catalog.release(arn, owner)

    threads = [threading.Thread(target=work, args=(worker,)) for worker in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert most[0] <= 3
    assert sorted(given) == sorted(set(given))
    assert set(given) <= set(jobs)


def test_what_another_takes_by_its_arn_meanwhile_is_not_given_out(catalog: Catalog, make_resource: Any) -> None:
    batch, jobs = make_batch(catalog, make_resource, jobs=20, concurrency=20)
    claim = claimer(catalog, batch)

    for number, job in enumerate(jobs):
        both = threading.Barrier(2)
        by_arn: list[bool] = []

        def take(arn: str, worker: str, start: threading.Barrier, taken: list[bool]) -> None:
            start.wait()
            taken.append(catalog.claim(arn, worker, 10))

        thread = threading.Thread(target=take, args=(job, f"b:{number}:x", both, by_arn))
        thread.start()
        both.wait()
        given = claim(f"a:{number}:x")
        thread.join()

        assert (given == job) is not by_arn[0]
        if given not in (None, job):
            catalog.release(given, f"a:{number}:x")
