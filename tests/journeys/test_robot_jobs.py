"""Robots as users order them: the example's own specification, and the walker by its name."""

import json
import shutil
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY
from helpers.small_flat import BODY, ROLE

from prefect_robomaker.flows.pipelines import run_spec
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.tasks.nights.wanted_runs import WantedRun
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

EXAMPLE = REPOSITORY / "deployments" / "specs" / "examples" / "urdf_robot_bundle"
WALK = {
    "version": 1,
    "name": "walk",
    "steps": {
        "template": {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": BODY}},
        "worlds": {
            "operation": "CreateWorldGenerationJob",
            "input": {
                "template": "${{ template.arn }}",
                "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1},
                "seed": 3,
            },
        },
        "walk": {
            "operation": "CreateSimulationJob",
            "input": {
                "maxJobDurationInSeconds": 120,
                "iamRole": ROLE,
                "seed": 3,
                "robotApplications": [{"application": "walker", "launchConfig": {}}],
                "simulationApplications": [
                    {
                        "application": "indoor-navigation",
                        "launchConfig": {},
                        "worldConfigs": [{"world": "${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}"}],
                    }
                ],
            },
        },
    },
}


def verdicts(record: RunRecord) -> list[str | None]:
    return [job.verdict for job in record.jobs]


@pytest.mark.deep
@pytest.mark.usefixtures("prefect_server", "known_worlds")
def test_the_example_of_a_urdf_robot_runs_as_its_readme_says(
    service: Service, settings: Settings, tmp_path: Path
) -> None:
    bundle = tmp_path / "bundle"
    shutil.copytree(EXAMPLE / "my_rover", bundle / "my_rover", ignore=shutil.ignore_patterns("__pycache__"))
    pack_tar_gz(bundle, tmp_path / "rover.tar.gz")
    service.store.ensure_bucket("robomaker")
    service.store.put_file("robomaker", "applications/rover.tar.gz", tmp_path / "rover.tar.gz")
    spec = EXAMPLE / "rover.yaml"
    record = run_spec(WantedRun(load_spec(spec.read_text(), spec.name), str(spec)), settings, lambda _: None)
    assert verdicts(record) == ["PASS", "PASS"]


@pytest.mark.deep
@pytest.mark.usefixtures("prefect_server", "known_worlds")
def test_the_walker_is_a_robot_application_by_its_name(settings: Settings) -> None:
    record = run_spec(WantedRun(load_spec(json.dumps(WALK), "walk.yaml"), "walk.yaml"), settings, lambda _: None)
    assert verdicts(record) == ["PASS"]
