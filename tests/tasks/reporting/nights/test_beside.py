"""Cards of two jobs side by side: what they say of the first miss is about one requirement."""

import re
from typing import Any

import pytest
from helpers.night_records import make_job, make_night

from prefect_robomaker.schemas.reports.comparison import NeededPairs
from prefect_robomaker.schemas.reports.report import ReportedFile
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.comparison.better_or_worse import compare
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.reporting.nights.beside import Drive, PairPainter
from prefect_robomaker.tasks.reporting.nights.comparison_view import ComparedSide, ComparisonPage
from prefect_robomaker.tasks.reporting.render import render_page


def test_the_place_of_the_first_miss_is_that_of_the_named_requirement() -> None:
    missed = [
        Requirement(name="z_soft", satisfied=False, detail="", first_violation_s=2.0, room="Hall", other="chair_3"),
        Requirement(name="a_slow", satisfied=False, detail="", first_violation_s=2.0, room="Bath"),
    ]
    job = make_job(0, "F").model_copy(update={"requirements": missed})
    card = PairPainter(lambda *_: "").card(1, (job, job), "drive", [], (Drive(), Drive()))
    assert [side.first_miss for side in card.sides] == ["first missed a slow at 2.0 s, in Bath"] * 2


def test_jobs_with_trials_say_where_their_paths_and_videos_are() -> None:
    own = Requirement(name="trials", satisfied=False, detail="1 of 3 trials did not pass: 1")
    job = make_job(0, "F").model_copy(update={"requirements": [own]})
    file = ReportedFile(name="trials/000001/video.mp4", uri="file:///v.mp4", size_bytes=9)
    filmed, silent = Drive(video_policy="always", files=[file]), Drive(video_policy="always")
    card = PairPainter(lambda *_: "").card(1, (job, job), "drive", [], (filmed, silent))
    assert card.note == "Both have trials; the page of a job shows the path of each that was recorded."
    assert [side.no_film for side in card.sides] == [
        "No video of the job: its trials have their own.",
        "No video is stored.",
    ]


@pytest.mark.parametrize(
    ("basis", "more", "words"),
    [
        ("10 points", 6, "To show a difference of 10 points it takes 78 pairs, 6 more than these."),
        ("as found", 0, "To show a difference of 10 points it takes 78 pairs, and there are as many."),
        ("margin", 6, "To exclude a fall by 10 points it takes 78 pairs, 6 more than these."),
    ],
)
def test_a_page_says_how_many_pairs_it_takes(basis: Any, more: int, words: str) -> None:
    nights = [NightRun.of(make_night("PPFF", 0)), NightRun.of(make_night("PFPF", 1))]
    needed = NeededPairs(basis=basis, difference=0.1, discordant=0.2, power=0.8, pairs=78, more=more)
    comparison = compare(*nights).model_copy(update={"needed": needed})
    before, after = [ComparedSide(letter, letter, run.run_id) for letter, run in zip("AB", nights, strict=True)]
    page = ComparisonPage("nightly", before, after, comparison, [], 0, 0, 0, 1, [], [])
    html = render_page("comparison.html.j2", ("history.css", "comparison.css"), page)
    assert words in " ".join(re.sub("<[^>]+>", "", html).split())


@pytest.mark.parametrize(("of_trials", "noun"), [(False, "jobs"), (True, "trials")])
def test_the_heading_of_pass_rates_names_what_is_counted(of_trials: bool, noun: str) -> None:
    nights = [NightRun.of(make_night("PPFF", 0)), NightRun.of(make_night("PFPF", 1))]
    comparison = compare(*nights)
    comparison = comparison.model_copy(update={"trials": 9}) if of_trials else comparison
    before, after = [ComparedSide(letter, letter, run.run_id) for letter, run in zip("AB", nights, strict=True)]
    page = ComparisonPage("nightly", before, after, comparison, [], 0, 0, 0, 1, [], [])
    assert f"Pass rates of 4 pairs of {noun} that" in render_page("comparison.html.j2", ("history.css",), page)
