"""fsck: what it says, and with which exit code."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

RUN = "2026-01-02T03-04-05-000000Z"


@pytest.fixture
def job(service: Service, order: Callable[..., dict[str, Any]], simulate: Callable[..., dict[str, Any]]) -> str:
    return simulate(order())["arn"]


def test_what_is_whole_is_said_in_two_lines(robomaker: Any, job: str) -> None:
    told = robomaker("fsck", "--read-content")

    assert told.code == 0
    checked, agree = told.out.splitlines()
    assert checked.startswith("Checked ")
    assert checked.endswith("content compared.")
    assert agree == "Catalog and object store agree."


@pytest.mark.deep
def test_a_lost_file_is_told_with_what_brings_it_back(robomaker: Any, job: str, service: Service) -> None:
    place = service.catalog.get(job).document["outputs"]
    service.store.delete(place["bucket"], f"{place['prefix']}/result.json")

    told = robomaker("fsck")

    assert told.code == 3
    first, of, what, remedy, *_, last = told.out.splitlines()
    assert first == f"missing: {service.store.uri(place['bucket'], place['prefix'] + '/result.json')}"
    assert of == f"  of simulation-job/{job.rpartition('/')[2]}"
    assert "bytes were stored" in what
    assert remedy == "  restore the bucket from a backup, or run the job again"
    assert last == "1 problem is left: 1 missing; 1 of them only a backup or another run brings back."
    [finding] = json.loads(robomaker("fsck", "-o", "json").out)["findings"]
    assert (finding["problem"], finding["mended"]) == ("missing", False)


def test_outputs_that_are_here_only_are_stored(
    robomaker: Any, service: Service, order: Callable[..., dict[str, Any]]
) -> None:
    arn = call("CreateSimulationJob", order(), service)["arn"]
    service.catalog.transition(arn, "prepare", document_changes={"runId": RUN})
    service.catalog.transition(arn, "start")
    changes = {"ending": {"status": "Completed", "simulationTimeMillis": 1200}, "finished": True}
    service.catalog.transition(arn, "finish", document_changes=changes)
    full = {"failureCode": "InternalServiceError", "failureReason": "outputs could not be stored: no space left"}
    service.catalog.transition(arn, "fail", document_changes=full)
    output: Path = service.folder("jobs", arn.rpartition("/")[2], RUN, "output")
    (output / "result.json").write_text("{}")

    told, mended, again = robomaker("fsck"), robomaker("fsck", "--mend"), robomaker("fsck")

    assert (told.code, mended.code, again.code) == (3, 0, 0)
    assert told.out.startswith(f"only here: {output}")
    assert mended.out.splitlines()[-1] == "Mended 1. Catalog and object store agree."
    place = service.catalog.get(arn).document["outputs"]
    assert service.store.get_bytes(place["bucket"], f"{place['prefix']}/result.json") == b"{}"
