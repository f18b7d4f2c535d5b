"""The page of a deployment in a browser: nothing sticks out, bars are where they belong, on screens of any width."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.browser import NEEDS_BROWSER, Page, browsing
from helpers.simulated_rollouts import arn_of, report_of, simulate

from prefect_robomaker.schemas.rollouts.events import Paused, Resumed, Stopped
from prefect_robomaker.schemas.rollouts.rollout import Rollout
from prefect_robomaker.tasks.reporting import write_deployment

pytestmark = NEEDS_BROWSER

LONG = "courier-with-a-very-long-name-" + "x" * 90


def rollouts() -> dict[str, Rollout]:
    twelve = [f"r{number}" for number in range(12)]
    return {
        "one": simulate(["rover"]),
        "names": simulate(["r0", LONG, "größer-ロボット"], concurrent=34, threshold=50, bad=lambda number: number == 1),
        "paused": simulate(twelve, events=((20, Paused()), (50, Resumed()), (60, Paused())), until_s=90),
        "running": simulate(twelve, until_s=40),
        "canceled": simulate(twelve, events=((40, Stopped(why="canceled")),)),
        "breach": simulate(twelve, bad=lambda number: number > 2),
        "sixty": simulate([f"r{number}" for number in range(60)], silent=lambda number: number == 3),
        "large": simulate([f"r{number}" for number in range(600)], bad=lambda number: number % 9 == 2, threshold=50),
    }


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browsing(tmp_path_factory.mktemp("profile")) as browser, browser.page() as page:
        yield page


@pytest.mark.parametrize("name", rollouts())
def test_nothing_sticks_out(name: str, tab: Page, tmp_path: Path) -> None:
    page = write_deployment(report_of(rollouts()[name]), tmp_path / f"{name}.html")
    for width in (400, 1280):
        for theme in ("light", "dark"):
            tab.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])
            tab.load(page.as_uri(), width)
            assert tab.evaluate("document.documentElement.scrollWidth") <= width
            wide = (
                "[...document.querySelectorAll('.scroll')].filter(each => each.scrollWidth > each.clientWidth).length"
            )
            assert tab.evaluate(wide) == 0
    assert tab.complaints == []


def test_bars_are_drawn_where_time_and_wave_say(tab: Page, tmp_path: Path) -> None:
    rollout = simulate(["r0", "r1", "r2"], concurrent=34)
    page = write_deployment(report_of(rollout), tmp_path / "page.html")
    tab.load(page.as_uri(), 1280)

    rows = tab.evaluate(
        "[...document.querySelectorAll('.wave-row')].filter(row => row.querySelector('.launching')).map(row => {"
        "const at = row.querySelector('svg').getBoundingClientRect();"
        "return [row.querySelector('.name').textContent, ...['offered', 'launching'].map(phase => {"
        "const bar = row.querySelector('.' + phase).getBoundingClientRect();"
        "return [(bar.left - at.left) / at.width, (bar.right - at.left) / at.width, bar.height]})]})"
    )

    assert [row[0] for row in rows] == ["r0", "r1", "r2"]
    length_s = max(state.finished_s or 0 for state in rollout.robots.values()) - rollout.began_s
    for name, offered, launching in rows:
        state = rollout.robots[arn_of(name)]
        assert state.offered_s is not None
        assert state.finished_s is not None
        assert offered[0] == pytest.approx((state.offered_s - rollout.began_s) / length_s, abs=0.005)
        assert launching[1] == pytest.approx((state.finished_s - rollout.began_s) / length_s, abs=0.005)
        assert launching[2] > offered[2], "height says the same as colour"


def test_the_moment_of_the_breach_goes_through_all_rows(tab: Page, tmp_path: Path) -> None:
    rollout = simulate([f"r{number}" for number in range(12)], bad=lambda number: number > 2)
    tab.load(write_deployment(report_of(rollout), tmp_path / "page.html").as_uri(), 1280)

    rows = "[...document.querySelectorAll('.wave-row svg.row')]"
    marks = f"{rows}.map(row => row.querySelector('use').getBoundingClientRect()).filter(each => each.height > 10)"
    assert tab.evaluate(f"{marks}.length") == tab.evaluate(f"{rows}.length") == 13
    places = set(tab.evaluate(f"{marks}.map(each => Math.round(each.left))"))
    assert len(places) == 1
