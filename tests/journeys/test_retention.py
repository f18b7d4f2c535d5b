"""Real nights, collected: what goes, what stays, and that what stays can be used."""

import json
from collections.abc import Callable
from datetime import timedelta
from typing import Any

import pytest
from helpers.small_flat import BODY, ROLE

from prefect_robomaker.flows.pipelines import run_spec
from prefect_robomaker.schemas.reports.retention import RetentionPolicy
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.tasks.inspection.replays import verify_run
from prefect_robomaker.tasks.inspection.reports import rebuild_report
from prefect_robomaker.tasks.nights.wanted_runs import WantedRun
from prefect_robomaker.tasks.retention.collection import collect, plan_collection
from prefect_robomaker.tasks.service.service import Service

NOW = timedelta(0)
DRIVE = {
    "maxJobDurationInSeconds": 120,
    "iamRole": ROLE,
    "seed": 3,
    "robotApplications": [{"application": "scout", "launchConfig": {}}],
    "simulationApplications": [
        {
            "application": "indoor-navigation",
            "launchConfig": {},
            "worldConfigs": [{"world": "${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}"}],
        }
    ],
}


def night(seed: int) -> dict[str, Any]:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    generation = {"template": "${{ template.arn }}", "worldCount": count, "seed": seed}
    export = {"worlds": ["${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}"], "iamRole": ROLE}
    return {
        "template": {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": BODY}},
        "worlds": {"operation": "CreateWorldGenerationJob", "input": generation},
        "jobs": {"operation": "StartSimulationJobBatch", "input": {"createSimulationJobRequests": [DRIVE]}},
        "export": {
            "operation": "CreateWorldExportJob",
            "input": {**export, "outputLocation": {"s3Bucket": "exports", "s3Prefix": "nightly"}},
        },
    }


@pytest.fixture
def run(settings: Settings, prefect_server: str) -> Callable[[int], RunRecord]:
    def start(seed: int) -> RunRecord:
        checked = load_spec(json.dumps({"version": 1, "name": "nightly", "steps": night(seed)}), "nightly.yaml")
        return run_spec(WantedRun(checked, "nightly.yaml"), settings, lambda _: None)

    return start


def stored(service: Service) -> set[str]:
    return {f"{bucket}/{info.key}" for bucket in ("robomaker", "exports") for info in service.store.list(bucket)}


@pytest.mark.deep
@pytest.mark.usefixtures("known_worlds")
def test_nights_are_collected(run: Callable[[int], RunRecord], service: Service) -> None:
    service.store.ensure_bucket("exports")
    first, second = run(7), run(8)
    assert [first.state, second.state] == ["succeeded", "succeeded"]
    both = stored(service)

    newest = RetentionPolicy(older_than=NOW, keep_runs=1, orphaned_worlds=True)
    planned = plan_collection(newest, service)
    assert stored(service) == both
    told = collect(newest, service)

    assert told.problems == []
    assert [(item.kind, item.action) for item in told.items] == [
        ("run", "remove"),
        ("run", "keep"),
        ("world", "remove"),
    ]
    assert [(item.id, item.size_bytes) for item in told.items] == [(item.id, item.size_bytes) for item in planned.items]
    left = stored(service)
    assert not first.run_dir.exists()
    assert first.jobs[0].label not in "".join(left)
    assert len(service.catalog.list("world").resources) == 1
    assert len([key for key in left if key.startswith("exports/")]) == 1
    assert sum(item.objects for item in told.removed if item.kind == "run") > len(both - left) - 20 > 0
    assert rebuild_report(second, service).success.passed == 1

    results = RetentionPolicy(older_than=NOW, keep_results=True, orphaned_worlds=True)
    assert collect(results, service).problems == []

    names = {key.rpartition("/")[2] for key in stored(service) if second.jobs[0].label in key}
    assert "recording.mcap" not in names
    assert names >= {"result.json", "provenance.json", "digest.bin", "manifest.json"}
    assert rebuild_report(second, service).success.passed == 1
    assert "more files were removed" in (second.run_dir / "report.html").read_text()
    assert len(service.catalog.list("world").resources) == 1, "the report names it"
    assert verify_run(str(second.jobs[0].arn), service).answer == "bit-identical"

    everything = RetentionPolicy(older_than=NOW, orphaned_worlds=True)
    assert collect(everything, service).problems == []
    assert stored(service) == set()
    assert service.catalog.list("world").resources == ()
    assert service.catalog.list("simulation-job").resources == ()
    assert not any((service.settings.home / name / "nightly").exists() for name in ("runs", "jobs"))
