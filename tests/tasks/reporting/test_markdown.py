"""Markdown reports, rendered by an independent renderer of the dialect that GitHub and GitLab have."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import pytest
from helpers.night_records import make_job, make_night
from hypothesis import given
from hypothesis import strategies as st
from lxml import html  # pyright: ignore[reportAttributeAccessIssue] - compiled, without types
from markdown_it import MarkdownIt

from prefect_robomaker.schemas.reports.causes import AxisEffects, Effect, FailureGroup, NeededUnits, Why
from prefect_robomaker.schemas.reports.challenge import Challenge, ChallengedJob, SabotageResult
from prefect_robomaker.schemas.reports.changes import SinceLastRun
from prefect_robomaker.schemas.reports.report import (
    ArmComparison,
    AxisResult,
    Report,
    ReportedFile,
    ReportedJob,
    ReportedStep,
)
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.comparison.history import since_last_run
from prefect_robomaker.tasks.reporting import markdown_report, render_report, summarize


def page(text: str) -> Any:
    return html.fromstring(f"<body>{MarkdownIt('gfm-like', {'linkify': False, 'html': True}).render(text)}</body>")


FILES = [ReportedFile(name="result.json", uri="file:///outputs/result.json", size_bytes=2)]


@pytest.fixture
def report(mixed_report: Report) -> Report:
    jobs = [job.model_copy(update={"step": "drive", "files": FILES}) for job in mixed_report.jobs]
    return mixed_report.model_copy(update={"jobs": jobs})


def cells(text: str) -> list[list[str]]:
    """The rows of all tables, as people read them."""
    return [[cell.text_content() for cell in row.findall("td")] for row in page(text).iterfind(".//tbody/tr")]


def test_a_report_says_what_passed_and_why_the_rest_did_not(report: Report) -> None:
    text = markdown_report(summarize(report))

    assert text.startswith("<!-- robomaker report: nightly-flats -->\n")
    assert "2 of 5 jobs passed" in page(text).text_content()
    jobs = {row[0]: row[1:] for row in cells(text) if len(row) == 4}
    assert list(jobs) == ["w2", "w1 (2)", "w2 (2)"]
    assert jobs["w2"][0] == "broken"
    assert jobs["w1 (2)"][1]
    assert jobs["w1 (2)"][2].startswith("robomaker repro sim-")
    unrun = [job.model_copy(update={"files": []}) for job in report.jobs]
    text = markdown_report(summarize(report.model_copy(update={"jobs": unrun})))
    assert "robomaker repro" not in text, "there is nothing to repeat"


def test_a_report_says_first_what_is_new_since_the_last_run(report: Report) -> None:
    nights = [make_night([make_job(0, each, night=night, robot=each)], night) for night, each in enumerate("PF")]
    since = since_last_run([NightRun.of(each) for each in nights])
    text = markdown_report(summarize(report.model_copy(update={"since_last": since})))
    told = [item.text_content().strip() for item in page(text).iterfind(".//li")]
    missed = "gentle: newly missed in 1 of 1 trial; world and seed are the same, but application scout differs"
    assert told[:2] == [missed, f"newly failing: {since.newly_failing[0].cell.title}"]
    assert told[2].startswith("changed then: application scout ")


def test_a_requirement_says_in_how_many_jobs_it_does_not_count(report: Report) -> None:
    """A run that a goal ended is not judged by its environment: else nothing was met beside jobs that passed."""

    def asked(passed: bool) -> list[Requirement]:
        return [Requirement(name="rooms_visited", satisfied=False, detail="not visited: Bath", counts=not passed)]

    judged = [job for job in report.jobs if job.result is not None and job.result.verdict in ("PASS", "FAIL")]
    jobs = [
        job.model_copy(
            update={"result": job.result.model_copy(update={"requirements": asked(job.result.verdict == "PASS")})}
        )
        for job in judged
        if job.result is not None
    ]

    rows = [row for row in cells(markdown_report(summarize(report.model_copy(update={"jobs": jobs})))) if len(row) == 5]

    assert [row[:3] for row in rows] == [["rooms_visited (does not count in 2 jobs)", "0", "1"]]


def test_commands_are_never_cut(report: Report) -> None:
    command = f"robomaker run night.yaml {' '.join(f'--set parameter_{number}={number}' for number in range(20))}"
    refused = "a claim takes 10 failures, and there are 3; at this rate that takes 20 jobs instead of 6"
    group = FailureGroup(requirement="gentle", failed=9, job="sim-1", command=f"{command} --x", refused=refused)
    group = group.model_copy(update={"needed": NeededUnits(what="seeds", now=1, needed=4)})
    why = Why(trials=20, failed=9, groups=[group], again=command)

    text = markdown_report(summarize(report.model_copy(update={"why": why})))

    assert f"{refused}; then {command}" in page(text).text_content()
    assert ["gentle", "9", refused, f"{command} --x"] in cells(text)


def test_jobs_that_never_began_are_one_line(report: Report) -> None:
    world = report.worlds[0].arn
    unmade = [
        ReportedJob(
            label=f"request {each}", step="drive", status="NotCreated", failure_code="BatchCanceled", world_arn=world
        )
        for each in range(6, 9)
    ]
    stopped = report.model_copy(
        update={"jobs": [*report.jobs, *unmade], "against": "better than night-1", "stopped_early": True}
    )
    said = "3 jobs were not needed: it was decided before."
    for told in (markdown_report(summarize(stopped)), render_report(stopped)):
        assert told.count(said) == 1
        assert "request 7" not in told
    first = stopped.model_copy(update={"jobs": [*unmade, *report.jobs]})
    links = [re.findall(r'class="badge [a-z]+" href="#job-(\d+)"', render_report(each)) for each in (report, first)]
    assert [str(int(each) + len(unmade)) for each in links[0]] == links[1], "jobs of a world are its own"
    canceled = stopped.model_copy(update={"stopped_early": False, "state": "broken"})
    assert "3 jobs were not started: the batch was canceled before." in render_report(canceled)


def test_links_lead_to_the_console_where_one_is_known(report: Report) -> None:
    text = markdown_report(summarize(report, console_url="https://robots.example/console"))

    links = page(text).xpath("//a/@href")
    assert f"https://robots.example/console/runs/{report.run_id}" in links
    assert any(link.startswith("https://robots.example/console/jobs/") for link in links)


def test_the_answer_of_a_run_beside_an_earlier_one_is_told(report: Report) -> None:
    answer = "better than night-1: decided after 8 of 30 pairs; 18 trials saved"

    told = page(markdown_report(summarize(report.model_copy(update={"against": answer})))).text_content()

    assert answer in told
    assert "success rate" not in told, "its trials ended the run, so that their interval does not hold"


def test_a_challenge_has_its_sabotages_and_no_rate_of_sabotaged_robots(report: Report) -> None:
    challenge = Challenge(
        sabotages=[
            SabotageResult(name="idle", axes={"command_gain": 0}, caught=1, first="to|bed `x`", first_s=31.9),
            SabotageResult(name="slippery", axes={"robot_friction": 0.05}, missed=1),
        ],
        jobs=[
            ChallengedJob(name="job 1 in w1", control="passes"),
            ChallengedJob(name="job 2 in w2", control="fails", reason="@all: 300 N"),
        ],
    )

    text = markdown_report(summarize(report.model_copy(update={"challenge": challenge})))

    shown = page(text).text_content()
    assert "1 of 2 sabotages caught" in shown
    assert cells(text) == [
        ["idle", "caught by the only job, first by to|bed 'x' at 31.9 s"],
        ["slippery", "missed by the only job; nothing here would notice it"],
    ]
    assert "job 2 in w2: the robot fails here without a sabotage (@all: 300 N), so this job shows nothing" in shown
    assert not [each for each in ("success rate", "jobs passed", "did not pass", "smallest margin") if each in shown]

    nothing = challenge.model_copy(update={"jobs": challenge.jobs[1:]})
    text = markdown_report(summarize(report.model_copy(update={"challenge": nothing})))
    assert cells(text) == []
    assert "No job passes with the real robot" in page(text).text_content()


def test_a_step_that_failed_is_named(report: Report) -> None:
    step = ReportedStep(
        name="worlds", operation="CreateWorldGenerationJob", status="Failed", duration_s=1.0, detail="no flat fits"
    )

    text = markdown_report(summarize(report.model_copy(update={"jobs": [], "steps": [step], "state": "broken"})))

    assert "no simulation jobs" in text
    assert "no flat fits" in page(text).text_content()


@given(reason=st.text(max_size=300) | st.sampled_from(["@all | `x` <script>alert(1)</script>", "\\| a \\", "-->", "|"]))
def test_messages_of_robots_are_texts(reason: str) -> None:
    """Whatever a robot wrote is shown as code: no tag, no mention, no cell of its own."""
    job = ReportedJob(label="sim-1", step="drive", arn="arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-1",
                      status="Failed", failure_code="InternalServiceError", failure_reason=reason)  # fmt: skip
    step = ReportedStep(name="drive", operation="StartSimulationJobBatch", status="Failed", duration_s=1, detail="")
    moment = datetime(2026, 3, 2, 9, 30, tzinfo=UTC)
    report = Report.model_validate(
        {"name": reason or "n", "run_id": "r", "state": "broken", "started_at": moment, "ended_at": moment,
         "steps": [step], "worlds": [], "jobs": [job], "command": "robomaker run x"}
    )  # fmt: skip

    shown = page(markdown_report(summarize(report)))

    (row,) = shown.iterfind(".//tbody/tr")
    assert len(row.findall("td")) == 4
    assert {each.tag for each in shown.iter() if isinstance(each.tag, str)} <= {
        "div", "body", "h3", "p", "code", "strong", "details", "summary", "table", "thead", "tbody", "tr", "th", "td",
    }  # fmt: skip
    why = row.findall("td")[2]
    assert (why.text or "").strip() == "", "a text that is not in a code span"


def test_failures_that_are_known_are_counted_apart(report: Report) -> None:
    [failed] = [job for job in report.jobs if job.result and job.result.verdict == "FAIL"]

    def head(*known: str) -> str:
        twice = [*report.jobs, failed.model_copy(update={"label": "sim-other"})]
        jobs = [job.model_copy(update={"known": "anna" * (job.label in known)}) for job in twice]
        return markdown_report(summarize(report.model_copy(update={"jobs": jobs}))).split("\n\n")[2]

    assert "· 2 failed ·" in head()
    assert "· 1 failed · 1 canceled · 1 known failure ·" in head(failed.label)
    assert "· 2 known failures ·" in head(failed.label, "sim-other")
    assert " failed" not in head(failed.label, "sim-other")


def test_effects_of_axes_are_told(report: Report) -> None:
    effects = [
        AxisEffects(axis="mass", effects=[Effect(on="", start=1, end=2, change=0.2, low=0.1, high=0.3, claim="all")]),
        AxisEffects(axis="grip", effects=[Effect(on="", start=1, end=2, change=0.0, low=-0.1, high=0.1)]),
    ]

    text = markdown_report(summarize(report.model_copy(update={"effects": effects})))

    assert ["mass", "changes failures", "all; failures +20 points (+10 to +30) from 1 to 2"] in cells(text)
    assert ["grip", "no effect shown", "failures +0 points (-10 to +10) from 1 to 2"] in cells(text)


def test_values_of_an_axis_are_compared_in_pairs(report: Report) -> None:
    arm = ArmComparison(
        baseline="scout", value="|rover|", answer="worse", why="8 pairs judged", pairs=8, unpaired=0, unjudged=0,
        other_requirements=0,
    )  # fmt: skip
    axes = [AxisResult(step="drive", axis="robot", shares=[], comparisons=[arm])]

    text = markdown_report(summarize(report.model_copy(update={"axes": axes})))

    assert ["drive", "robot: |rover| instead of scout", "passes less often", "8 pairs judged"] in cells(text)


def since_of_margins(*nights: Sequence[float]) -> SinceLastRun:
    """Changes between two nights whose jobs all pass, with the margins given."""
    runs = []
    for number, margins in enumerate(nights):
        jobs = [make_job(index, "P", night=number) for index in range(len(margins))]
        met = [
            [job.requirements[0].model_copy(update={"margin": each})] for job, each in zip(jobs, margins, strict=True)
        ]
        told = [job.model_copy(update={"requirements": each}) for job, each in zip(jobs, met, strict=True)]
        runs.append(NightRun.of(make_night(told, number)))
    return since_last_run(runs)


def test_margins_that_fell_are_listed(report: Report) -> None:
    """All jobs pass both times, with smaller margins: about 4 N of 5 N, then 1 N."""
    since = since_of_margins((3.9, 4.0, 4.1), (1.0, 1.0, 1.0))
    said = page(markdown_report(summarize(report.model_copy(update={"since_last": since})))).text_content()
    assert "margin of gentle fell: 4 → 1 N on average of 3 pairs, -3 N, by more than chance" in said
    assert "gentle fell in 3 of 3 pairs, most in drive: world-3 scout, seed 7: 4.1 → 1 N" in said
    rendered = render_report(report.model_copy(update={"since_last": since}))
    assert "margin of gentle fell: 4 → 1 N" in rendered
    assert "fell most here, 4.1 → 1 N; in 3 of 3 pairs it fell" in rendered


def test_a_margin_that_may_have_fallen_by_chance_is_no_news(report: Report) -> None:
    since = since_of_margins((3.0, 4.0, 1.0), (2.9, 1.0, 1.0))
    changed = report.model_copy(update={"since_last": since})
    assert "margin of gentle fell" not in markdown_report(summarize(changed))
    assert "No verdict changed: 3 jobs pass as before. Margins may have moved" in render_report(changed)
