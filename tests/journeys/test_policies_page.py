"""The page "Bring your policy" and the example that it names: what they show, executed."""

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from helpers.paths import REPOSITORY
from helpers.small_flat import ROLE

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.inputs.bundles import world_bundle
from prefect_robomaker.tasks.storage import pack_tar_gz

PAGE = (REPOSITORY / "docs" / "policies.md").read_text()
EXAMPLE = REPOSITORY / "deployments" / "specs" / "examples" / "policies"


def block(name: str) -> str:
    """The fenced block below a comment with a name."""
    (text,) = re.findall(rf"^<!-- {re.escape(name)} -->\n```\w+\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    return text


@pytest.fixture
def world(generate: Callable[..., dict[str, Any]], known_worlds: None) -> str:
    """ARN of a world."""
    (arn,) = generate()["finishedWorldsSummary"]["succeededWorlds"]
    return arn


def driven(request: dict[str, Any], world: str, service: Service) -> RunResult:
    """Runs a request of a specification in a world."""
    request["simulationApplications"][0]["worldConfigs"] = [{"world": world}]
    arn = call("CreateSimulationJob", {**request, "iamRole": ROLE}, service)["arn"]
    perform_job(arn, service)
    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert job["status"] == "Completed", job
    place = service.catalog.get(arn).document["outputs"]
    return RunResult.model_validate_json(service.store.get_bytes(place["bucket"], f"{place['prefix']}/result.json"))


@pytest.mark.deep
def test_the_policy_of_the_page_drives_and_the_environment_trains(
    service: Service, world: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (spec,) = [text for text in re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL) if "steps:" in text]
    assert block("turn_away.py") in (EXAMPLE / "turn_away.py").read_text()
    (tmp_path / "turn_away.py").write_text(block("turn_away.py"))
    monkeypatch.syspath_prepend(str(tmp_path))
    result = driven(yaml.safe_load(spec)["steps"]["drive"]["input"], world, service)
    assert result.metrics["distance_m"] > 1.0

    with service.activated():
        exec(block("train"), {"world": world})
    said = capsys.readouterr().out.splitlines()[-1].split()
    assert said[0] == "FAIL"
    assert float(said[1]) > 0.0


@pytest.mark.deep
def test_the_example_trains_a_network_and_drives_by_both_policies(service: Service, world: str, tmp_path: Path) -> None:
    bundle = shutil.copytree(EXAMPLE, tmp_path / "policies")
    folder = world_bundle(service.catalog.get(world, kind="world"), service)
    words = [sys.executable, "train.py", str(folder), "turn_away.onnx", "2"]
    trained = subprocess.run(words, cwd=bundle, capture_output=True, text=True)
    assert trained.returncode == 0, trained.stderr
    pack_tar_gz(bundle, tmp_path / "policies.tar.gz")
    service.store.ensure_bucket("robomaker")
    service.store.put_file("robomaker", "applications/policies.tar.gz", tmp_path / "policies.tar.gz")

    text = (EXAMPLE / "policies.yaml").read_text()
    assert load_spec(text, "policies.yaml").order
    steps = yaml.safe_load(text)["steps"]
    call("CreateRobotApplication", steps["mine"]["input"], service)
    requests = steps["drive"]["input"]["createSimulationJobRequests"]
    policies = requests["axes"]["policy"]["values"]
    results = [driven({**requests["value"], "policy": policy}, world, service) for policy in policies]
    assert results[0].metrics["distance_m"] > 1.0
    assert all(result.metrics["distance_m"] > 0.0 for result in results)
