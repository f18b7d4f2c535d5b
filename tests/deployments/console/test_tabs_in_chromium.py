"""Many pages of the console open at once in one browser, which opens six connections to a server."""

from contextlib import ExitStack
from pathlib import Path

import pytest
from helpers.browser import NEEDS_BROWSER, browsing
from helpers.endpoint_here import ServeHere
from helpers.endpoint_process import Serve

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.deep, NEEDS_BROWSER, pytest.mark.timeout(1200)]
TABS = 7


def test_pages_that_are_not_looked_at_keep_no_connection(serve: Serve, tmp_path: Path) -> None:
    with serve("--execute", "none") as served, browsing(tmp_path / "profile") as browser, ExitStack() as stack:
        tabs = [stack.enter_context(browser.page()) for _ in range(TABS)]
        for tab in tabs:
            tab.send("Page.bringToFront")
            tab.load(f"{served.url}/console", 1280)
            tab.wait(lambda tab: tab.evaluate("typeof source === 'object' && source?.readyState === 1"), "a stream")
        tabs[0].wait(lambda tab: tab.evaluate("document.hidden && source === null"), "an end of the stream")
        tabs[0].send("Page.bringToFront")
        tabs[0].wait(lambda tab: tab.evaluate("source?.readyState === 1"), "a new stream")
        served.process.terminate()
        tabs[0].wait_for_text("The server does not answer")


def test_more_windows_than_connections_all_follow(serve_here: ServeHere, tmp_path: Path, service: Service) -> None:
    """Of windows that are looked at, each shows what begins; and there is a connection left for a page."""
    with serve_here() as served, browsing(tmp_path / "profile") as browser, ExitStack() as stack:
        first = stack.enter_context(browser.page())
        windows = [first, *(stack.enter_context(browser.page(beside=first)) for _ in range(TABS - 1))]
        for window in windows:
            window.load(f"{served.url}/console", 1280)
            assert window.evaluate("!document.hidden && Boolean(navigator.locks)")
        document = SimulationJobDocument.model_validate({"request": {}, "seed": 3})
        job = service.store_job("simulation-job", "sim", document, tags=None, token=None, status="Running").id
        for window in windows:
            window.wait_for_text(job)
        assert sum(window.evaluate("givePlaceUp !== null") for window in windows) == 4
        assert sum(window.evaluate("source !== null") for window in windows) <= 5
        windows[-1].load(f"{served.url}/console/jobs/{job}", 1280)
        windows[0].load(f"{served.url}/console/jobs", 1280)  # its place is another's
        windows[-2].wait(lambda _: sum(each.evaluate("givePlaceUp !== null") for each in windows[1:-1]) == 4, "a place")
