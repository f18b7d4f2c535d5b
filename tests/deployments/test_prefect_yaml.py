"""prefect.yaml: what the documentation says about deployments, done for real."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from unittest import mock
from uuid import UUID

import pytest
from helpers.command_here import Command
from helpers.paths import REPOSITORY
from helpers.processes import process_worker, wait_for
from helpers.server_log import tracebacks
from helpers.small_flat import BODY, ROLE
from ruamel.yaml import YAML

from prefect_robomaker.deployments.blocks import RobomakerObjectStore
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

FILE = REPOSITORY / "deployments" / "prefect.yaml"
SPEC = {
    "version": 1,
    "name": "tiny",
    "steps": {
        "template": {"operation": "CreateWorldTemplate", "input": {"name": "two rooms", "templateBody": BODY}},
        "worlds": {
            "operation": "CreateWorldGenerationJob",
            "input": {
                "template": "${{ template.arn }}",
                "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1},
                "seed": 7,
            },
        },
        "drive": {
            "operation": "StartSimulationJobBatch",
            "input": {
                "createSimulationJobRequests": {
                    "forEach": "${{ worlds.finishedWorldsSummary.succeededWorlds }}",
                    "as": "world",
                    "value": {
                        "maxJobDurationInSeconds": 120,
                        "iamRole": ROLE,
                        "robotApplications": [{"application": "scout", "launchConfig": {}}],
                        "simulationApplications": [
                            {
                                "application": "indoor-navigation",
                                "launchConfig": {},
                                "worldConfigs": [{"world": "${{ world }}"}],
                            }
                        ],
                    },
                }
            },
        },
    },
}


def test_every_operation_has_a_deployment_that_leads_to_its_flow() -> None:
    declared = YAML(typ="safe").load(FILE)["deployments"]

    names = {entry["entrypoint"].rpartition(".")[2] for entry in declared}
    performers = {entry.perform_name for entry in registry().values() if entry.run_job}
    assert names == {*registry(), *performers}
    for entry in declared:
        module, _, name = entry["entrypoint"].rpartition(".")
        assert getattr(__import__(module, fromlist=[name]), name).name == name
    assert len({entry["name"] for entry in declared}) == len(declared), "each has a name of its own"


@pytest.mark.slow
@pytest.mark.deep
def test_deployments_run_on_a_process_worker(
    robomaker_at_server: Command, prefect_server: str, settings: Settings, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    environ = {
        "PREFECT_API_URL": prefect_server,
        "PREFECT_HOME": str(tmp_path / "prefect"),
        "PREFECT_WORKER_QUERY_SECONDS": "1",
        "ROBOMAKER_HOME": str(settings.home),
    }
    from prefect.exceptions import PrefectHTTPStatusError

    spec = tmp_path / "tiny.yaml"
    spec.write_text(json.dumps(SPEC))
    make_pool("robomaker")
    name = ("--name", "create-world-template")
    run_module(environ, elsewhere, "prefect", "--no-prompt", "deploy", *name, "--prefect-file", str(FILE))
    RobomakerObjectStore(address=str(tmp_path / "store")).save("of-the-block")
    block = ("--block", "robomaker-object-store/of-the-block")
    with mock.patch.dict(os.environ):  # variables that the command sets in its process
        deployed = robomaker_at_server("deploy", spec, "--pool", "robomaker", *block)
    assert deployed.code == 0, deployed.err
    spec.unlink()  # the deployment keeps it
    with pytest.raises(PrefectHTTPStatusError, match="name"):
        create_run("CreateWorldTemplate/create-world-template", {"name": 7, "templateBody": "{}"})

    with process_worker("robomaker", environ, tmp_path / "worker.log"):
        bad = {"name": "refused", "templateBody": '{"Bildings": []}'}
        runs = [create_run("CreateWorldTemplate/create-world-template", bad), create_run("RunPipeline/tiny", {})]
        refused, pipeline = (ended(run) for run in runs)

    log = (tmp_path / "worker.log").read_text()
    assert refused.type.value == "FAILED", log
    assert "InvalidParameterException" in refused.message
    assert "Bildings" in refused.message
    assert re.search(r"InvalidParameterException: .*Bildings", log)
    assert tracebacks(log) == []
    assert pipeline.type.value == "COMPLETED", f"{pipeline.message}\n{log}"
    assert pipeline.message.startswith("passed: 1 of 1 job passed")
    assert list((tmp_path / "store").rglob("recording.mcap")), "the worker set what the block says"
    the_catalog_has_what_the_runs_made(settings)
    the_pipeline_shows_artifacts(runs[1])


def make_pool(name: str) -> None:
    """Makes a pool of processes, as `prefect work-pool create` does."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.actions import WorkPoolCreate
    from prefect.workers.process import ProcessWorker

    template = ProcessWorker.get_default_base_job_template()
    with get_client(sync_client=True) as client:
        client.create_work_pool(WorkPoolCreate(name=name, type="process", base_job_template=template))


def run_module(environ: Mapping[str, str], folder: Path, *words: str) -> None:
    """Runs a module's command in a folder."""
    command = [sys.executable, "-m", *words]
    run = subprocess.run(
        command, env={**os.environ, **environ}, cwd=folder, capture_output=True, text=True, check=False, timeout=240
    )
    assert run.returncode == 0, run.stdout + run.stderr


def create_run(deployment: str, parameters: dict[str, Any]) -> UUID:
    """Has a deployment run as soon as a worker takes it."""
    from prefect.client.orchestration import get_client

    with get_client(sync_client=True) as client:
        found = client.read_deployment_by_name(deployment)
        return client.create_flow_run_from_deployment(found.id, parameters=parameters).id


def ended(run: UUID) -> Any:
    """The state a flow run ends with."""
    from prefect.client.orchestration import get_client

    with get_client(sync_client=True) as client:

        def final() -> Any:
            state = client.read_flow_run(run).state
            return state if state and state.is_final() else None

        return wait_for(final, f"the end of flow run {run}")


def the_catalog_has_what_the_runs_made(settings: Settings) -> None:
    service = Service.open(settings, {})
    assert len(call("ListWorlds", {}, service)["worldSummaries"]) == 1
    assert [entry.name for entry in service.catalog.list("world-template").resources] == ["two rooms"]
    (batch,) = service.catalog.list("simulation-job-batch").resources
    (job,) = service.catalog.list("simulation-job").resources
    assert (batch.status, job.status) == ("Completed", "Completed")


def the_pipeline_shows_artifacts(run: UUID) -> None:
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import (
        ArtifactFilter,
        ArtifactFilterFlowRunId,
        FlowRunFilter,
        FlowRunFilterParentFlowRunId,
    )

    with get_client(sync_client=True) as client:
        children = client.read_flow_runs(
            flow_run_filter=FlowRunFilter(parent_flow_run_id=FlowRunFilterParentFlowRunId(any_=[run]))
        )
        ids = [run, *(child.id for child in children)]
        found = client.read_artifacts(artifact_filter=ArtifactFilter(flow_run_id=ArtifactFilterFlowRunId(any_=ids)))
    shown: dict[str | None, Any] = {
        artifact.type: artifact.data for artifact in found if artifact.flow_run_id == run and artifact.key
    }
    assert "# tiny: passed" in shown["markdown"]
    (row,) = json.loads(shown["table"])
    assert (row["status"], row["verdict"]) == ("Completed", "PASS")
    assert shown["image"].startswith("data:image/png;base64,")
    progress = {child.name.split("-")[0]: child.id for child in children}
    assert set(progress) == {"generation", "batch"}
    bars = {artifact.flow_run_id: artifact.data for artifact in found if artifact.type == "progress"}
    assert bars == {progress["generation"]: 100.0, progress["batch"]: 100.0}
