"""The page of a history, and the beginning of a report: what they say, escape and draw."""

import re
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from helpers.browser import NEEDS_BROWSER, browsing
from helpers.night_records import make_job, make_night, make_trials_night
from PIL import Image

from prefect_robomaker.deployments.cli.output.comparison import history_lines
from prefect_robomaker.deployments.console.rendering import since_briefly
from prefect_robomaker.schemas.reports.changes import ChangedInput
from prefect_robomaker.schemas.reports.history import History
from prefect_robomaker.schemas.reports.run_record import BEFORE_STEPS, StepRecord
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.comparison.history import history_of, since_last_run
from prefect_robomaker.tasks.reporting import render_history, render_report, write_history
from prefect_robomaker.tasks.reporting.answer import news_in_words
from prefect_robomaker.tasks.reporting.nights.changes import change_in_words
from prefect_robomaker.tasks.reporting.nights.charts import outcome_strip, rate_chart

ATTACK = "</title></script><script>alert(1)</script><img src=x onerror=alert(2)>\"'&"
RUNS = Path("/home/ann/runs")


def history(*letters: str, **members: Any) -> History:
    nights = [make_night(each, index, runs=RUNS, **members) for index, each in enumerate(letters)]
    return history_of("nightly", [NightRun.of(each) for each in nights])


def test_the_page_says_what_a_reader_wants_to_know() -> None:
    html = render_history(history("PPPP", "PFPE", "PFFP", "CCCC"), RUNS.parent / "history")
    for expected in (
        "4 runs; nothing was judged in the last one",
        "Failing now",
        "passed and failed with the same inputs",
        'href="../runs/nightly-20260302T020000000/report.html"',
        "drive: world-2 scout, seed 7",
        ">gentle<",
        "nothing that is recorded",
    ):
        assert expected in html
    assert html.count('class="night"') == 4
    assert re.search(r"default-src &#39;none&#39;", html)
    assert "http://" not in html.replace("http://www.w3.org", "")


def test_one_run_has_a_page() -> None:
    html = render_history(history("PF"), RUNS)
    assert "No earlier run of the specification has results here" in html
    assert "1 run; 1 of 2 jobs passed in the last one" in html


def test_trials_that_broke_are_said_once(tmp_path: Path) -> None:
    made = history_of("nightly", [NightRun.of(make_trials_night(["PPFEE"], runs=tmp_path))])
    told = made.nights[0].passed_in_words
    assert told == "0 of 1 job passed (2 of 5 trials passed, 2 broke)"
    assert f"1 run; {told} in the last one<" in render_history(made, RUNS)
    assert "1 run; 1 of 2 jobs passed in the last one, 1 broke" in render_history(history("PE"), RUNS)


@pytest.mark.parametrize(("letters", "word"), [("PP", "passed"), ("PN", "succeeded")])
def test_a_run_is_passed_if_each_of_its_jobs_is(letters: str, word: str) -> None:
    found = history(letters)
    assert (found.nights[0].state, found.nights[0].shown_state) == ("succeeded", word)
    html = render_history(found, RUNS)
    assert f"The last run: <strong>{word}</strong> (" in html
    assert f"</svg>{word}</span>" in html


def test_what_copies_are_is_said_once(tmp_path: Path) -> None:
    nights = [make_trials_night(["PPPP"], night, runs=tmp_path, states="aaab") for night in (0, 1)]
    found = history_of("nightly", [NightRun.of(each) for each in nights])
    html, lines = render_history(found, tmp_path), "\n".join(history_lines(found, tmp_path))
    for text in (html, lines):
        assert "not counted" not in text
        assert text.lower().count("copies: trials that went through the same states") == 1
    assert lines.count(" 2 copies") == html.count("(2 copies)") == 2


def test_a_canceled_night_says_how_much_of_it_was_judged() -> None:
    nights = [make_night("P" * 6, 0, runs=RUNS), make_night("PPCCCC", 1, runs=RUNS)]
    nights[1] = nights[1].model_copy(update={"state": "canceled"})
    found = history_of("nightly", [NightRun.of(each) for each in nights])
    html = render_history(found, RUNS)
    lines = "\n".join(history_lines(found, RUNS))

    assert found.since_last.without_result == 4
    for text in (html, lines):
        assert "canceled, 2 of 6 jobs judged" in text
    share = found.nights[-1].success
    assert (share.passed, share.rate, share.low) == (2, None, None), "those that ended first are no sample"
    assert "100%" not in lines.partition("2026-03-02")[2].partition("2026-03-01")[0]
    assert "The last run: <strong>canceled</strong>" in html
    assert ">The last run against the one before</h2>" in html
    assert "4 jobs of this run have no result" in html
    assert "4 jobs of the last run have no result" in lines
    for silent in ("as before", "No verdict changed"):
        assert silent not in html
    assert since_briefly(found.since_last) == "4 jobs without a result"
    assert news_in_words(found.since_last) == "new since the last run: 4 jobs have no result"
    ended = history("PPPPPP", "PPPPPP")
    assert "No verdict changed: 6 jobs pass as before" in render_history(ended, RUNS)
    assert "judged" not in "\n".join(history_lines(ended, RUNS))


def test_a_run_without_results_of_its_own_says_why_in_the_chart() -> None:
    first = make_night("PF", 0, runs=RUNS)
    jobs = [job.model_copy(update={"reused_from": first.run_id}) for job in make_night("PF", 1).jobs]
    step = StepRecord(name=BEFORE_STEPS, operation="RunPipeline", status="Failed", error="no such robot")
    refused = make_night("", 2, runs=RUNS).model_copy(update={"state": "broken", "steps": [step]})
    nights = [first, make_night(jobs, 1, runs=RUNS), refused, make_night("CC", 3, runs=RUNS)]

    page = render_history(history_of("nightly", [NightRun.of(each) for each in nights]), RUNS)

    titles = re.findall(r"<title>\d[^:]*:[^:]*:[^:]*: ([^<\n]*)", page)
    assert titles == [
        "1 of 2 judged jobs passed", "taken over", "refused before its first step: no such robot", "nothing judged"
    ]  # fmt: skip
    marks = re.findall(r'class="(point|taken|none)"', page[page.index('class="chart"') : page.index("<figcaption>")])
    assert marks == ["point", "taken", "none", "none"]
    assert "all results taken over" in page[page.index("<figcaption>") :]


def test_runs_of_one_day_are_told_apart_by_their_times() -> None:
    nights = history("P", "F", "P").nights
    later = nights[1].model_copy(update={"started_at": nights[0].started_at + timedelta(hours=3)})
    chart = rate_chart([nights[0], later, nights[2]], ["a", "b", "c"])

    assert re.findall(r'class="date"[^>]*>([^<]+)<', chart) == ["3 Mar", "1 Mar", "05:00", "1 Mar", "02:00"]
    assert ":00<" not in rate_chart(nights, ["a", "b", "c"])


def test_names_and_reasons_are_escaped() -> None:
    job = make_job(0, "E").model_copy(update={"step": ATTACK, "test": ATTACK, "failure_reason": ATTACK})
    night = make_night([job], 0, runs=RUNS).model_copy(update={"versions": {ATTACK: ATTACK}})
    later = make_night([job], 1, runs=RUNS)
    found = history_of(ATTACK, [NightRun.of(night), NightRun.of(later)])
    html = render_history(found, RUNS)
    assert html.count("<script>") == 1
    assert "<img" not in html


def test_a_report_says_what_changed(mixed_report: Any) -> None:
    labels = [job.label for job in mixed_report.jobs]
    before, after = make_night("PPFPP", 0), make_night("PFFPP", 1)
    jobs = [job.model_copy(update={"label": label}) for job, label in zip(after.jobs, labels, strict=True)]
    since = since_last_run([NightRun.of(before), NightRun.of(after.model_copy(update={"jobs": jobs}))])
    html = render_report(mixed_report.model_copy(update={"since_last": since}))
    opening = html[html.index('class="since card"') : html.index('<section id="time"')]
    assert 'Newly failing <span class="count">1</span>' in opening
    assert '<a href="#job-2">drive: world-2 scout, seed 7</a>' in opening
    assert 'Still failing <span class="count">1</span>' in opening
    assert "of 2026-03-01 02:00:00 UTC" in opening
    nothing = since_last_run([NightRun.of(make_night("PP", night)) for night in (0, 1)])
    assert "No verdict changed: 2 jobs pass as before. Margins may have moved: " in render_report(
        mixed_report.model_copy(update={"since_last": nothing})
    )
    assert "Since the last run" not in render_report(mixed_report)


@pytest.mark.parametrize(("now", "heading"), [("PP", "Gone"), ("PPN", "No longer judged"), ("NNN", "No longer judged")])
def test_a_report_names_jobs_that_it_judges_no_more(now: str, heading: str, make_report: Any) -> None:
    since = since_last_run([NightRun.of(make_night(each, night)) for night, each in enumerate(("PPF", now))])
    html = render_report(make_report([], []).model_copy(update={"since_last": since}))
    opening = html[html.index('class="since card"') : html.index('<section id="time"')]
    assert f"<h3>{heading} <span" in opening
    assert "<strong>drive: world-3 scout, seed 7</strong>" in opening
    assert "failed before" in opening
    assert "No verdict changed" not in opening
    assert "No job" not in opening
    assert ("requirement gentle is not asked any more" in opening) == (now != "PP")


def test_a_run_without_results_is_not_said_to_have_other_jobs(make_report: Any) -> None:
    since = since_last_run([NightRun.of(make_night(each, night)) for night, each in enumerate(("PP", "CC"))])
    html = render_report(make_report([], []).model_copy(update={"since_last": since}))
    assert "No job of this run has a result." in html


def test_many_changes_are_folded(make_report: Any) -> None:
    since = since_last_run([NightRun.of(make_night(letter * 12, night)) for night, letter in enumerate("PF")])
    html = render_report(make_report([], []).model_copy(update={"since_last": since}))
    assert "<summary>4 more</summary>" in html
    assert html.count("All fail since 2026-03-02 02:00:00 UTC, 1 run") == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"what": "commit", "before": "a" * 40, "after": "b" * 40}, "commit aaaaaaaa → bbbbbbbb"),
        ({"what": "application", "name": "scout", "before": "1" * 64, "after": "sha256:" + "2" * 64},
         "application scout 11111111 → 22222222"),
        ({"what": "version", "name": "mujoco", "before": "3.17.0", "after": "3.18.0"}, "mujoco 3.17.0 → 3.18.0"),
        ({"what": "application", "name": "scout", "after": "1" * 64}, "application scout 11111111 is new"),
        ({"what": "application", "name": "scout", "after": ""}, "application scout is new"),
        ({"what": "application", "name": "scout", "before": "1" * 64, "after": ""},
         "application scout 11111111 → not loaded"),
        ({"what": "application", "name": "scout", "before": f", {'1' * 64}", "after": "2" * 64},
         "application scout not loaded, 11111111 → 22222222"),
        ({"what": "version", "name": "numpy", "before": "2"}, "numpy is gone"),
        ({"what": "request"}, "its request"),
    ],
)  # fmt: skip
def test_changes_in_words(change: dict[str, str], words: str) -> None:
    assert change_in_words(ChangedInput.model_validate(change)) == words


def test_a_strip_has_a_box_for_each_outcome() -> None:
    strip = outcome_strip(["passed", None, "failed", "no verdict", "passed"])
    assert 'd="M0 10h8v6h-8zM40 10h8v6h-8z"' in strip
    assert 'class="failed" d="M20 0h8v16h-8z"' in strip
    assert 'class="unjudged" d="M30 7h8v2h-8z"' in strip
    assert 'viewBox="0 0 50 16"' in strip
    assert "2 passed, 1 failed, 1 no verdict" in strip


@NEEDS_BROWSER
def test_a_browser_shows_the_page_without_scrolling_sideways(tmp_path: Path) -> None:
    path = write_history(history("PPPPP", "PFPEP", "PFFPP", "CCCCC", "PFPPF"), tmp_path / "history.html")
    with browsing(tmp_path / "profile") as browser, browser.page() as tab:
        for width in (400, 1280):
            tab.load(path.as_uri(), width)
            wide = "[...document.querySelectorAll('.scroll')].filter(each => each.scrollWidth > each.clientWidth)"
            assert tab.evaluate(f"{wide}.map(each => each.outerHTML)") == []
            assert tab.evaluate("document.documentElement.scrollWidth") <= width
            assert tab.evaluate("document.querySelectorAll('.chart .night .point').length") == 4
            assert tab.evaluate("document.querySelector('.chart').getBoundingClientRect().width") > 0.7 * width
            assert tab.evaluate("document.querySelector('td .nights').getBoundingClientRect().width") > 90
        assert tab.complaints == []
        picture = tab.picture(tmp_path / "history.png")
    with Image.open(picture) as opened:
        # The colours of what passed and what failed are there: strips were drawn.
        colours = {colour for _, colour in opened.convert("RGB").getcolors(1_000_000) or []}
    assert {(0, 105, 77), (163, 63, 0)} <= colours
