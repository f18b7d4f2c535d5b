"""Probes that run, and the runs after them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_night
from helpers.small_flat import BODY, ROLE

from prefect_robomaker.deployments.cli import probes
from prefect_robomaker.deployments.cli.probes import Machines, ProbeFailedError, probe, trials_within
from prefect_robomaker.flows.pipelines import run_spec
from prefect_robomaker.schemas.reports.forecast import Forecast
from prefect_robomaker.schemas.reports.progress import ProgressEvent
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.specification import CheckedSpec
from prefect_robomaker.tasks.inspection.forecasting import find_forecast
from prefect_robomaker.tasks.nights.wanted_runs import WantedRun
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]
SUITE = {"name": "General"}


def specification(steps: dict[str, Any], name: str = "night") -> CheckedSpec:
    return load_spec(json.dumps({"version": 1, "name": name, "steps": steps}), "night.yaml")


def batch(requests: Any, **members: Any) -> dict[str, Any]:
    policy = {"maxConcurrency": 2, "timeoutInSeconds": 600}
    order = {"createSimulationJobRequests": requests, "batchPolicy": policy, **members}
    return {"operation": "StartSimulationJobBatch", "input": order}


def forecast_of(spec: CheckedSpec, settings: Settings, **options: Any) -> Forecast:
    events: list[ProgressEvent] = []
    return probe(spec, settings, Machines(**options), events.append, "night.yaml")


def run(spec: CheckedSpec, settings: Settings, **options: Any) -> RunRecord:
    return run_spec(WantedRun(spec, "night.yaml", **options), settings, lambda event: None)


@pytest.mark.deep
def test_a_probe_runs_some_of_the_jobs_and_the_run_says_how_far_off_it_was(
    settings: Settings, service: Service, order: Order, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run finds its names and its token free."""
    monkeypatch.setattr(probes, "_ROUNDS", 1)  # more of them take longer, and show nothing else
    source = [{"s3Bucket": "applications", "s3Key": "sleeper.tar.gz"}]
    robot = {"name": "fresh", "sources": source, "robotSoftwareSuite": SUITE}
    waiting = [order({"DURATION_S": "0.01"}, trials={"seeds": 12}) if i == 0 else order() for i in range(4)]
    spec = specification(
        {
            "robot": {"operation": "CreateRobotApplication", "input": robot},
            "wait": {**batch(waiting, clientRequestToken="night-7"), "needs": ["robot"]},
        }
    )

    forecast = forecast_of(spec, settings, price_per_hour=3600.0)

    made = service.catalog.find("robot-application", "fresh")
    assert made is None
    robot_step, wait = forecast.steps
    assert (robot_step.parts, wait.parts, wait.concurrency) == (0, 4, 2)
    assert forecast.wall_time_s == pytest.approx(robot_step.wall_time_s + wait.wall_time_s)
    assert forecast.cost == pytest.approx(forecast.wall_time_s)
    assert forecast.cpu_time_s is not None
    assert forecast.cpu_time_s > 0
    assert forecast.size_bytes > 0
    assert len(forecast.probes) == 2
    assert {job.verdict for job in forecast.ran} == {"NONE"}
    assert wait.timeout_s == 600.0
    assert (wait.longest_batch_s, wait.over_limit) == (wait.wall_time_s, 0)
    assert find_forecast(spec, settings) == forecast

    record = run(spec, settings)

    assert record.state == "succeeded", record.steps
    assert record.forecast is not None
    assert record.forecast.forecast_s == forecast.wall_time_s
    assert record.forecast.took_s == (record.ended_at - record.started_at).total_seconds()
    assert record.report_path is not None
    assert f"it took {record.forecast.difference}" in record.report_path.read_text()


@pytest.mark.deep
def test_worlds_and_the_jobs_in_them_are_counted_as_the_whole_run_makes_them(
    settings: Settings, service: Service, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Fewer worlds and one pass: what is counted is the whole run's, whatever the probe made.
    monkeypatch.setattr(probes, "AGAIN_BELOW_S", 0.0)
    monkeypatch.setattr(probes, "_WORLDS_PER_CPU", 1)
    count = {"floorplanCount": 20, "interiorCountPerFloorplan": 2}
    drive = {
        "maxJobDurationInSeconds": 60,
        "iamRole": ROLE,
        "seed": 1,
        "simulationApplications": [
            {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": "${{ world }}"}]}
        ],
    }
    worlds = "${{ worlds.finishedWorldsSummary.succeededWorlds }}"
    place = {"outputLocation": {"s3Bucket": "robomaker", "s3Prefix": "x"}, "iamRole": ROLE}
    spec = specification(
        {
            "template": {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": BODY}},
            "worlds": {
                "operation": "CreateWorldGenerationJob",
                "input": {"template": "${{ template.arn }}", "worldCount": count, "seed": 7},
            },
            "export": {"operation": "CreateWorldExportJob", "input": {"worlds": worlds, **place}},
            "drive": batch({"forEach": worlds, "as": "world", "value": drive}),
        }
    )

    forecast = forecast_of(spec, settings)

    by_name = {step.step: step for step in forecast.steps}
    assert {name: step.parts for name, step in by_name.items()} == {
        "template": 0, "worlds": 40, "export": 40, "drive": 40,
    }  # fmt: skip
    assert all(by_name[name].size_bytes > 0 for name in ("worlds", "export", "drive"))
    # With one world for each CPU all of them are made side by side, so that the start is all there is.
    assert 0 < by_name["worlds"].start_s <= by_name["worlds"].wall_time_s
    assert (by_name["worlds"].cpu_time_s or 0) > 0


@pytest.mark.parametrize(("took_s", "expected"), [(8.0, 10), (0.01, 1000), (800.0, 4)])
def test_the_second_pass_has_as_many_trials_as_take_some_seconds(took_s: float, expected: int) -> None:
    plain = make_night("PP")
    assert trials_within(20.0, plain) == 4
    jobs = [job.model_copy(update={"duration_s": took_s, "metrics": {"trials": 4.0}}) for job in plain.jobs]
    assert trials_within(20.0, plain.model_copy(update={"jobs": jobs})) == expected


def test_a_probe_that_breaks_forecasts_nothing_and_says_why(
    settings: Settings, order: Order, prefect_server: str
) -> None:
    spec = specification({"wait": batch([order({"FAIL_AT_STEP": "1"})] * 3)})
    with pytest.raises(
        ProbeFailedError, match=r"night-probe-.* is broken: watcher \(sim-.*the simulated floor gave way"
    ):
        forecast_of(spec, settings)
    assert find_forecast(spec, settings) is None


def test_an_application_that_was_there_before_stays(
    settings: Settings, service: Service, order: Order, prefect_server: str
) -> None:
    existing = service.catalog.find("robot-application", "watcher")
    assert existing is not None
    source = [{"s3Bucket": "applications", "s3Key": "sleeper.tar.gz"}]
    request = {"name": "watcher", "sources": source, "robotSoftwareSuite": SUITE}
    robot = {"operation": "CreateRobotApplication", "input": request, "ifExists": "reuse"}
    forecast = forecast_of(specification({"robot": robot}), settings)
    assert len(forecast.probes) == 1
    assert service.catalog.find("robot-application", "watcher") == existing


def test_a_run_that_may_take_results_over_is_not_compared(
    settings: Settings, service: Service, prefect_server: str, tmp_path: Path
) -> None:
    spec = specification({"flat": {"operation": "CreateWorldTemplate", "input": {"name": "a", "templateBody": {}}}})
    forecast_of(spec, settings)
    assert run(spec, settings, reuse=True).forecast is None
    assert run(spec, settings).forecast is not None
