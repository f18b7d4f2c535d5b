"""The environment of `docs/applications.md` runs in a generated world, judged by a requirement about its robot."""

import re
from pathlib import Path

from helpers.paths import REPOSITORY
from helpers.small_flat import BODY
from helpers.swing_fixtures import ROLE, SUITE, outputs_of

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worlds.keeping import keep_world

PAGE = REPOSITORY / "docs" / "applications.md"


def test_the_puck_of_the_page_circles_in_a_generated_world(service: Service, tmp_path: Path) -> None:
    (module,) = (text for text in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S) if "class Puck" in text)
    package = tmp_path / "archive" / "rolling"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(module)
    pack_tar_gz(package.parent, tmp_path / "rolling.tar.gz")
    service.store.ensure_bucket("applications")
    service.store.put_file("applications", "rolling.tar.gz", tmp_path / "rolling.tar.gz")
    source = {"sources": [{"s3Bucket": "applications", "s3Key": "rolling.tar.gz"}], "robotSoftwareSuite": SUITE}
    call("CreateRobotApplication", {"name": "circling", **source}, service)
    runtime = {"simulationSoftwareSuite": {"name": "SimulationRuntime"}}
    call("CreateSimulationApplication", {"name": "arena", **source, **runtime}, service)
    world = generate_world(WorldTemplateBody.model_validate({**BODY, "Version": "2"}), 1, 2)
    launch, act = ({"packageName": "rolling", "launchFile": f"make_{what}"} for what in ("environment", "agent"))
    worlds = [{"world": keep_world(world, "variation", {}, service).arn}]
    request = {
        "maxJobDurationInSeconds": 60,
        "iamRole": ROLE,
        "simulationApplications": [{"application": "arena", "launchConfig": launch, "worldConfigs": worlds}],
        "robotApplications": [{"application": "circling", "launchConfig": act}],
        "requirements": [{"kind": "no_collision", "name": "gentle", "max_force_N": 50}],
    }
    arn = call("CreateSimulationJob", request, service)["arn"]

    perform_job(arn, service)

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert job["status"] == "Completed", job
    result = RunResult.model_validate_json((outputs_of(service, job) / "result.json").read_bytes())
    assert (result.verdict, result.metrics["distance_m"] >= 0.5) == ("PASS", True)
    assert [(each.name, each.satisfied) for each in result.requirements] == [("gentle", True)]
