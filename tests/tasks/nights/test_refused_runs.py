"""Runs of a deployment that are refused before their first step: somebody is told, and the data home has them."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.command_here import Command
from helpers.receivers import Webhook
from helpers.small_flat import ROLE

from prefect_robomaker.flows.deployed_pipelines import with_parameters
from prefect_robomaker.tasks.inspection.run_records import read_record
from prefect_robomaker.tasks.service import service

JOB = {
    "maxJobDurationInSeconds": 60,
    "iamRole": ROLE,
    "robotApplications": [{"application": "scout", "launchConfig": {}}],
    "simulationApplications": [
        {
            "application": "indoor-navigation",
            "launchConfig": {},
            "worldConfigs": [{"world": "${{ parameters.flat }}"}],
        }
    ],
}
SPEC = json.dumps(
    {
        "version": 1,
        "name": "night3",
        "parameters": {"flat": {"default": "gone"}},
        "steps": {"drive": {"operation": "CreateSimulationJob", "input": JOB}},
    }
)


@pytest.fixture
def own_service() -> Iterator[None]:
    """A process has one service, that of its variables: here each test has its own."""
    service._from_environment.cache_clear()  # pyright: ignore[reportPrivateUsage]
    yield
    service._from_environment.cache_clear()  # pyright: ignore[reportPrivateUsage]


@pytest.mark.usefixtures("own_service")
@pytest.mark.parametrize(
    ("values", "catalog_url", "reason"),
    [
        ({}, None, "'gone' is neither ARN, id nor name of any of the worlds"),
        ({"height": 3}, None, "height"),
        ({}, "sqlite:////proc/none/catalog.db", "FileNotFoundError: "),
    ],
    ids=["a world is gone", "a parameter is gone", "the catalog cannot be used"],
)
def test_a_deployed_run_that_is_refused_is_told_and_kept(
    robomaker_at_server: Command,
    home: Path,
    webhook: Webhook,
    monkeypatch: pytest.MonkeyPatch,
    values: dict[str, Any],
    catalog_url: str | None,
    reason: str,
) -> None:
    monkeypatch.setenv("ROBOMAKER_NOTIFY", f"json://{webhook.address}/hook")
    monkeypatch.setenv("ROBOMAKER_PING_URL", f"http://{webhook.address}/ping/{{name}}")
    if catalog_url is not None:
        monkeypatch.setenv("ROBOMAKER_CATALOG_URL", catalog_url)

    state = with_parameters(values)(text=SPEC, origin="night3.yaml", return_state=True, **values)

    assert state.is_failed()
    (folder,) = (home / "runs").iterdir()
    record = read_record(folder / "run.json")
    assert (record.name, record.state, record.exit_code) == ("night3", "broken", 3)
    assert reason in (record.refusal or "")
    assert record.parameters == {"flat": "gone"}
    assert [(step.name, step.status) for step in record.steps[1:]] == [("drive", "Skipped")]
    assert (record.report_path is None) == (catalog_url is not None)
    assert webhook.paths == ["/ping/night3/start", "/hook", "/ping/night3/fail"]
    assert webhook.got[1]["title"] == "night3: broken"
    assert "It was refused before its first step: " in webhook.got[1]["message"]
    assert reason in webhook.got[1]["message"]
    history = robomaker_at_server("history", "night3")
    assert (history.code, "broken" in history.out) == (0, True), history.err


def test_a_run_by_hand_that_is_refused_leaves_no_folder(
    robomaker_at_server: Command, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = {
        "maxJobDurationInSeconds": 60,
        "iamRole": ROLE,
        "robotApplications": [{"application": "scout", "launchConfig": {}}],
        "outputLocation": {"s3Bucket": "elsewhere"},
    }
    path = tmp_path / "night4.yaml"
    path.write_text(
        json.dumps(
            {"version": 1, "name": "night4", "steps": {"drive": {"operation": "CreateSimulationJob", "input": job}}}
        )
    )
    store = tmp_path / "store"
    store.mkdir()
    (store / "elsewhere").write_text("a file, where the bucket would be a folder")
    monkeypatch.setenv("ROBOMAKER_OBJECT_STORE", str(store))

    ended = robomaker_at_server("run", path)

    assert (ended.code, "elsewhere" in ended.err) == (3, True), ended
    assert not list((home / "runs").glob("*"))
