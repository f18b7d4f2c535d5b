"""Generation jobs some of whose worlds cannot be had: how they end, and what they tell."""

import subprocess
from collections.abc import Callable
from typing import Any

import pytest

from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worlds.builders import WorldBuilders

Generate = Callable[..., dict[str, Any]]


@pytest.mark.usefixtures("known_worlds")
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


def test_builders_that_always_die_make_the_job_fail_with_their_end_as_the_reason(
    generate: Generate, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = WorldBuilders._start

    def start_and_kill(self: WorldBuilders) -> "subprocess.Popen[str]":
        process = start(self)
        process.kill()
        process.wait()
        return process

    monkeypatch.setattr(WorldBuilders, "_start", start_and_kill)

    job = generate(floorplans=2)

    assert (job["status"], job["failureCode"]) == ("Failed", "AllWorldGenerationFailed")
    assert job["failureReason"] == "the process that built the world ended with code -9"
    summary = job["finishedWorldsSummary"]["failureSummary"]
    assert [(each["failureCode"], each["failureCount"]) for each in summary["failures"]] == [
        ("InternalServiceError", 2)
    ]
