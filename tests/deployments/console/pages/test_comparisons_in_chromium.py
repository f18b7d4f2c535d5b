"""Two runs side by side in Chromium: axe-core's rules, two videos in step, and keys."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.browser import NEEDS_BROWSER, Page, browsing
from helpers.client_environments import node_modules
from helpers.console_pages import check_rules
from helpers.driven_runs import drive, two_runs
from helpers.endpoint_here import ServeHere

from prefect_robomaker.tasks.service.service import Service

pytestmark = [
    pytest.mark.deep, NEEDS_BROWSER, pytest.mark.usefixtures("known_worlds"), pytest.mark.timeout(1200),
]  # fmt: skip
CARD = "document.querySelector('#pair-1')"
TIMES = f"[...{CARD}.querySelectorAll('video')].map((each) => each.currentTime)"
ROBOTS = f"[...{CARD}.querySelectorAll('.robot')].map((each) => each.getAttribute('transform'))"


@pytest.fixture
def axe(pytestconfig: pytest.Config) -> str:
    folder = Path(__file__).parents[1] / "axe"
    return (node_modules(pytestconfig, folder) / "axe-core" / "axe.min.js").read_text()


@pytest.fixture
def tab(tmp_path: Path) -> Iterator[Page]:
    with browsing(tmp_path / "profile") as browser, browser.page() as page:
        yield page


@pytest.fixture
def address(generate: Any, service: Service, tmp_path: Path) -> str:
    """Address of two runs: of the first pair both have videos, of the second B, of the third none."""
    world = generate()["finishedWorldsSummary"]["succeededWorlds"][0]
    before = [
        drive(service, tmp_path, "P", world=world, night=0, index=0, seed=1, video="video.mp4"),
        drive(service, tmp_path, "P", world=world, night=0, index=1, seed=2, sway_m=0.1),
        drive(service, tmp_path, "P", world=world, night=0, index=2, seed=3),
    ]
    after = [
        drive(service, tmp_path, "F", world=world, night=1, index=0, seed=1, end_s=6, sway_m=-0.4, margin=-3,
              video="video.mp4"),
        drive(service, tmp_path, "F", world=world, night=1, index=1, seed=2, margin=-1, video="last-10s.mp4"),
        drive(service, tmp_path, "E", world=world, night=1, index=2, seed=3),
    ]  # fmt: skip
    robots = ("scout", "rover", "a robot with a long name that has to be broken somewhere")
    before, after = (
        [job.model_copy(update={"axes": {"robot": robot}}) for job, robot in zip(jobs, robots, strict=True)]
        for jobs in (before, after)
    )
    runs = two_runs(service, before, after, parameters={"gain": "-1"})
    return f"/console/compare?before={runs[0].run_id}&after={runs[1].run_id}"


def scrub(page: Page, time_s: float) -> None:
    """Moves the control to a time, as a hand does, and waits for both videos to be there."""
    move = f"bar.value = {time_s}; bar.dispatchEvent(new Event('input'))"
    page.evaluate(f"(() => {{ const bar = {CARD}.querySelector('.player input'); {move}; }})()")
    page.wait(lambda page: not page.evaluate(f"[...{CARD}.querySelectorAll('video')].some((e) => e.seeking)"), "seeks")


def test_videos_go_in_step_and_the_page_keeps_the_rules(
    serve_here: ServeHere, address: str, tab: Page, axe: str
) -> None:
    with serve_here() as served:
        for width, scheme in itertools.product((400, 1280), ("light", "dark")):
            tab.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
            tab.load(f"{served.url}{address}", width)
            assert tab.evaluate("document.documentElement.scrollWidth") <= width
        check_rules(tab, axe)
        run = address.rpartition("=")[2]
        cells = f"/console/compare/cells?run={run}&step=drive&axis=robot&first=0&other=2"
        for path, width in itertools.product((f"/console/runs/{run}", cells), (400, 1280)):
            tab.load(f"{served.url}{path}", width)
            assert tab.evaluate("document.documentElement.scrollWidth") <= width, path
            check_rules(tab, axe)
        tab.load(f"{served.url}{address}", 1280)
        ready = f"[...{CARD}.querySelectorAll('video')].every((each) => each.readyState > 1)"
        tab.wait(lambda page: page.evaluate(ready), "videos")
        assert tab.evaluate(f"[...{CARD}.querySelectorAll('video')].some((each) => each.controls)") is False
        scrub(tab, 2.0)
        assert tab.evaluate(TIMES) == pytest.approx([2.0, 2.0], abs=0.05)
        at_two = tab.evaluate(ROBOTS)
        scrub(tab, 5.0)  # A has ended at 4 s
        ended, late = tab.evaluate(TIMES)
        assert ended == pytest.approx(4.1, abs=0.11)
        assert late == pytest.approx(5.0, abs=0.05)
        assert tab.evaluate(ROBOTS)[1] != at_two[1]
        scrub(tab, 0.0)
        tab.evaluate(f"{CARD}.querySelector('.player button').click()")
        tab.wait(lambda page: page.evaluate(TIMES)[1] > 1.0, "a second of both")
        one, other = tab.evaluate(TIMES)
        assert abs(one - other) < 0.5
        tab.evaluate(f"{CARD}.querySelector('.player button').click()")
        assert tab.evaluate(f"[...{CARD}.querySelectorAll('video')].every((each) => each.paused)")
        tab.evaluate(f"{CARD}.querySelector('.player button').click()")
        tab.wait(lambda page: "6.0 of 6.0 s" in page.text, "the end of the longer one")
        # The time is rounded, so that it says the end a little before it.
        tab.wait(lambda page: page.evaluate(f"{CARD}.querySelector('.player button').innerText") == "Play", "the stop")
        press(tab, "Home", "ArrowRight")
        assert tab.evaluate(f"{CARD}.querySelector('output').innerText") == "0.1 of 6.0 s"
        assert "The video of" not in tab.text
        assert "No video: it was asked for failures only" in tab.text
        assert tab.complaints == []


def press(page: Page, *keys: str) -> None:
    """Presses keys while the control of the first pair has the focus."""
    page.evaluate(f"{CARD}.querySelector('.player input').focus()")
    codes = {"Home": 36, "ArrowRight": 39}
    for key in keys:
        for kind in ("keyDown", "keyUp"):
            page.send("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=codes[key])
