"""Whole runs of specifications: what they leave, however they end."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.paths import BUNDLES
from helpers.small_flat import BODY, ROLE

from prefect_robomaker.flows import pipelines
from prefect_robomaker.flows.pipelines import PipelineRun, run_spec
from prefect_robomaker.schemas.reports.progress import Note, ProgressEvent, StepEnded, StepStarted
from prefect_robomaker.schemas.reports.run_record import JobRecord, RunRecord, StepRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException, WorldGenerationError
from prefect_robomaker.tasks.inspection import reports
from prefect_robomaker.tasks.inspection.pipeline_parts import RunInterrupted
from prefect_robomaker.tasks.inspection.reports import rebuild_report
from prefect_robomaker.tasks.nights.ending import state_of_run
from prefect_robomaker.tasks.nights.wanted_runs import WantedRun
from prefect_robomaker.tasks.operations.registry import Operation
from prefect_robomaker.tasks.operations.step_operations import step_registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz
from prefect_robomaker.tasks.worlds.builders import WorldBuilders

Run = Callable[..., RunRecord]
SOURCES = [{"s3Bucket": "applications", "s3Key": "sleeper.tar.gz"}]
SUITE = {"name": "General"}
TEMPLATE = {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": BODY}}


def worlds(floorplans: int) -> dict[str, Any]:
    count = {"floorplanCount": floorplans, "interiorCountPerFloorplan": 1}
    request = {"template": "${{ template.arn }}", "worldCount": count, "seed": 7}
    return {"operation": "CreateWorldGenerationJob", "input": request}


def job(robot: dict[str, Any], simulation: dict[str, Any]) -> dict[str, Any]:
    return {
        "maxJobDurationInSeconds": 120,
        "iamRole": ROLE,
        "seed": 3,
        "robotApplications": [robot],
        "simulationApplications": [simulation],
    }


SLEEP = job(
    {
        "application": "${{ watcher.arn }}",
        "launchConfig": {
            "packageName": "sleeper",
            "launchFile": "make_agent",
            "environmentVariables": {"X_TOKEN": "hunter2"},
        },
    },
    {"application": "${{ sleeper.arn }}", "launchConfig": {"packageName": "sleeper", "launchFile": "make_environment"}},
)
DRIVE = job(
    {"application": "scout", "launchConfig": {}},
    {
        "application": "indoor-navigation",
        "launchConfig": {},
        "worldConfigs": [{"world": "${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}"}],
    },
)
NOBODY = "arn:aws:robomaker:us-east-1:000000000000:robot-application/no-such-robot/1542931200000"
WRONG = job({"application": NOBODY, "launchConfig": {}}, {"application": "sleeper", "launchConfig": {}})
FULL = {
    "watcher": {
        "operation": "CreateRobotApplication",
        "input": {"name": "watcher", "sources": SOURCES, "robotSoftwareSuite": SUITE},
        "ifExists": "reuse",
    },
    "sleeper": {
        "operation": "CreateSimulationApplication",
        "input": {
            "name": "sleeper",
            "sources": SOURCES,
            "robotSoftwareSuite": SUITE,
            "simulationSoftwareSuite": {"name": "SimulationRuntime"},
        },
        "ifExists": "reuse",
    },
    "template": TEMPLATE,
    "worlds": worlds(1),
    "jobs": {
        "operation": "StartSimulationJobBatch",
        "input": {"createSimulationJobRequests": [SLEEP, WRONG, DRIVE], "batchPolicy": {"maxConcurrency": 2}},
    },
}
QUICK = {"template": TEMPLATE, "list": {"operation": "ListWorlds", "needs": ["template"]}}


@pytest.fixture
def events() -> list[ProgressEvent]:
    return []


@pytest.fixture
def run(settings: Settings, prefect_server: str, events: list[ProgressEvent]) -> Run:
    """Runs the steps of a specification."""

    def start(steps: dict[str, Any], name: str = "Tiny_Run", listener: Any = events.append) -> RunRecord:
        checked = load_spec(json.dumps({"version": 1, "name": name, "steps": steps}), "tiny.yaml")
        return run_spec(WantedRun(checked, "a folder/tiny.yaml"), settings, listener)

    return start


@pytest.fixture
def archive(service: Service, tmp_path: Path) -> None:
    """The archive of the applications that sleep."""
    source = BUNDLES / "sleeper"
    shutil.copytree(source, tmp_path / "bundle", ignore=shutil.ignore_patterns("__pycache__"))
    pack_tar_gz(tmp_path / "bundle", tmp_path / "sleeper.tar.gz")
    service.store.ensure_bucket("applications")
    service.store.put_file("applications", "sleeper.tar.gz", tmp_path / "sleeper.tar.gz")


def statuses(record: RunRecord) -> dict[str, str]:
    return {step.name: step.status for step in record.steps}


@pytest.mark.parametrize(
    "again", [("watcher", "sleeper"), pytest.param(tuple(FULL), marks=pytest.mark.endurance)], ids=["a part", "all"]
)
def test_a_specification_runs_to_its_report_and_runs_again(
    run: Run, service: Service, archive: None, again: tuple[str, ...]
) -> None:
    first, second = run(FULL), run({name: FULL[name] for name in again})

    for record in (first, second)[: 1 + (again == tuple(FULL))]:
        assert statuses(record) == dict.fromkeys(FULL, "Completed")
        assert [job.failure_reason for job in record.jobs][2] is None
        assert [job.status for job in record.jobs] == ["Completed", "NotCreated", "Completed"]
        assert [job.verdict for job in record.jobs] == ["NONE", None, "PASS"]
        assert record.jobs[1].label == "request 2"
        assert "no-such-robot" in (record.jobs[1].failure_reason or "")
        assert record.jobs[2].rooms_visited == record.jobs[2].rooms_total == 2
        assert (record.state, record.exit_code) == ("broken", 3)
        assert record.versions["mujoco"]
        assert {path.name for path in record.run_dir.iterdir()} == {
            "run.json", "spec.yaml", "report.html", "results.parquet"
        }  # fmt: skip
        assert RunRecord.model_validate_json((record.run_dir / "run.json").read_text()).jobs == record.jobs
        copy = (record.run_dir / "spec.yaml").read_text()
        assert "hunter2" not in copy
        assert json.loads(copy.replace("(secret)", "hunter2"))["steps"] == FULL
    assert first.run_id != second.run_id
    assert [step.arn for step in first.steps[:2]] == [step.arn for step in second.steps[:2]], "reused"
    if second.jobs:
        assert first.jobs[2].metrics["distance_m"] == second.jobs[2].metrics["distance_m"]

    written = (first.run_dir / "report.html").read_text()
    assert "hunter2" not in written + (first.run_dir / "run.json").read_text()
    assert "request 2" in written
    assert "robomaker run &#39;a folder/tiny.yaml&#39;" in written
    (first.run_dir / "report.html").unlink()
    assert rebuild_report(first, service).report_path == first.run_dir / "report.html"
    assert (first.run_dir / "report.html").read_text() == written


@pytest.mark.deep
def test_a_step_updates_an_application_of_its_name(run: Run, service: Service) -> None:
    def step(module: str) -> dict[str, Any]:
        request = {"name": "mine", "environment": {"uri": f"python://{module}"}, "robotSoftwareSuite": SUITE}
        return {"mine": {"operation": "CreateRobotApplication", "input": request, "ifExists": "update"}}

    first, second = run(step("first")), run(step("second"))

    assert [record.steps[0].error for record in (first, second)] == [None, None]
    assert first.steps[0].arn == second.steps[0].arn
    resource = service.catalog.find("robot-application", "mine")
    assert resource is not None
    assert resource.document["environment"] == {"uri": "python://second"}


def test_steps_after_a_failure_are_skipped_and_the_report_is_written(run: Run, events: list[ProgressEvent]) -> None:
    missing = {"operation": "DescribeWorld", "input": {"world": "arn:aws:robomaker:us-east-1:000000000000:world/none"}}

    record = run({"template": TEMPLATE, "missing": missing, "after": {"operation": "ListWorlds", "needs": ["missing"]}})

    assert statuses(record) == {"template": "Completed", "missing": "Failed", "after": "Skipped"}
    assert (record.state, record.exit_code) == ("broken", 3)
    assert "ResourceNotFoundException" in (record.steps[1].error or "")
    assert record.report_path is not None
    assert record.report_path.exists()
    assert [event.step for event in events if isinstance(event, StepEnded)] == ["template", "missing", "after"]


def test_a_defect_in_a_step_is_a_failed_step(
    run: Run, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    entry = step_registry()["ListWorlds"]

    def stumble(*arguments: Any) -> Any:
        raise ZeroDivisionError("a defect")

    monkeypatch.setitem(step_registry(), "ListWorlds", Operation(entry.shape, stumble))
    record = run(QUICK)

    assert statuses(record) == {"template": "Completed", "list": "Failed"}
    assert record.steps[1].error == "ZeroDivisionError: a defect"
    assert (record.state, record.exit_code) == ("broken", 3)
    assert "in stumble" in caplog.text


@pytest.mark.deep
@pytest.mark.usefixtures("known_worlds")
def test_worlds_that_failed_break_the_run_but_the_others_are_used(
    run: Run, service: Service, archive: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    build = WorldBuilders.build
    left = [1]

    def build_some(*arguments: Any) -> str:
        if left and left.pop():
            raise WorldGenerationError("the walls met")
        return build(*arguments)

    monkeypatch.setattr(WorldBuilders, "build", build_some)
    after = {
        "operation": "DescribeWorld",
        "input": {"world": "${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}"},
    }
    record = run({"template": TEMPLATE, "worlds": worlds(2), "look": after})

    assert statuses(record) == {"template": "Completed", "worlds": "PartialFailed", "look": "Completed"}
    assert "the walls met" in (record.steps[1].error or "")
    assert (record.state, record.exit_code) == ("broken", 3)


def test_a_report_that_cannot_be_written_leaves_the_record(
    run: Run, monkeypatch: pytest.MonkeyPatch, events: list[ProgressEvent]
) -> None:
    def stumble(*arguments: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(reports, "write_report", stumble)
    record = run(QUICK)

    assert (record.report_path, record.state) == (None, "broken")
    assert (record.run_dir / "run.json").exists()
    assert any(isinstance(event, Note) and "No space left" in event.text for event in events)


def test_an_interrupted_run_has_a_record_and_a_report(run: Run) -> None:
    def interrupt(event: ProgressEvent) -> None:
        if event == StepStarted("list", "ListWorlds"):
            raise KeyboardInterrupt

    with pytest.raises(RunInterrupted) as caught:
        run(QUICK, listener=interrupt)

    record = caught.value.record
    assert (record.state, record.exit_code) == ("canceled", 4)
    assert statuses(record) == {"template": "Completed"}
    assert (record.run_dir / "report.html").exists()


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, LookupError])
def test_a_process_that_ends_as_an_orphan_writes_down_no_end_of_its_run(
    service: Service, monkeypatch: pytest.MonkeyPatch, interruption: type[BaseException], prefect_server: str
) -> None:
    """Its leases are given back, so that what it does fails; another process finishes the run from its order."""

    class Held(BaseException):
        pass

    def hold() -> None:
        raise Held

    def interrupt(event: ProgressEvent) -> None:
        if event == StepStarted("list", "ListWorlds"):
            monkeypatch.setattr(pipelines, "wait_if_ending", hold)
            raise interruption

    checked = load_spec(json.dumps({"version": 1, "name": "quick", "steps": QUICK}), "quick.yaml")
    pipeline = PipelineRun(WantedRun(checked, "quick.yaml"), service, interrupt)
    with pytest.raises(Held):
        pipeline.run()

    names = {path.name for path in service.folder("runs", pipeline.run_id).iterdir()}
    assert "order.json" in names
    assert names.isdisjoint({"run.json", "cancel"})


def test_a_run_that_is_cancelled_just_before_its_step_makes_a_job_cancels_that_job_too(
    service: Service, order: Callable[..., dict[str, Any]], prefect_server: str
) -> None:
    later = {"operation": "ListWorlds", "needs": ["drive"]}
    steps = {"drive": {"operation": "CreateSimulationJob", "input": order({"DURATION_S": "30"})}, "later": later}
    checked = load_spec(json.dumps({"version": 1, "name": "cancelled", "steps": steps}), "cancelled.yaml")
    told: list[ProgressEvent] = []

    def cancel(event: ProgressEvent) -> None:
        told.append(event)
        if event == StepStarted("drive", "CreateSimulationJob"):
            pipeline.cancel()

    pipeline = PipelineRun(WantedRun(checked, "cancelled.yaml"), service, cancel)
    record = pipeline.run()

    assert statuses(record) == {"drive": "Canceled", "later": "Skipped"}
    assert record.state == "canceled"
    assert told[-1] == StepEnded("later", "Skipped", 0.0, "the run was cancelled")


def test_a_cancellation_that_the_catalog_does_not_take_is_not_taken_for_done(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    checked = load_spec(json.dumps({"version": 1, "name": "one", "steps": {"template": TEMPLATE}}), "one.yaml")
    pipeline = PipelineRun(WantedRun(checked, "one.yaml"), service, lambda _: None)
    pipeline._outputs.update({"gone": {"arn": NOBODY}})
    pipeline.cancel()

    def busy(arn: str) -> None:
        raise ServiceUnavailableException("the catalog does not answer")

    monkeypatch.setattr(service.catalog, "request_cancel", busy)
    with pytest.raises(ServiceUnavailableException):
        pipeline.cancel()


def ended(status: str, **members: Any) -> JobRecord:
    return JobRecord(label="sim", status=status, **members)


@pytest.mark.parametrize(
    ("step", "jobs", "state"),
    [
        ("Completed", [], "succeeded"),
        ("Completed", [ended("Completed", verdict="PASS"), ended("Completed", verdict="NONE")], "succeeded"),
        ("Completed", [ended("Completed", verdict="FAIL"), ended("Completed", verdict="PASS")], "failed"),
        ("Completed", [ended("Completed", verdict="FAIL"), ended("Failed")], "broken"),
        ("Completed", [ended("NotCreated", failure_code="InvalidInput")], "broken"),
        ("TimedOut", [ended("Failed"), ended("Canceled", failure_code="BatchTimedOut")], "timed out"),
        ("TimedOut", [ended("NotCreated", failure_code="BatchTimedOut")], "timed out"),
        ("Canceled", [ended("Failed"), ended("NotCreated", failure_code="BatchCanceled")], "canceled"),
        ("Completed", [ended("Canceled", verdict="NONE"), ended("Completed", verdict="PASS")], "canceled"),
        ("Completed", [ended("Canceled", verdict="FAIL"), ended("Completed", verdict="FAIL")], "failed"),
        ("Completed", [ended("Canceled"), ended("Failed")], "broken"),
        ("PartialFailed", [ended("Completed", verdict="PASS")], "broken"),
        ("Failed", [], "broken"),
    ],
)
def test_the_worst_end_is_the_runs_end(step: str, jobs: list[JobRecord], state: str) -> None:
    checked = load_spec(json.dumps({"version": 1, "name": "one", "steps": {"template": TEMPLATE}}), "one.yaml")
    steps = [StepRecord(name="template", operation="CreateWorldTemplate", status=step)]

    assert state_of_run(checked, steps, jobs, is_canceled=False) == state


@pytest.mark.parametrize(
    ("jobs", "state"),
    [
        ([ended("Completed", verdict="PASS"), ended("NotCreated", failure_code="BatchCanceled")], "succeeded"),
        ([ended("Completed", verdict="PASS"), ended("Canceled", failure_code="BatchCanceled")], "succeeded"),
        ([ended("Completed", verdict="FAIL"), ended("NotCreated", failure_code="BatchCanceled")], "failed"),
        ([ended("Failed"), ended("NotCreated", failure_code="BatchCanceled")], "broken"),
    ],
)
def test_jobs_that_a_decided_run_cancels_are_no_failure(jobs: list[JobRecord], state: str) -> None:
    two = {"version": 1, "name": "two", "steps": {"drive": TEMPLATE, "after": TEMPLATE}}
    checked = load_spec(json.dumps(two), "two.yaml")
    steps = [
        StepRecord(name="drive", operation="StartSimulationJobBatch", status="Canceled"),
        StepRecord(name="after", operation="ListWorlds", status="Skipped"),
    ]
    assert state_of_run(checked, steps, jobs, is_canceled=False, ended_early=True) == state
    assert state_of_run(checked, steps, jobs, is_canceled=True) == "canceled"
