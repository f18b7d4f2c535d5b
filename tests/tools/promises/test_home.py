"""The recorded home opens: its catalog, its results, its outputs, its worlds, its report."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from prefect_robomaker import Service, Settings, call, load_spec, results
from prefect_robomaker.tasks.consistency.checking import check_consistency
from prefect_robomaker.tasks.inspection.reports import report_of
from prefect_robomaker.tasks.reporting.render import render_report
from tools.promises.home import SPECIFICATION, unpack_home


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROBOMAKER_HOME", str(tmp_path))
    unpack_home(tmp_path)
    return tmp_path


@pytest.fixture
def service(home: Path) -> Iterator[Service]:
    with Service.opened(Settings.from_environment({"ROBOMAKER_HOME": str(home)})) as opened:
        yield opened


def test_jobs_worlds_and_templates_are_described(service: Service) -> None:
    jobs = call("ListSimulationJobs", {}, service)["simulationJobSummaries"]
    described = [call("DescribeSimulationJob", {"job": job["arn"]}, service) for job in jobs]
    (world,) = call("ListWorlds", {}, service)["worldSummaries"]
    (template,) = call("ListWorldTemplates", {}, service)["templateSummaries"]
    (batch,) = call("ListSimulationJobBatches", {}, service)["simulationJobBatchSummaries"]

    assert [job["status"] for job in described] == ["Completed", "Completed"]
    assert {job["maxJobDurationInSeconds"] for job in described} == {300}
    assert "template" in call("DescribeWorld", {"world": world["arn"]}, service)
    assert "Living" in call("GetWorldTemplateBody", {"template": template["arn"]}, service)["templateBody"]
    assert call("DescribeSimulationJobBatch", {"batch": batch["arn"]}, service)["tags"] == {"made-for": "promises"}


def test_jobs_can_be_changed(service: Service) -> None:
    arn = call("ListSimulationJobs", {}, service)["simulationJobSummaries"][0]["arn"]

    call("TagResource", {"resourceArn": arn, "tags": {"seen": "1"}}, service)

    assert call("ListTagsForResource", {"resourceArn": arn}, service)["tags"]["seen"] == "1"


def test_every_stored_file_is_there_and_whole(service: Service) -> None:
    found = check_consistency(service, read_content=True)

    assert found.findings == []
    assert found.objects > 40


def test_results_are_read(service: Service) -> None:
    with service.activated():
        run = results()
        drive, trials = run.jobs
        met = {each.name: each.satisfied for each in drive.result().requirements}

        assert (run.name, run.outcome, run.exit_code, run.parameters) == ("recorded", "failed", 1, {"limit_s": 1})
        assert [drive.outcome, trials.outcome] == ["failed", "failed"]
        assert met["upright"]
        assert not met["quick"]
        assert len(run.rows) == 5
        assert {row.axes.get("friction") for row in run.rows[1:]} == {0.5, 1.0}
        assert {"recording.mcap", "result.json", "provenance.json"} <= set(drive.outputs)


def test_the_report_is_made_again(service: Service) -> None:
    with service.activated():
        run = results()
        assert run.record is not None
        # A record names the folder that its home had.
        report = report_of(run.record.model_copy(update={"run_dir": run.folder}), service)

    assert [job.result and job.result.verdict for job in report.jobs] == ["FAIL", "FAIL"]
    assert "upright" in render_report(report)


def test_its_specification_is_valid() -> None:
    assert load_spec(SPECIFICATION.read_text(), SPECIFICATION.name).name == "recorded"
