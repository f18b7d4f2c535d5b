"""Generation jobs some of whose worlds cannot be had: how they end, and what they tell."""

import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

Generate = Callable[..., dict[str, Any]]


def children() -> set[int]:
    """Processes that any thread of this one has started."""
    found = set()
    for thread in Path("/proc/self/task").iterdir():
        with suppress(OSError):  # it has ended already
            found |= {int(child) for child in (thread / "children").read_text().split()}
    return found


def test_a_world_that_cannot_be_stored_makes_the_job_fail_in_part(service: Service, generate: Generate) -> None:
    first = generate(floorplans=2)["finishedWorldsSummary"]["succeededWorlds"]
    bundle = service.catalog.get(first[0]).document["bundle"]
    assert call("BatchDeleteWorlds", {"worlds": first}, service)["unprocessedWorlds"] == []
    service.store.put_bytes(bundle["bucket"], bundle["prefix"], b"an object where the bundle has to be")

    job = generate(floorplans=2, worldTags={"night": "2"})

    summary = job["finishedWorldsSummary"]
    assert (job["status"], summary["finishedCount"], len(summary["succeededWorlds"])) == ("PartialFailed", 2, 1)
    assert call("DescribeWorld", {"world": summary["succeededWorlds"][0]}, service)["tags"] == {"night": "2"}
    assert summary["failureSummary"]["totalFailureCount"] == 1
    failure = summary["failureSummary"]["failures"][0]
    assert (failure["failureCode"], failure["failureCount"]) == ("InternalServiceError", 1)
    assert failure["sampleFailureReason"].startswith("the world could not be stored: ")


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds the builders in Linux's /proc")
def test_builders_that_always_die_make_the_job_fail_with_their_end_as_the_reason(generate: Generate) -> None:
    before, over = children(), threading.Event()

    def kill() -> None:
        while not over.is_set():
            for pid in children() - before:
                with suppress(OSError):  # it has ended already
                    if b"worldforge.bundle.worker" in Path(f"/proc/{pid}/cmdline").read_bytes():
                        os.kill(pid, signal.SIGKILL)
            time.sleep(0.05)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        job = generate(floorplans=2)
    finally:
        over.set()
        killer.join()

    assert (job["status"], job["failureCode"]) == ("Failed", "AllWorldGenerationFailed")
    assert job["failureReason"] == "the process that built the world ended with code -9"
    summary = job["finishedWorldsSummary"]["failureSummary"]
    assert [(each["failureCode"], each["failureCount"]) for each in summary["failures"]] == [
        ("InternalServiceError", 2)
    ]
