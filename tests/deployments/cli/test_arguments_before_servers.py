"""A command with arguments that cannot be right starts no Prefect server and makes no files before it says so."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments.prefect_server.local_server import stop_server
from prefect_robomaker.schemas.settings import Settings

SPEC = 'version: 1\nname: flat\nsteps:\n  flat: {operation: CreateWorldTemplate, input: {templateBody: "{}"}}\n'
NO_JOB = "arn:aws:robomaker:us-east-1:123456789012:simulation-job/sim-012345678901"
_WORLDS = "worldCount: {floorplanCount: 1, interiorCountPerFloorplan: 1}"
NO_TEMPLATE = "arn:aws:robomaker:us-east-1:123456789012:world-template/template-012345678901"
REFUSED = {
    "spec.yaml": SPEC,
    "scot.yaml": "version: 1\nname: refused\nsteps:\n  drive: {operation: CreateSimulationJob, input: {"
    "maxJobDurationInSeconds: 60, iamRole: 'arn:aws:iam::000000000000:role/local', "
    "robotApplications: [{application: scot, launchConfig: {}}]}}\n",
    "gone.yaml": "version: 1\nname: refused\nsteps:\n  worlds: {operation: CreateWorldGenerationJob, "
    f"input: {{template: '{NO_TEMPLATE}', {_WORLDS}}}}}\n",
}
DEPLOY = ("deploy", "spec.yaml", "--pool", "p")


@pytest.fixture(autouse=True)
def no_server_left(home: Path) -> Iterator[None]:
    yield
    stop_server(Settings.from_environment({"ROBOMAKER_HOME": str(home)}))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((*DEPLOY, "--schedule", "0 2 * *"), "--schedule is '0 2 * *'; five fields would be right"),
        ((*DEPLOY, "--schedule", "@daily", "--timezone", "Berlin"), "--timezone is 'Berlin'; an IANA name"),
        ((*DEPLOY, "--block", "robomaker-catalog"), "--block is 'robomaker-catalog'; TYPE/NAME would be right"),
        ((*DEPLOY, "--block", "robomaker-store/lab"), "did you mean 'robomaker-object-store'?"),
        ((*DEPLOY, "--env", "nothing"), "--env is 'nothing'"),
        ((*DEPLOY, "--name", "a b"), "--name is 'a b'"),
        ((*DEPLOY, "absent.yaml"), "absent.yaml"),
        (("pool-template", "docker"), "--image is missing"),
        (("pool-template", "docker", "--image", "i", "--env", "A"), "--env is 'A'"),
        (("perform", NO_JOB), "sim-012345678901"),
        (("perform", "sim-012345678901"), "sim-012345678901"),
        (("run", "scot.yaml"), "there is no robot application 'scot'; did you mean 'scout'?"),
        (("run", "gone.yaml"), f"steps.worlds.input.template: there is no world template '{NO_TEMPLATE}'"),
        (("run", "spec.yaml", "--seed", "-1"), "--seed is -1"),
        (("run", "spec.yaml", "--report", "no/such/folder.html"), "--report is no/such/folder.html"),
        (("rerun", "latest", "--report", "no/such/folder.html"), "--report is no/such/folder.html"),
        (("serve", "--max-jobs", "0"), "--max-jobs is 0"),
        (("serve", "--port", "70000"), "--port is 70000"),
    ],
)
def test_wrong_arguments_cost_no_server(
    robomaker: Callable[..., Any],
    home: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in REFUSED.items():
        Path(name).write_text(text)

    ended = robomaker(*words)

    assert message in ended.err
    assert (ended.code, ended.out) == (2, "")
    assert "Starting the local Prefect server" not in ended.err
    assert not (home / "prefect").exists()
    assert {path.name for path in tmp_path.iterdir()} <= {*REFUSED, "home"}
