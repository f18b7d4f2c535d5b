"""JUnit files, read by an independent XML parser against a strict schema."""

from pathlib import Path
from typing import Any

import pytest
from helpers.examples import examples
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue] - compiled, without types

from prefect_robomaker.schemas.reports.report import Report, ReportedJob, ReportedStep
from prefect_robomaker.schemas.reports.run_exit_codes import EXIT_CODES
from prefect_robomaker.schemas.reports.run_record import JobRecord
from prefect_robomaker.schemas.reports.run_states import run_state
from prefect_robomaker.schemas.runs.plan import Verdict
from prefect_robomaker.tasks.reporting import junit_xml, summarize

SCHEMA = etree.XMLSchema(etree.parse(str(Path(__file__).with_name("junit.xsd"))))


def parsed(report: Report) -> Any:
    root = etree.fromstring(junit_xml(summarize(report)))
    SCHEMA.assertValid(root)
    return root


def facts(root: Any) -> dict[str, dict[str, str]]:
    """The lines of each test case's output, as `name: value`, by the case's name."""
    cases = {case.get("name"): case.findtext("system-out") or "" for case in root.iterfind(".//testcase")}
    return {name: dict(line.split(": ", 1) for line in text.splitlines()) for name, text in cases.items()}


@pytest.fixture
def report(mixed_report: Report) -> Report:
    jobs = [job.model_copy(update={"step": "drive"}) for job in mixed_report.jobs]
    return mixed_report.model_copy(update={"jobs": jobs})


def test_a_step_is_a_suite_and_a_job_a_case(report: Report) -> None:
    root = parsed(report)
    (suite,) = root
    assert suite.get("name") == "nightly-flats.drive"
    counts = {name: suite.get(name) for name in ("tests", "failures", "errors", "skipped")}
    assert counts == {"tests": "5", "failures": "1", "errors": "1", "skipped": "1"}
    assert {name: root.get(name) for name in ("tests", "failures", "errors")} == {
        "tests": "5", "failures": "1", "errors": "1",
    }  # fmt: skip
    cases = suite.findall("testcase")
    assert [case.get("name") for case in cases] == [
        "w1 (2)", "w2", "w1", "w2 (2)", "w2 (3)"
    ]  # fmt: skip
    assert [[child.tag for child in case] for case in cases] == [
        ["failure", "system-out"], ["error", "system-out"], ["system-out"], ["skipped", "system-out"], ["system-out"],
    ]  # fmt: skip


def test_pages_of_the_console_are_told(report: Report) -> None:
    jobs = [job.model_copy(update={"arn": f"arn:x:simulation-job/sim-{n}"}) for n, job in enumerate(report.jobs)]
    summary = summarize(report.model_copy(update={"jobs": jobs}), None, "https://robots.example/console")
    root = etree.fromstring(junit_xml(summary))
    SCHEMA.assertValid(root)
    properties = {each.get("name"): each.get("value") for each in root.iterfind(".//property")}
    assert properties["page"] == f"https://robots.example/console/runs/{report.run_id}"
    told = facts(root)
    assert told["w1"]["page"] == "https://robots.example/console/jobs/sim-0"
    assert all("page" in each for each in told.values())
    assert "page" not in {each.get("name") for each in parsed(report).iterfind(".//property")}


def test_fail_is_a_failure_and_what_broke_an_error(report: Report) -> None:
    root = parsed(report)
    failure, error = root.find(".//failure"), root.find(".//error")
    assert failure.get("type") == "FAIL"
    assert failure.get("message").startswith("rooms_visited: 4, at least 5 asked; collisions: 5")
    assert error.get("type") == "RobotApplicationCrash"
    assert error.get("message") == "ZeroDivisionError: division by zero"
    assert error.text.endswith("last log line")


def test_a_requirement_that_broke_is_an_error(report: Report) -> None:
    passed = report.jobs[0]
    assert passed.result is not None
    broken = passed.result.requirements[0].model_copy(
        update={"name": "rule", "satisfied": False, "error": "it raised KeyError", "detail": "could not be judged"}
    )
    result = passed.result.model_copy(update={"verdict": "ERROR", "requirements": [broken]})
    root = parsed(report.model_copy(update={"jobs": [passed.model_copy(update={"result": result})]}))
    assert root.find(".//error").get("type") == "ERROR"
    assert root.find(".//error").get("message") == "rule: could not be judged"
    assert root.find(".//failure") is None


def test_seed_world_and_outputs_are_told_once(report: Report) -> None:
    """They are lines of the job's output; the suite has only what all its jobs share."""
    root = parsed(report)
    told = facts(root)["w1"]
    assert (told["job"], told["seed"], told["world"]) == ("sim-pass1", "7", "generation-1/world-1")
    assert told["output"].startswith("file:///")
    assert told["PASS"] == "collisions: 0, at most 0 asked"
    properties = {each.get("name"): each.get("value") for each in root.iterfind(".//property")}
    assert properties == {"run": report.run_id, "operation": "StartSimulationJobBatch"}


def test_the_name_for_people_names_the_test_case(report: Report) -> None:
    named = [
        job.model_copy(update={"name": f"scout in flat {number}"}) for number, job in enumerate(report.jobs, start=1)
    ]
    root = parsed(report.model_copy(update={"jobs": named}))
    names = {name: told["test"] for name, told in facts(root).items()}
    assert names["scout in flat 1"] == "w1"
    assert sorted(names) == [f"scout in flat {number}" for number in range(1, 6)]


def test_test_cases_are_called_the_same_in_every_run(report: Report) -> None:
    """Neither the ids of worlds nor seeds are in their names, though they tell the jobs of one run apart."""

    def names(run: str, seed: int) -> list[str]:
        world = f"arn:aws:robomaker:us-east-1:000000000000:world/generation-{run}x33p9yxhhc/world-3"
        facts_ = {"application": "scout", "seed": seed, "step": "drive"}
        titles = [
            f"scout in flat 3 (generation-{run}x3), seed={seed}",
            f"scout in flat 3 (generation-{run}x3), seed={seed + 1}",
            f"scout in flat 3 (generation-{run}x3), seed={seed}, SPEED=2",
            f"scout in generation-{run}x33p9yxhhc/world-3",
            "",
        ]
        jobs = [
            report.jobs[0].model_copy(
                update=facts_ | {"label": f"sim-{run}{place}", "world_arn": world if place < 4 else None, "name": title}
            )
            for place, title in enumerate(titles)
        ]
        root = parsed(report.model_copy(update={"jobs": jobs, "state": "succeeded"}))
        assert facts(root)["request 5 scout"]["job"] == f"sim-{run}4"
        return [case.get("name") for case in root.iterfind(".//testcase")]

    assert names("q8", 5) == names("z2", 6) == [
        "scout in flat 3", "scout in flat 3 (2)", "scout in flat 3, SPEED=2", "scout in world-3", "request 5 scout",
    ]  # fmt: skip


def test_names_that_somebody_gave_stay_whole_in_test_cases(report: Report) -> None:
    """A blank and a word in brackets are no id, and an axis that is called `seed` is no seed of a run."""
    world = "arn:aws:robomaker:us-east-1:000000000000:world/import-q8x33p9yxhhc/world-1"
    titles = ["scout in Lab (wing-east)", "scout in Lab (wing-west)", "scout in Lab (import-q8x3)", "scout, seed=5"]
    jobs = [
        report.jobs[0].model_copy(
            update={"name": title, "world_arn": world, "axes": {"seed": 5} if "seed" in title else {}}
        )
        for title in titles
    ]
    root = parsed(report.model_copy(update={"jobs": jobs, "state": "succeeded"}))
    assert [case.get("name") for case in root.iterfind(".//testcase")] == [*titles[:2], "scout in Lab", titles[3]]


def test_a_step_that_failed_without_jobs_is_an_error(report: Report) -> None:
    step = ReportedStep(
        name="worlds", operation="CreateWorldGenerationJob", status="Failed", duration_s=1.0, detail="no world came out"
    )
    root = parsed(report.model_copy(update={"jobs": [], "steps": [step]}))
    assert (root.get("tests"), root.get("errors")) == ("1", "1")
    assert root.find(".//error").text == "no world came out"


def test_nothing_was_run(report: Report) -> None:
    assert len(parsed(report.model_copy(update={"jobs": [], "steps": [], "state": "succeeded"}))) == 0


@examples(40, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(text=st.text(min_size=1))
def test_any_text_can_be_written(report: Report, text: str) -> None:
    job = report.jobs[2].model_copy(update={"failure_reason": text, "label": text, "failure_code": text})
    parsed(report.model_copy(update={"jobs": [job], "name": text}))


_ENDS: dict[str, dict[str, Any]] = {
    "passed": {"status": "Completed"},
    "failed": {"status": "Completed"},
    "error": {"status": "Completed"},
    "none": {"status": "Completed"},
    "crashed": {"status": "Failed", "failure_code": "RobotApplicationCrash", "failure_reason": "it fell"},
    "canceled": {"status": "Canceled"},
    "never created": {"status": "NotCreated", "failure_code": "InvalidInput", "failure_reason": "no"},
    "batch canceled": {"status": "NotCreated", "failure_code": "BatchCanceled"},
    "timed out": {"status": "Canceled", "failure_code": "BatchTimedOut"},
    "timed out before": {"status": "NotCreated", "failure_code": "BatchTimedOut"},
    "canceled by its batch": {"status": "Canceled", "failure_code": "BatchCanceled"},
}
_VERDICTS: dict[str, Verdict] = {"passed": "PASS", "failed": "FAIL", "error": "ERROR", "none": "NONE"}


def ended(report: Report, status: str, ends: list[str], *, is_whole: bool = True) -> tuple[int, Any]:
    """The exit code of a run whose only step and whose jobs ended so, and its JUnit file."""
    result = report.jobs[0].result
    assert result is not None
    results = {
        end: result.model_copy(update={"verdict": verdict, "requirements": []}) for end, verdict in _VERDICTS.items()
    }
    jobs = [
        ReportedJob(label=f"sim-{number}", step="drive", result=results.get(end), **_ENDS[end])
        for number, end in enumerate(ends)
    ]
    records = [
        JobRecord(
            label=job.label,
            status=job.status,
            failure_code=job.failure_code,
            verdict=job.result.verdict if job.result else None,
        )
        for job in jobs
    ]
    state = run_state([status], records, is_whole=is_whole)
    step = ReportedStep(name="drive", operation="StartSimulationJobBatch", status=status, duration_s=1.0)
    return EXIT_CODES[state], parsed(report.model_copy(update={"state": state, "steps": [step], "jobs": jobs}))


@pytest.mark.parametrize(
    ("status", "ends", "is_whole", "code"),
    [
        ("Completed", ["passed", "none"], True, 0),
        ("Completed", ["passed", "failed"], True, 1),
        ("Completed", ["error", "passed"], True, 3),
        ("Completed", ["crashed", "passed"], True, 3),
        ("Failed", ["passed"], True, 3),
        ("Failed", [], True, 3),
        ("PartialFailed", [], True, 3),
        ("Canceled", ["passed", "canceled", "batch canceled"], True, 4),
        ("Completed", ["passed", "canceled"], True, 4),
        ("Completed", ["passed"], False, 4),
        ("Skipped", [], False, 4),
        ("TimedOut", ["timed out", "passed"], True, 5),
        ("TimedOut", ["timed out before"], True, 5),
        ("TimedOut", ["passed"], True, 5),
    ],
)
def test_no_failure_and_no_error_mean_exit_code_0(
    report: Report, status: str, ends: list[str], is_whole: bool, code: int
) -> None:
    found, root = ended(report, status, ends, is_whole=is_whole)
    assert found == code
    assert (root.get("failures") == root.get("errors") == "0") == (code == 0)
    assert len(root.findall(".//error")) == int(root.get("errors"))
    assert (root.get("failures") != "0") == ("failed" in ends)


def test_jobs_that_the_timeout_of_their_batch_ended_are_errors_with_the_reason(report: Report) -> None:
    code, root = ended(report, "TimedOut", ["passed", "timed out", "timed out before"])
    assert (code, root.get("errors")) == (5, "2")
    assert {(each.get("type"), each.get("message")) for each in root.iterfind(".//error")} == {
        ("BatchTimedOut", "the timeout of its batch was over")
    }
    assert root.find(".//skipped") is None


@given(
    st.sampled_from(["Completed", "Failed", "PartialFailed", "Canceled", "TimedOut", "Skipped"]),
    st.lists(st.sampled_from(sorted(_ENDS)), max_size=4),
    st.booleans(),
)
@examples(60, suppress_health_check=(HealthCheck.function_scoped_fixture,))
def test_junit_files_agree_with_the_exit_code_however_a_run_ends(
    report: Report, status: str, ends: list[str], is_whole: bool
) -> None:
    code, root = ended(report, status, ends, is_whole=is_whole)
    assert (root.get("failures") == root.get("errors") == "0") == (code == 0)
