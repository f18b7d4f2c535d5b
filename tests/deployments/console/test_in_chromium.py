"""The console in Chromium while real jobs run: from the first page to a failing job's video, as a newcomer clicks."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.browser import NEEDS_BROWSER, Browser, Page, browsing
from helpers.console_pages import check_rules
from helpers.endpoint_process import Serve, Served
from helpers.small_flat import ROLE
from helpers.time_lines import check_time_line

pytestmark = [pytest.mark.deep, NEEDS_BROWSER, pytest.mark.usefixtures("known_worlds"), pytest.mark.timeout(1200)]
JOBS = 2


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    with browsing(tmp_path / "profile") as browser:
        yield browser


def job(world: str, index: int) -> dict[str, Any]:
    """A drive through a world; the last one fails, and has a video."""
    fails = index == JOBS - 1
    return {
        "maxJobDurationInSeconds": 300,
        "iamRole": ROLE,
        "video": "on-failure" if fails else "none",
        "seed": index,
        "tags": {"number": str(index)},
        "requirements": [{"kind": "time_limit", "name": "quick", "limit_s": 1.0 if fails else 90.0}],
        "robotApplications": [{"application": "scout", "launchConfig": {}}],
        "simulationApplications": [
            {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": world}]}
        ],
    }


def order(served: Served, world: str) -> str:
    """Starts a batch of jobs, one at a time, and returns its id."""
    jobs = [job(world, index) for index in range(JOBS)]
    policy = {"maxConcurrency": 1, "timeoutInSeconds": 600}
    members = {"createSimulationJobRequests": jobs, "batchPolicy": policy}
    return served.call("StartSimulationJobBatch", members)["arn"].rpartition("/")[2]


def follow_link(page: Page, text: str, links: str = "main a") -> None:
    """Clicks the first of some links that has a text."""
    before = page.address
    those = f"[...document.querySelectorAll({json.dumps(links)})]"
    page.evaluate(f"{those}.find((each) => each.innerText.includes({json.dumps(text)})).click()")
    page.wait(lambda page: page.address != before and page.evaluate("document.readyState") == "complete", text)


def test_a_newcomer_comes_to_the_video_of_the_failing_job(
    serve: Serve, generate: Any, browser: Browser, prefect_server: str, axe: str, tmp_path: Path
) -> None:
    world = generate()["finishedWorldsSummary"]["succeededWorlds"][0]
    with serve(PREFECT_API_URL=prefect_server) as served, browser.page() as page:
        served.wait_until_ready()
        page.load(f"{served.url}/console", 1280)
        assert "Nothing runs now." in page.text
        batch = order(served, world)
        page.wait_for_text(batch, f"of {JOBS} jobs ended")  # the page was not loaded again
        check_rules(page, axe)
        follow_link(page, batch)
        page.evaluate("window.notLoadedAgain = true")
        page.wait_for_text(f"of {JOBS} jobs ended")
        check_rules(page, axe)
        page.wait_for_text(f"{JOBS - 1} of {JOBS} jobs ended")
        page.wait_for_text(f"{JOBS} of {JOBS} jobs ended", "failed", "quick: ended at")
        assert page.evaluate("window.notLoadedAgain")
        tiles = page.evaluate("[...document.querySelectorAll('.strip .tile')].map((each) => each.className)")
        assert tiles == [*["tile passed"] * (JOBS - 1), "tile failed"]
        follow_link(page, "quick: ended at")
        page.wait(
            lambda page: page.evaluate("document.querySelector('video[src$=\"/video.mp4\"]')?.duration") > 0.5, "film"
        )
        assert page.evaluate("document.querySelectorAll('svg .path').length") >= 1
        check_time_line(page, f"{page.address.partition('#')[0]}/files", tmp_path)
        check_rules(page, axe)
        follow_link(page, "two rooms", "main a[href*='/console/worlds/']")
        page.wait_for_text("all guarantees hold")
        check_rules(page, axe)
        for path in ("", "/failures", "/jobs", "/batches", "/worlds", "/runs", "/search?q=nothing"):
            page.load(f"{served.url}/console{path}", 1280)
            for width in (1280, 400):
                page.resize(width)
                page.wait(lambda page, width=width: page.evaluate("innerWidth") == width, f"{width} pixels")
                assert page.evaluate("document.documentElement.scrollWidth") <= width, path
            check_rules(page, axe)
        assert [each for each in page.complaints if "404" not in each] == []
        page.load(f"{served.url}/console", 1280)  # a page that is followed keeps the server from ending no longer
        served.process.terminate()
        assert served.process.wait(200) == 0, served.log.read_text()
    assert "Traceback" not in served.log.read_text()
