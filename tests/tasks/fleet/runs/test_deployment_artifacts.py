"""What people see of a deployment in Prefect: its waves with their robots, its end, and where its report is."""

import json
from typing import Any

from helpers.deployed_robots import Yard, bad, deployable, good
from prefect import flow
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import ArtifactFilter, ArtifactFilterKey

from prefect_robomaker.tasks.execution.prefect_artifacts import artifact_key
from prefect_robomaker.tasks.fleet.views.deployment_report import report_path
from prefect_robomaker.tasks.service.service import Service


def test_each_wave_has_a_table_of_its_robots_and_the_end_a_summary(prefect_server: str, service: Service) -> None:
    yard = Yard(service)
    for number in range(3):
        yard.robot(f"r{number}", bad if number == 2 else good)
    config = {"concurrentDeploymentPercentage": 67, "failureThresholdPercentage": 50}
    job = yard.fleets.deploy(yard.arn, deployable(yard.fleets, "X86_64"), deploymentConfig=config)["arn"]

    @flow(name="deploys")
    def deploys() -> None:
        yard.run(job)

    deploys()

    name = job.rpartition("/")[2]
    with get_client(sync_client=True) as client:

        def found(*words: str) -> Any:
            wanted = ArtifactFilter(key=ArtifactFilterKey(any_=[artifact_key(name, *words)]))
            (artifact,) = client.read_artifacts(artifact_filter=wanted)
            return artifact

        first, second, robots = (found(word) for word in ("wave-1", "wave-2", "robots"))
        summary = found("summary")
        runs = {client.read_task_run(each.task_run_id).name.rpartition("-")[0] for each in (first, second)}

    assert runs == {"wave-1-of-2", "wave-2-of-2"}
    rows = [json.loads(each.data) for each in (first, second, robots)]
    assert [[row["robot"] for row in some] for some in rows] == [["r0", "r1"], ["r2"], ["r2", "r0", "r1"]]
    assert rows[1][0]["failure code"] == "PreLaunchFileFailure"
    path = report_path(service.catalog.get(job), service)
    assert f"[{path}](file://{path})" in summary.data
    assert "2 succeeded, 1 failed" in summary.data
    assert "**r2** PreLaunchFileFailure" in summary.data
