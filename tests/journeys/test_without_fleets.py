"""An installation without the wing of fleets: who comes for simulation nights never meets it, and misses nothing."""

import json
import os
import shutil
import subprocess
import sysconfig
import urllib.error
import urllib.request
import venv
from pathlib import Path

import pytest
from helpers import endpoint_process
from helpers.endpoint_process import serving
from helpers.paths import REPOSITORY

LAYERS = ("schemas", "tasks", "flows", "deployments")
LOOK = """
import sys
from prefect_robomaker.deployments.cli.main import main
from prefect_robomaker.schemas.operations.registry import OPERATIONS
from prefect_robomaker.tasks.operations.registry import registry
for words in (["--help"], ["gc", "--help"]):
    try:
        main(words)
    except SystemExit:
        pass
print(len(OPERATIONS), len(registry()), *(name for name in sys.modules if ".fleet" in name and "robomaker" in name))
"""
SPEC = """
version: 1
name: quick
steps:
  template:
    operation: CreateWorldTemplate
    input:
      name: room
      templateBody:
        Buildings:
          - Floors:
              - Floorplan:
                  Rooms:
                    - {Type: Living, Name: living room, DesiredShape: {Area: 16, AspectRatio: {x: 1, y: 1}}}
  worlds:
    operation: CreateWorldGenerationJob
    input: {template: "${{ template.arn }}", worldCount: {floorplanCount: 1, interiorCountPerFloorplan: 2}, seed: 7}
  drive:
    operation: StartSimulationJobBatch
    input:
      batchPolicy: {maxConcurrency: 2, timeoutInSeconds: 1800}
      createSimulationJobRequests:
        forEach: ${{ worlds.finishedWorldsSummary.succeededWorlds }}
        as: world
        value:
          simulationApplications:
            - {application: indoor-navigation, launchConfig: {}, worldConfigs: [{world: "${{ world }}"}]}
          robotApplications:
            - {application: scout, launchConfig: {}}
          maxJobDurationInSeconds: 300
          outputLocation: {s3Bucket: robomaker, s3Prefix: quick}
          iamRole: arn:aws:iam::000000000000:role/local
          seed: 1
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of an environment with everything that this one has, and the product without its wing."""
    folder = tmp_path_factory.mktemp("without-fleets")
    venv.create(folder, symlinks=True)
    packages = Path(sysconfig.get_path("purelib", vars={"base": str(folder)}))
    # Folders that a .pth names are looked in after this one, and their own .pth files, which lead here, are not read.
    (packages / "others.pth").write_text(sysconfig.get_path("purelib") + "\n")
    shutil.copytree(REPOSITORY / "prefect_robomaker", packages / "prefect_robomaker", ignore=_left_out)
    for layer in LAYERS:
        shutil.copytree(REPOSITORY / layer, packages / "prefect_robomaker" / layer, ignore=_left_out)
    return folder / "bin" / "python"


def _left_out(folder: str, _: list[str]) -> set[str]:
    is_layer = Path(folder) in {REPOSITORY / layer for layer in LAYERS}
    return {"fleet"} if is_layer else set()  # with what is compiled, which would be compiled anew


def environ(folder: Path, **variables: str) -> dict[str, str]:
    own = {"ROBOMAKER_HOME": str(folder / "home"), "PREFECT_HOME": str(folder / "prefect"), "CI": "true"}
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | own | variables


def test_no_command_and_no_operation_of_fleets_is_left(python: Path, tmp_path: Path) -> None:
    looked = subprocess.run([python, "-c", LOOK], env=environ(tmp_path), capture_output=True, text=True, cwd=tmp_path)

    assert looked.returncode == 0, looked.stderr
    *helps, counts = looked.stdout.splitlines()
    assert counts.split() == ["42", "42"]
    told = "\n".join(helps).lower()
    assert [word for word in ("fleet", "enroll", "agent ", "keep-deployments") if word in told] == []
    assert "--older-than" in told


@pytest.mark.deep
def test_a_night_runs_and_is_looked_at(
    python: Path, prefect_server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "quick.yaml").write_text(SPEC)
    command = [python, "-m", "prefect_robomaker"]
    variables = environ(tmp_path, PREFECT_API_URL=prefect_server)

    def run(*words: str) -> str:
        ended = subprocess.run([*command, *words], env=variables, capture_output=True, text=True, cwd=tmp_path)
        assert ended.returncode == 0, ended.stdout + ended.stderr
        return ended.stdout

    answer = json.loads(run("run", "quick.yaml", "-o", "json"))
    assert [job["verdict"] for job in answer["jobs"]] == ["PASS", "PASS"]
    run("gc", "--older-than", "1d", "--dry-run")
    run("fsck")

    monkeypatch.setattr(endpoint_process, "COMMAND", [str(python), *endpoint_process.COMMAND[1:]])
    monkeypatch.delenv("PYTHONPATH", raising=False)
    monkeypatch.chdir(tmp_path)  # Python looks where it is started, and the repository's folders are no whole package
    with serving(tmp_path / "home", tmp_path, "--execute", "none") as served:
        with urllib.request.urlopen(f"{served.url}/console", timeout=200) as page:
            assert b"Fleets" not in page.read()
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(f"{served.url}/console/fleets", timeout=200)
        assert refused.value.code == 404
