"""The answer with which a report begins, and the order of what follows."""

import re
from typing import Any

import pytest
from helpers.night_records import make_night
from helpers.planted_causes import draw, planted

from prefect_robomaker.schemas.reports.causes import AxisEffects
from prefect_robomaker.schemas.reports.report import Report, ReportedFile
from prefect_robomaker.schemas.runs.trial_rows import SUMMARY_NAME
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.comparison.history import since_last_run
from prefect_robomaker.tasks.reporting import render_report
from prefect_robomaker.tasks.reporting.answer import news_in_words
from prefect_robomaker.tasks.reporting.outcomes import times_with_videos
from prefect_robomaker.tasks.reporting.report_view import view_report


@pytest.mark.parametrize(
    ("nights", "news"),
    [
        (["PP"], "there is no earlier run to compare it with"),
        (["PP", "PP"], "nothing is new since the last run"),
        (["PF", "PF"], "nothing is new since the last run, 1 still failing"),
        (["PPF", "FPP"], "1 job newly fails, 1 newly passes"),
        (["PPP", "FFP"], "2 jobs newly fail"),
        (["PPP", "PP"], "1 job is gone or checked less"),
        (["PP", "PPF"], "1 job fails without an earlier result"),
        # Fewer checks are no improvement, even where all that is left passes.
        (["PPP", "PPN"], "1 job is gone or checked less"),
    ],
)
def test_what_is_new_is_said_in_a_few_words(nights: list[str], news: str) -> None:
    since = since_last_run([NightRun.of(make_night(each, night)) for night, each in enumerate(nights)])
    assert news in news_in_words(since)


def test_a_report_begins_with_the_answer(mixed_report: Report) -> None:
    since = since_last_run([NightRun.of(make_night(each, night)) for night, each in enumerate(("PPF", "PP"))])
    html = render_report(mixed_report.model_copy(update={"since_last": since}))
    text = " ".join(re.sub("<[^>]+>", "", html[html.index("<h1>") : html.index('<dl class="run">')]).split())
    assert text.startswith(
        "nightly-flats Failed: 2 of 5 jobs passed; 1 broken, 1 failed, 1 canceled; new since the last run: 1 job is"
    )


def test_the_rate_of_a_canceled_run_says_how_many_were_judged(mixed_report: Report) -> None:
    html = render_report(mixed_report.model_copy(update={"state": "canceled"}))
    assert re.search(r'class="rate cut-short">\s*<p class="rate-number">.*<strong>3 of 5 jobs judged</strong>', html)
    assert "cut-short" not in render_report(mixed_report).partition("</style>")[2]


def test_a_run_without_jobs_tells_those_that_are_gone(make_report: Any) -> None:
    since = since_last_run([NightRun.of(make_night("PP", 0)), NightRun.of(make_night("", 1))])
    answer = view_report(make_report([], [], since_last=since)).answer
    assert answer == "Nothing was simulated; new since the last run: 2 jobs are gone or checked less"


def test_each_section_has_a_link_and_each_link_a_section_in_the_order_of_the_page(mixed_report: Report) -> None:
    since = since_last_run([NightRun.of(make_night(each, night)) for night, each in enumerate(("PP", "PP"))])
    effects = [AxisEffects(axis="mass")]
    for members in ({}, {"since_last": since, "effects": effects}, {"jobs": [], "worlds": [], "steps": []}):
        html = render_report(mixed_report.model_copy(update=members))
        nav = html[html.index('<nav aria-label="Sections">') : html.index("</nav>")]
        linked = re.findall(r'href="#([a-z]+)"', nav)
        assert linked == re.findall(r'<(?:section|div) id="([a-z]+)"', html)
    assert "What depends on which axis" in render_report(mixed_report.model_copy(update={"effects": effects}))


@pytest.mark.parametrize(
    ("requests", "words"),
    [
        ([{}], ("simulation", "videos of failures")),
        ([{"video": "on-failure"}], ("simulation", "videos of failures")),
        ([{}, {"video": "always"}], ("simulation with its videos", "last seconds of failures")),
        ([{"tags": {"robomaker:video": "always"}}], ("simulation with its videos", "last seconds of failures")),
        ([{"video": "on-failure", "trials": {"seeds": 3}}], ("simulation with its videos", "videos of failures")),
    ],
)
def test_the_times_of_videos_are_named_by_what_was_asked(
    requests: list[dict[str, Any]], words: tuple[str, str]
) -> None:
    assert times_with_videos(requests) == words


def with_trials(job: Any, make_result: Any) -> Any:
    """A job with three trials, of which the second failed and is recorded."""
    counts = {"passed": 2, "failed": 1}
    failing = {"trial": 1, "seed": 8, "verdict": "FAIL", "reason": "slow"}
    summary = {"planned": 3, "counts": counts, "failing": [failing], "recorded": [1]}
    result = make_result("FAIL", 3).model_copy(update={"path": [], "extra": {SUMMARY_NAME: summary}})
    names = ("result.json", "trials/000001/recording.mcap", "trials/000001/result.json")
    files = [ReportedFile(name=name, uri=f"file:///out/{name}", size_bytes=9) for name in names]
    return job.model_copy(update={"result": result, "files": files})


def test_a_job_with_trials_has_one_plan_with_the_path_of_a_trial(
    make_world: Any, make_job: Any, make_result: Any, make_report: Any
) -> None:
    world = make_world()
    job = with_trials(make_job("sim-1", world.arn), make_result)
    bare = view_report(make_report([world], [job]))
    assert bare.jobs[0].plan is None
    assert bare.jobs[0].plan_note == ""

    drawn = job.model_copy(update={"drawn_trial": 1, "drawn_result": make_result("FAIL", 3)})
    html = render_report(make_report([world], [drawn]))
    card = html[html.index('id="job-1"') : html.index("</article>")]
    assert card.count('class="plan') == 1
    assert "with the path of trial 1 of sim-1" in card
    assert "path of trial 1, 0 s" in card


def test_files_of_recorded_trials_are_folded_away(make_job: Any, make_result: Any, make_report: Any) -> None:
    html = render_report(make_report([], [with_trials(make_job("sim-1", None), make_result)]))
    card = html[html.index('id="job-1"') : html.index("</article>")]
    before, _, folded = card.partition('<details class="recorded">')
    assert "<summary>2 files of 1 recorded trial</summary>" in folded
    assert ">recording.mcap</a>" in folded
    assert "recording.mcap" not in before


def test_a_page_with_trials_says_what_it_counts(make_job: Any, make_result: Any, make_report: Any) -> None:
    page = render_report(make_report([], [make_job("sim-1", None, result=make_result("PASS", 9))]))
    assert "Judged are the trials" not in page
    assert "1 of 1 judged jobs passed" in page
    job = with_trials(make_job("sim-1", None), make_result)
    counted = render_report(make_report([], [job]), draw(planted("causes")[0], 1).table)
    assert re.search("[0-9]+ of [0-9]+ judged trials passed", counted)
    assert re.search(r"jobs? passed; 1 failed \([0-9]+ of [0-9]+ trials passed\)", counted)
    assert counted.count("Judged are the trials that passed or failed.") == 1


def test_times_say_whose_they_are(mixed_report: Report) -> None:
    html = render_report(mixed_report)
    assert "Simulated time <" in html
    assert "Wall time <" in html
    assert "Wall time is that of a job's run" in html
    assert ">Duration<" not in html


def test_a_known_failure_is_not_red_in_a_report_that_is_green(
    make_job: Any, make_result: Any, make_report: Any
) -> None:
    jobs = [make_job(name, None, result=make_result("FAIL", 3)) for name in ("sim-1", "sim-2")]
    jobs[0] = jobs[0].model_copy(update={"known": "ann, until 2026-04-01: slow"})
    page = view_report(make_report([], jobs))
    assert page.counts == {("unjudged", "known failure"): 1, ("failed", "failed"): 1}
    html = render_report(make_report([], jobs[:1], state="succeeded"))
    assert 'class="badge failed"' not in html
    assert 'class="tile failed"' not in html
    assert "known failure" in html
    assert "<strong>Succeeded</strong>: 0 of 1 job passed" in html


def test_a_report_whose_jobs_all_passed_says_passed(make_job: Any, make_result: Any, make_report: Any) -> None:
    jobs = [make_job("sim-1", None, result=make_result("PASS", 4))]
    html = render_report(make_report([], jobs, state="succeeded"))
    assert "<strong>Passed</strong>: 1 of 1 job passed" in html
