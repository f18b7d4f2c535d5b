"""The path of a running job on its page, as it grows."""

import json
from pathlib import Path
from typing import Any

import pytest
from helpers.browser import NEEDS_BROWSER, browsing
from helpers.console_pages import check_rules
from helpers.endpoint_here import ServeHere

from prefect_robomaker.deployments.console.timelines.live_runs import drive_in
from prefect_robomaker.tasks.runtime.episode.progress import PATH_FILE
from prefect_robomaker.tasks.service.service import Service

pytestmark = pytest.mark.usefixtures("known_worlds")
RUNNING = {"run_id": "run-1"}


def request_in(world: str) -> dict[str, Any]:
    return {"simulationApplications": [{"application": "indoor-navigation", "worldConfigs": [{"world": world}]}]}


def work_of(job: str, service: Service) -> Path:
    return service.folder("jobs", job, "run-1", "work")


def parts_of(content: str) -> list[dict[str, str]]:
    """Parts of the page that a stream sends."""
    blocks = [block.splitlines() for block in content.split("\n\n")]
    return [json.loads(data[6:]) for name, data in (b for b in blocks if len(b) == 2) if name == "event: parts"]


@pytest.fixture
def looked(browser: Any, service: Service, monkeypatch: pytest.MonkeyPatch) -> Any:
    """What a page that follows a job is sent; the job ends at the second look, or at a later one."""
    monkeypatch.setattr("prefect_robomaker.deployments.console.jobs._EVERY_S", 0.01)
    read = service.catalog.get

    def look(job: str, *between: Any) -> list[dict[str, str]]:
        arn, acts = service.arn("simulation-job", job), iter([lambda: None, *between])

        def get(*words: str, **more: str) -> object:
            if (act := next(acts, None)) is not None:
                act()
            else:
                service.catalog.transition(arn, "terminate")
                service.catalog.transition(arn, "complete")
            return read(*words, **more)

        monkeypatch.setattr("prefect_robomaker.deployments.console.jobs.world_of", known)
        monkeypatch.setattr(service.catalog, "get", get)
        return parts_of(browser.get(f"/console/jobs/{job}/live").text)

    from prefect_robomaker.deployments.console.timelines import live_runs

    def known(*words: Any) -> Any:  # it asks the same catalog
        with monkeypatch.context() as context:
            context.setattr(service.catalog, "get", read)
            return live_runs.world_of(*words)

    return look


def test_the_path_grows_on_the_plan(browser: Any, looked: Any, store_job: Any, generate: Any, service: Service) -> None:
    world = generate()["finishedWorldsSummary"]["succeededWorlds"][0]
    job = store_job("Running", request=request_in(world), **RUNNING)
    page = browser.get(f"/console/jobs/{job}").text
    assert '<g id="drive"/>' in page
    assert f"Plan of two rooms 1 with the path of {job} so far" in page
    note = work_of(job, service) / PATH_FILE

    def add(*lines: str) -> None:
        with note.open("a") as file:
            file.writelines(f"{line}\n" for line in lines)

    sent = looked(job, lambda: add("0,0,0", "0.5,0.5,0"), lambda: add("1,1,0"), lambda: None)
    drawn = [parts["drive"] for parts in sent if "drive" in parts]

    assert drawn[0] == ""
    assert ["<polyline" in each for each in drawn] == [False, True, True]
    assert all('class="now"' in each for each in drawn[1:])
    assert drawn[1] != drawn[2]


def test_a_path_that_is_a_link_is_not_followed(
    store_job: Any, generate: Any, service: Service, tmp_path: Path, looked: Any
) -> None:
    world = generate()["finishedWorldsSummary"]["succeededWorlds"][0]
    job = store_job("Running", request=request_in(world), **RUNNING)
    (tmp_path / "others.csv").write_text("0,0,0\n1,1,1\n")
    (work_of(job, service) / PATH_FILE).symlink_to(tmp_path / "others.csv")
    assert "polyline" not in str(looked(job))


def test_it_says_when_the_job_runs_on_another_machine(looked: Any, store_job: Any) -> None:
    parts, *_ = looked(store_job("Running", **RUNNING))
    assert "runs on another machine" in parts["live-view"]


@pytest.mark.parametrize("world", ["", "arn:aws:robomaker:us-east-1:000000000000:world/generation-1/world-1"])
def test_a_job_in_no_world_that_is_there_has_no_plan(browser: Any, store_job: Any, world: str) -> None:
    job = store_job("Running", request=request_in(world) if world else {}, **RUNNING)
    page = browser.get(f"/console/jobs/{job}")
    assert page.status_code == 200
    assert "Path so far" not in page.text
    assert drive_in(None, None) == ""


@pytest.mark.deep
@NEEDS_BROWSER
def test_the_path_is_seen_in_chromium(
    serve_here: ServeHere, store_job: Any, generate: Any, service: Service, tmp_path: Path, axe: str
) -> None:
    world = generate()["finishedWorldsSummary"]["succeededWorlds"][0]
    job = store_job("Running", request=request_in(world), **RUNNING)
    note = work_of(job, service) / PATH_FILE
    with serve_here() as served, browsing(tmp_path / "profile") as browser, browser.page() as page:
        for width in (400, 1280):
            page.load(f"{served.url}/console/jobs/{job}", width)
            assert page.evaluate("document.documentElement.scrollWidth") <= width
        for number in range(3):
            with note.open("a") as file:
                file.write(f"{number},{0.4 * number},{0.2 * number}\n")
            page.wait(
                lambda page, count=number + 1: (
                    page.evaluate("document.querySelector('#drive .casing')?.getAttribute('points').split(' ').length")
                    == count
                ),
                "the path",
            )
        assert page.evaluate("document.querySelector('#drive .now').getBoundingClientRect().width > 0")
        check_rules(page, axe)
        assert page.complaints == []
