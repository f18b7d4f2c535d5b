"""What a flow run shows in Prefect's UI."""

import re
from typing import Any

import httpx
import pytest
from prefect import flow
from prefect.artifacts import Artifact

from prefect_robomaker.schemas.runs.trials import TrialCounts
from prefect_robomaker.tasks.execution import prefect_artifacts
from prefect_robomaker.tasks.execution.prefect_artifacts import artifact_key, show_table, show_text, shown_progress
from prefect_robomaker.tasks.service.service import Progress, Service


@pytest.mark.parametrize("name", ["Nightly_Flats", "a--b", "x-", "1.5 m", "_"])
def test_every_name_makes_a_key_that_prefect_takes(name: str) -> None:
    assert re.fullmatch("[a-z0-9]+(-[a-z0-9]+)*", artifact_key("robomaker", name, "jobs"))


def test_a_flow_run_has_a_table_and_its_progress(prefect_server: str, service: Service) -> None:
    key = artifact_key("test", "Table_Of-Jobs")

    @flow(name="shows")
    def shows() -> None:
        with shown_progress(service, "two jobs") as watched:
            watched.report_progress(Progress({"completed": 1, "failed": 1, "running": 2}, 4))
            show_table(key, [{"job": "sim-1", "status": "Completed"}], "Simulation jobs")

    shows()

    found: Any = Artifact.get(key)  # typed as if this were a coroutine
    assert found is not None
    assert "sim-1" in str(found.data)


@pytest.mark.parametrize(("trials", "percent"), [(None, 50.0), (TrialCounts(30, 120), 25.0)])
def test_the_bar_goes_by_trials_where_there_are_any(
    prefect_server: str,
    service: Service,
    monkeypatch: pytest.MonkeyPatch,
    trials: TrialCounts | None,
    percent: float,
) -> None:
    shown: list[float] = []

    def show(progress: float, **_: object) -> None:
        shown.append(progress)

    monkeypatch.setattr(prefect_artifacts, "create_progress_artifact", show)

    @flow(name="counts")
    def counts() -> None:
        with shown_progress(service, "four jobs") as watched:
            watched.report_progress(Progress({"completed": 1, "failed": 1, "running": 2}, 4, trials=trials))

    counts()

    assert set(shown) == {percent}


def test_a_server_that_is_gone_fails_nothing(
    prefect_server: str, service: Service, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(**arguments: object) -> None:
        raise httpx.ConnectError("there is no listener")

    for name in ("create_table_artifact", "create_markdown_artifact", "create_progress_artifact"):
        monkeypatch.setattr(prefect_artifacts, name, refuse)
    seen: list[Progress] = []

    @flow(name="shows nothing")
    def shows_nothing() -> None:
        with shown_progress(service.watched_by(seen.append), "two jobs") as watched:
            watched.report_progress(Progress({"completed": 1}, 1))
        show_table("jobs", [{"job": "sim-1"}], "Simulation jobs")
        show_text("summary", "all well", "How the run ended")

    shows_nothing()

    assert seen == [Progress({"completed": 1}, 1)]
    assert caplog.text.count("cannot be shown in Prefect: there is no listener") >= 3


def test_nothing_is_shown_outside_a_flow_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prefect_artifacts, "create_table_artifact", lambda **_: pytest.fail("there is no flow run"))
    show_table("jobs", [{"job": "sim-1"}], "Simulation jobs")
