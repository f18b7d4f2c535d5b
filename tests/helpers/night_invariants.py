"""Checks of nights that were killed at all ends, seen without our own code: by SQL, files and Prefect's API."""

import json
import sqlite3
from collections import Counter
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.filters import DeploymentFilter, DeploymentFilterId
from prefect.client.schemas.objects import FlowRun

ENDED = ("Completed", "Failed", "Canceled", "TimedOut")
_PAGE = 200


def rows(home: Path, query: str, *values: str) -> list[Any]:
    """Rows of the catalog of a data home."""
    place = f"file:{home / 'catalog.db'}?mode=ro"
    with closing(sqlite3.connect(place, uri=True, timeout=60)) as database:
        return database.execute(query, values).fetchall()


def flow_runs(client: SyncPrefectClient, deployment: Any) -> list[FlowRun]:
    """All flow runs of a deployment: its nights, and those that continue one."""
    chosen = DeploymentFilter(id=DeploymentFilterId(any_=[deployment]))
    found: list[FlowRun] = []
    while page := client.read_flow_runs(deployment_filter=chosen, limit=_PAGE, offset=len(found)):
        found += page
    return found


def unfinished_runs(home: Path) -> set[str]:
    """Names of the folders of runs that have no record yet."""
    return {path.name for path in (home / "runs").iterdir() if path.is_dir() and not (path / "run.json").exists()}


def check_nights(home: Path, jobs_of_batches: Mapping[str, int]) -> Counter[str]:
    """Looks at all nights of a data home that have ended: nothing of them is lost, doubled or torn.

    Args:
        home: The data home; its object store is a folder.
        jobs_of_batches: How many jobs the batch of each step has.

    Returns:
        How many jobs ended in which state.
    """
    now_us = "cast(strftime('%s', 'now') as integer) * 1000000"
    held = rows(home, f"SELECT arn FROM resources WHERE lease_owner IS NOT NULL AND lease_expires_at > {now_us}")
    assert not held, "each lease is given back or has run out"
    batches = dict(rows(home, "SELECT arn, status FROM resources WHERE kind = 'simulation-job-batch'"))
    made: dict[str, list[tuple[str, str, dict[str, Any]]]] = {batch: [] for batch in batches}
    for arn, parent, status, document in rows(
        home, "SELECT arn, parent, status, document FROM resources WHERE kind = 'simulation-job'"
    ):
        made[parent].append((arn, status, json.loads(document)))
    told: Counter[str] = Counter()
    of_records: list[str] = []
    for path in (home / "runs").glob("*/run.json"):
        record = json.loads(path.read_text())
        told[f"night {record['state']}"] += 1
        for step in record["steps"]:
            if step["operation"] == "StartSimulationJobBatch" and "arn" in step:
                of_records.append(step["arn"])
                statuses = [status for _, status, _ in made[step["arn"]]]
                if batches[step["arn"]] == "Completed":
                    expected = jobs_of_batches[step["name"]]
                    indices = sorted(document["requestIndex"] for _, _, document in made[step["arn"]])
                    assert indices == list(range(expected)), f"{step}: each request has one job"
                assert set(statuses) <= set(ENDED), f"{step}: {statuses}"
        for leftover in ("order.json", "running.lock", "cancel"):
            assert not (path.parent / leftover).exists(), f"{path.parent}: {leftover} is left"
    assert sorted(of_records) == sorted(batches), "each batch is that of one step of one night"
    for job, status, document in (each for jobs in made.values() for each in jobs):
        told[status] += 1
        outputs = document.get("outputs")
        if status == "Completed":
            assert outputs, f"{job} is Completed and has no outputs"
            folder = home / "objects" / outputs["bucket"] / outputs["prefix"]
            for file in json.loads((folder / "manifest.json").read_text())["files"]:
                assert (folder / file["path"]).stat().st_size == file["size_bytes"], f"{job}: {file['path']} is torn"
        else:
            assert document.get("failureReason"), f"{job} is {status} and says no reason"
    return told
