"""Pages of a specification's history, and of two of its runs beside each other."""

import html
import re
from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_job, make_night, store_night

from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def runs(service: Service) -> Path:
    """Three nights of ten jobs: the last one is worse, and slower."""
    runs = service.settings.home / "runs"
    for night, verdicts in enumerate(("PPPPPPPPPP", "PPPPPPPPPF", "PPFFFFFFFF")):
        jobs = [
            make_job(index, letter, night=night, metrics={"duration_s": 10.0 + index + (night == 2) * 5})
            for index, letter in enumerate(verdicts)
        ]
        store_night(make_night(jobs, night, runs=runs))
    return runs


def test_a_history_is_plotted_and_leads_to_its_runs(browser: Any, runs: Path) -> None:
    page = browser.get(browser.get("/console/history").headers["location"]).text

    assert page.count('class="night"') == 3
    assert "2 of 10 jobs passed in the last one" in page
    assert "Failing now" in page
    found = set(re.findall(r'href="(/console/runs/[^"]+)"', page))
    assert found == {f"/console/runs/{folder.name}" for folder in runs.iterdir()}
    assert "style=" not in page


def test_a_history_grows_with_the_next_night(browser: Any, runs: Path) -> None:
    browser.get("/console/history/nightly")
    store_night(make_night("PPPPPPPPPP", 3, runs=runs))

    assert browser.get("/console/history/nightly").text.count('class="night"') == 4


def test_a_canceled_run_says_how_much_of_it_was_judged(browser: Any, runs: Path) -> None:
    canceled = make_night("PPPCCCCCCC", 4, runs=runs).model_copy(update={"state": "canceled"})
    store_night(canceled)
    for path in (f"/runs/{canceled.run_id}", ""):
        page = html.unescape(browser.get(f"/console{path}").text)
        assert "3 of 10 jobs passed, 3 judged" in page
        assert "nothing changed" not in page
        assert "7 jobs" in page
    assert "canceled, 3 of 10 jobs judged" in browser.get("/console/history/nightly").text


def test_two_runs_are_compared_as_a_plot(browser: Any, runs: Path) -> None:
    before, _, after = sorted(folder.name for folder in runs.iterdir())
    page = html.unescape(browser.get(f"/console/compare?before={before}&after={after}").text)

    assert "worse" in page
    assert "100 percent of A passed, 20 percent of B" in page
    assert "Passed: <strong>100.0\xa0%</strong> of A → <strong>20.0\xa0%</strong> of B" in page
    assert "Before<" not in page
    assert re.search(r"Newly failing .*?>8<", page)
    assert ">duration, s<" in page
    assert ">margin of gentle, N<" in page
    assert f"robomaker compare {before} {after}" in page


@pytest.mark.parametrize(
    "path", ["/history/none", "/history/%2e%2e", "/history/*", "/history/**", "/compare", "/compare?before=a&after=b"]
)
def test_what_has_no_runs_is_not_there(browser: Any, runs: Path, path: str) -> None:
    assert browser.get(f"/console{path}").status_code == 404


def test_a_run_is_not_compared_with_itself(browser: Any, runs: Path) -> None:
    run = next(runs.iterdir()).name
    answer = browser.get(f"/console/compare?before={run}&after={run}")

    assert (answer.status_code, "name two" in answer.text) == (404, True)
