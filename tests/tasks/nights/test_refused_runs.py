"""Runs of a deployment that are refused before their first step: somebody is told, and the data home has them."""

import json
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from helpers.command_here import Command
from helpers.receivers import Webhook
from helpers.small_flat import ROLE

from prefect_robomaker.flows.deployed_pipelines import with_parameters
from prefect_robomaker.schemas.reports.run_record import Order, RerunOf
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ConfigurationError
from prefect_robomaker.tasks.inspection.run_records import read_record
from prefect_robomaker.tasks.nights.refused_runs import finish_refused_order
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
    assert webhook.got[1]["title"].startswith("night3: refused, ")
    assert reason in webhook.got[1]["title"]
    assert "It was refused before its first step: " in webhook.got[1]["message"]
    assert reason in webhook.got[1]["message"]
    history = robomaker_at_server("history", "night3")
    assert history.code == 0, history.err
    (row,) = [line for line in history.out.splitlines() if "broken: refused before its first step: " in line]
    assert reason in row
    assert "first run that has results" not in history.out
    if record.report_path is not None:
        page = record.report_path.read_text(encoding="utf-8")
        answer = unescape(page[page.index('<p class="verdict') : page.index('<dl class="run">')])
        assert "<strong>Broken</strong>: refused before its first step: " in answer
        assert reason in answer
        assert "before the first step" not in page, "it is no step of the specification"
        assert "no earlier run" not in page


@pytest.mark.usefixtures("own_service")
def test_a_deployed_run_whose_archive_is_gone_makes_nothing_first(robomaker_at_server: Command, home: Path) -> None:
    robot = {
        "name": "rover",
        "sources": [{"s3Bucket": "robomaker", "s3Key": "applications/rover-2.tar.gz"}],
        "robotSoftwareSuite": {"name": "General"},
    }
    steps = {
        "template": {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": "{}"}},
        "rover": {"operation": "CreateRobotApplication", "input": robot},
    }
    text = json.dumps({"version": 1, "name": "night5", "steps": steps})

    state = with_parameters({})(text=text, origin="night5.yaml", return_state=True)

    assert state.is_failed()
    (record,) = (read_record(path) for path in (home / "runs").glob("*/run.json"))
    told = "there is no object 's3://robomaker/applications/rover-2.tar.gz' in the object store (night5.yaml:1:"
    assert (record.refusal or "").startswith(told)
    assert [(step.name, step.status) for step in record.steps[1:]] == [("template", "Skipped"), ("rover", "Skipped")]


@pytest.mark.usefixtures("own_service")
def test_a_run_of_the_console_that_is_refused_leaves_the_record_of_a_deployed_one(
    robomaker_at_server: Command, home: Path, webhook: Webhook, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOMAKER_NOTIFY", f"json://{webhook.address}/hook")
    with_parameters({})(text=SPEC, origin="night3.yaml", return_state=True)
    (deployed,) = (read_record(path) for path in (home / "runs").glob("*/run.json"))
    order = Order(
        run_id="night3-20260301T020000000", text=SPEC, filename="night3.yaml", spec_path="night3.yaml",
        command=deployed.command, name="night3",
    )  # fmt: skip
    (home / "runs" / order.run_id).mkdir()
    settings = Settings.from_environment(
        {"ROBOMAKER_HOME": str(home), "ROBOMAKER_NOTIFY": f"json://{webhook.address}/hook"}
    )

    finish_refused_order(order, ConfigurationError(deployed.refusal or ""), settings, lambda _: None)

    ordered = read_record(home / "runs" / order.run_id / "run.json")
    assert (ordered.name, ordered.state, ordered.refusal) == ("night3", "broken", deployed.refusal)
    own = {"run_id", "run_dir", "report_path", "started_at", "ended_at", "flow_run", "source"}
    assert ordered.model_dump(exclude=own) == deployed.model_dump(exclude=own)
    titles = [told["title"] for told in webhook.got if "title" in told]
    assert titles == [f"night3: refused, {deployed.refusal}"] * 2
    assert "night3" in robomaker_at_server("history", "night3").out


@pytest.mark.usefixtures("own_service")
def test_a_refused_rerun_calls_no_monitor(home: Path, webhook: Webhook) -> None:
    """Reruns never do: a call of the start alone would raise an alarm about an end that never comes."""
    rerun = RerunOf(run_id="night3-20260301T020000000", selection="failed", jobs_total=1, earlier={})
    settings = Settings.from_environment(
        {"ROBOMAKER_HOME": str(home), "ROBOMAKER_PING_URL": f"http://{webhook.address}/p"}
    )
    for number, repeated in enumerate((rerun, None)):
        order = Order(
            run_id=f"night3-20260302T02000000{number}", text=SPEC, filename="night3.yaml", spec_path="night3.yaml",
            command=[], name="night3", rerun_of=repeated,
        )  # fmt: skip
        (home / "runs" / order.run_id).mkdir(parents=True)
        finish_refused_order(order, ConfigurationError("gone"), settings, lambda _: None)
        assert webhook.paths == ([] if repeated else ["/p/start", "/p/fail"])


def test_a_run_by_hand_that_is_refused_leaves_no_folder(
    robomaker_at_server: Command, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = {
        "maxJobDurationInSeconds": 60,
        "iamRole": ROLE,
        "robotApplications": [{"application": "scout", "launchConfig": {"command": ["./drive"]}}],
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
