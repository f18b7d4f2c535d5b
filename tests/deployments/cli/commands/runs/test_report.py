"""report: the numbers of a run, for people, programs and CI systems."""

import json
import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from helpers.cartpole_spec import PACKAGE, poles
from helpers.paths import REPOSITORY
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue] - compiled, without types

from prefect_robomaker.schemas.reports.report import ReportSummary
from prefect_robomaker.schemas.reports.run_record import RunRecord, StepRecord

SCHEMA = REPOSITORY / "tests" / "tasks" / "reporting" / "junit.xsd"
# Passes, fails, breaks: a second is not over, is over, and `math.sqrt` takes no two arguments.
REQUIREMENTS = (
    "kind: time_limit, limit_s: 1",
    "kind: time_limit, limit_s: 0.1",
    "kind: predicate, attribute: math.sqrt",
)


@pytest.fixture
def record(home: Path) -> Path:
    """The record of a run in which a step failed."""
    folder = home / "runs" / "night-1"
    folder.mkdir(parents=True)
    moment = datetime(2026, 3, 2, tzinfo=UTC)
    step = StepRecord(
        name="worlds", operation="CreateWorldGenerationJob", status="Failed", started_at=moment, ended_at=moment,
        error="no world came out",
    )  # fmt: skip
    run = RunRecord(
        run_id="night-1", name="night", spec_path="night.yaml", state="broken", exit_code=3, started_at=moment,
        ended_at=moment, steps=[step], run_dir=folder,
    )  # fmt: skip
    (folder / "run.json").write_text(run.model_dump_json())
    return folder


def test_numbers_and_junit_say_the_same(robomaker: Any, record: Path, tmp_path: Path) -> None:
    junit = tmp_path / "junit.xml"
    told = robomaker("report", "night-1", "--junit", junit, "-o", "json")
    assert told.code == 0, told.err
    summary = ReportSummary.model_validate_json(told.out)
    assert (summary.state, summary.junit_path, summary.report_path) == ("broken", junit, record / "report.html")
    assert summary.steps[0].error == "no world came out"
    root = etree.parse(str(junit)).getroot()
    assert (root.get("tests"), root.get("errors")) == ("1", "1")


def test_markdown_has_the_run_in_its_first_lines(robomaker: Any, record: Path, tmp_path: Path) -> None:
    markdown = tmp_path / "report.md"

    assert robomaker("report", "night-1", "--markdown", markdown).code == 0

    first, _, heading, *_ = markdown.read_text().splitlines()
    assert first.startswith("<!-- robomaker report: ")
    assert heading.endswith(": broken")
    for printed in (("--markdown",), ("--markdown", "-")):
        assert robomaker("report", "night-1", *printed).out == markdown.read_text()
    behind = robomaker("report", "--markdown", "night-1")
    assert (behind.code, behind.out) == (2, "")
    assert "--markdown is night-1; name the run before it, robomaker report night-1 --markdown" in behind.err
    both = robomaker("report", "night-1", "-o", "json", "--markdown")
    assert (both.code, both.out) == (2, "")
    assert "--markdown without a file and -o json both print" in both.err


def test_the_report_of_a_copied_home_is_written_into_the_copy(
    robomaker: Any, record: Path, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(home, copy)
    before = {path.name: path.stat().st_mtime_ns for path in record.iterdir()}
    monkeypatch.setenv("ROBOMAKER_HOME", str(copy))

    told = robomaker("report", "night-1", "-o", "json")

    assert (told.code, told.err) == (0, "")
    assert json.loads(told.out)["report_path"] == str(copy / "runs" / record.name / "report.html")
    assert (copy / "runs" / record.name / "report.html").is_file()
    assert {path.name: path.stat().st_mtime_ns for path in record.iterdir()} == before
    shutil.rmtree(home)
    assert robomaker("report", "night-1").code == 0
    assert not home.exists()


def test_a_junit_file_needs_a_folder_that_exists(robomaker: Any, record: Path) -> None:
    told = robomaker("report", "--junit", "/nowhere/junit.xml")
    assert told.code == 2
    assert "--junit is /nowhere/junit.xml; it has to be a file in a folder that exists" in told.err


@pytest.mark.deep
def test_a_batch_of_a_pass_a_fail_and_an_error(
    robomaker_at_server: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec, junit = tmp_path / "poles.yaml", tmp_path / "junit.xml"
    spec.write_text(poles(*(f"requirements: [{{name: rule, {each}}}]" for each in REQUIREMENTS)))
    monkeypatch.setenv("PYTHONPATH", str(PACKAGE))
    monkeypatch.syspath_prepend(str(PACKAGE))

    ended = robomaker_at_server("run", spec)
    assert ended.code == 3, ended.err
    assert "poles: broken, 1 of 3 jobs passed, 1 broke," in ended.out
    told = robomaker_at_server("report", "--junit", junit, "-o", "json")
    summary = json.loads(told.out)
    assert summary["counts"] == {"broken": 1, "failed": 1, "passed": 1}
    (rule,) = (share for share in summary["requirements"] if share["name"] == "rule")
    assert (rule["passed"], rule["failed"], rule["errors"], rule["rate"]) == (1, 1, 1, 0.5)
    root = etree.parse(str(junit)).getroot()
    etree.XMLSchema(etree.parse(str(SCHEMA))).assertValid(root)
    assert [root.get(name) for name in ("tests", "failures", "errors")] == ["3", "1", "1"]
    assert "math.sqrt raised TypeError" in root.find(".//error").get("message")
